#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <deque>
#include <fstream>

#include "config/schema.hpp"
#include "rt/random.hpp"

namespace {

using testing::HasSubstr;

struct Box {
  std::string material = "wood";
  std::array<double, 3> size_m{0.1, 0.2, 0.3};
  std::deque<Box> parts;
  void describe(config::Section& s, int depth = 0) {
    s.text("material", material, {"wood", "steel"}, "what it is made of");
    s.numbers("size_m", size_m, 0, 10, "edges");
    if (depth < 2) {
      s.list(
          "part",
          [this, depth](config::Section& item) { parts.emplace_back().describe(item, depth + 1); },
          "boxes on the box");
    }
  }
};

struct Everything {
  double voxel_m = 0.01, gain = 1;
  int iterations = 4;
  std::uint64_t seed = 1;
  bool enabled = false;
  std::string title = "a \"quoted\" title";
  double mu = 0.3;
  std::array<double, 2> origin_m{1.0, -2.5e-7};
  std::deque<Box> boxes;

  void describe(config::Section& s) {
    s.text("title", title, {}, "shown in the report");
    s.seed("seed", seed, "of everything random");
    auto& fusion = s.section("fusion", "the map");
    fusion.number("voxel_m", voxel_m, 0.005, 0.08, "edge of a voxel");
    fusion.integer("iterations", iterations, 1, 100, "of ICP");
    auto& deep = fusion.section("deep");
    deep.flag("enabled", enabled, "a | bar");
    deep.number("gain", gain, -std::numeric_limits<double>::infinity(),
                std::numeric_limits<double>::infinity(), "any");
    s.section("friction", "an effect").number("mu", mu, 0, 2, "coefficient");
    s.numbers("origin_m", origin_m, -5, 5, "of the room");
    s.list(
        "box", [this](config::Section& item) { boxes.emplace_back().describe(item); }, "boxes");
  }
};

struct Loaded {
  Everything data;
  config::Section root;
  rt::Result<bool> result = true;
  explicit Loaded(const std::string& text) {
    data.describe(root);
    result = config::load_text(text, "scene.toml", root);
  }
  std::string error() const { return result ? "" : result.error(); }
};

TEST(Loader, ReadsEveryType) {
  Loaded l(R"(
title = "kitchen"
seed = 42
origin_m = [1, 2.5]
[fusion]
voxel_m = 0.02
iterations = 7
[fusion.deep]
enabled = true
gain = -3        # an integer is a number
[[box]]
material = "steel"
[[box]]
size_m = [1, 1, 1]
[[box.part]]
[[box.part.part]]
material = "steel"
)");
  ASSERT_TRUE(l.result) << l.error();
  EXPECT_EQ(l.data.title, "kitchen");
  EXPECT_EQ(l.data.seed, 42U);
  EXPECT_EQ(l.data.origin_m[1], 2.5);
  EXPECT_EQ(l.data.voxel_m, 0.02);
  EXPECT_EQ(l.data.iterations, 7);
  EXPECT_TRUE(l.data.enabled);
  EXPECT_EQ(l.data.gain, -3);
  ASSERT_EQ(l.data.boxes.size(), 2U);
  EXPECT_EQ(l.data.boxes[0].material, "steel");
  EXPECT_EQ(l.data.boxes[1].size_m[2], 1);
  ASSERT_EQ(l.data.boxes[1].parts.size(), 1U);
  EXPECT_EQ(l.data.boxes[1].parts[0].parts.at(0).material, "steel");
  EXPECT_TRUE(l.root.named("fusion"));
  EXPECT_FALSE(l.root.named("friction"));
  EXPECT_FALSE(l.root.named("no such key"));
}

TEST(Loader, EmptyTextKeepsDefaults) {
  Loaded l("");
  ASSERT_TRUE(l.result);
  EXPECT_EQ(l.data.voxel_m, 0.01);
}

struct Bad {
  const char* text;
  const char* message;
};

TEST(Loader, OneMessageWithFileLineKeyValueAndRange) {
  const Bad cases[] = {
      {"\n[fusion]\nvoxel_m = 0.5",
       "scene.toml:3: key 'fusion.voxel_m' = 0.5: allowed 0.005..0.08"},
      {"[fusion]\nvoxel_m = nan", "scene.toml:2: key 'fusion.voxel_m' = nan: allowed 0.005..0.08"},
      {"[fusion]\nvoxel_m = -inf", "scene.toml:2: key 'fusion.voxel_m' = -inf: allowed"},
      {"fusion.deep.gain = inf",
       "scene.toml:1: key 'fusion.deep.gain' = inf: allowed any finite number"},
      {"[fusion]\nvoxel_m = \"big\"", "scene.toml:2: key 'fusion.voxel_m' = \"big\": allowed"},
      {"[fusion]\niterations = 4.0",
       "scene.toml:2: key 'fusion.iterations' = 4.0: allowed whole number 1..100"},
      {"[fusion]\niterations = 99999999999", "= 99999999999: allowed whole number 1..100"},
      {"[fusion]\nvoxl_m = 1",
       "scene.toml:2: key 'fusion.voxl_m' = 1: unknown key; the nearest known key is "
       "'fusion.voxel_m'"},
      {"[fusoin]\na = 1",
       "scene.toml:1: key 'fusoin' = a table: unknown key; the nearest known key is 'fusion'"},
      {"[fusion]\ngian = 1",
       "key 'fusion.gian' = 1: unknown key; the nearest known key is 'fusion.deep.gain'"},
      {"[fusion.deep]\ngain_of_the_loop = 1", "the nearest known key is 'fusion.deep.gain'"},
      {"[fusion.deep]\nqqqqqq = 1", "unknown key; known here: "},
      {"seed = -1", "key 'seed' = -1: allowed whole number 0..18446744073709551615"},
      {"seed = \"18446744073709551616\"", "key 'seed' = \"18446744073709551616\": allowed"},
      {"fusion.deep.enabled = 1", "= 1: allowed true or false"},
      {"title = 3", "scene.toml:1: key 'title' = 3: allowed text"},
      {"origin_m = [1]", "key 'origin_m' = [ 1 ]: allowed list of 2 numbers -5..5"},
      {"origin_m = [1, 6]", "key 'origin_m[1]' = 6: allowed list of 2 numbers -5..5"},
      {"fusion = 1", "scene.toml:1: key 'fusion' = 1: allowed table"},
      {"box = 1", "key 'box' = 1: allowed list of tables"},
      {"box = [1]", "key 'box[0]' = 1: allowed list of tables"},
      {"[[box]]\n[[box]]\nmaterial = \"gold\"",
       "scene.toml:3: key 'box[1].material' = \"gold\": allowed \"wood\", \"steel\""},
      {"title = ", "scene.toml:1: not TOML: "},
      {"seed = 1\nseed = 2", "scene.toml:2: not TOML: "},
      // Of several errors, the first of the file.
      {"[fusion]\nvoxel_m = 1\niterations = 0\n[friction]\nmu = 9", "scene.toml:2: "},
  };
  for (const auto& c : cases) {
    Loaded l(c.text);
    ASSERT_FALSE(l.result) << c.text;
    EXPECT_THAT(l.error(), HasSubstr(c.message)) << c.text;
    EXPECT_EQ(l.error().find('\n'), std::string::npos) << c.text;
  }
}

TEST(Loader, RangeBordersAreIncluded) {
  EXPECT_TRUE(Loaded("[fusion]\nvoxel_m = 0.005\niterations = 100").result);
  EXPECT_TRUE(Loaded("[fusion]\nvoxel_m = 0.08\niterations = 1").result);
  EXPECT_FALSE(Loaded("[fusion]\nvoxel_m = 0.0049999").result);
}

TEST(Loader, SeedsAboveSixtyThreeBitsAreText) {
  Loaded l("seed = \"18446744073709551615\"");
  ASSERT_TRUE(l.result) << l.error();
  EXPECT_EQ(l.data.seed, UINT64_MAX);
  Loaded again(config::effective(l.root));
  ASSERT_TRUE(again.result) << again.error();
  EXPECT_EQ(again.data.seed, UINT64_MAX);
}

TEST(Loader, Override) {
  Loaded l("[fusion]\nvoxel_m = 0.02");
  EXPECT_TRUE(config::load_override("fusion.voxel_m=0.03", l.root));
  EXPECT_EQ(l.data.voxel_m, 0.03);
  EXPECT_TRUE(config::load_override("title = \"x = y\"", l.root));
  EXPECT_EQ(l.data.title, "x = y");
  for (const char* bad : {"", "fusion.voxel_m", "fusion.voxel_m=", "=1", "fusion.voxel_m=1\nseed=2",
                          "[fusion]", "[fusion] voxel_m=1", "title=bare", "fusion.voxel_m=1"}) {
    const auto r = config::load_override(bad, l.root);
    ASSERT_FALSE(r) << bad;
    EXPECT_THAT(r.error(), testing::StartsWith("command line")) << bad;
    EXPECT_EQ(r.error().find('\n'), std::string::npos) << bad;
  }
}

TEST(Loader, Files) {
  Everything data;
  config::Section root;
  data.describe(root);
  const auto missing = config::load_file("/nonexistent/scene.toml", root);
  ASSERT_FALSE(missing);
  EXPECT_THAT(missing.error(), HasSubstr("/nonexistent/scene.toml"));
  EXPECT_FALSE(config::load_file("/", root));
  const std::string path = std::string(testing::TempDir()) + "teletact_loader_test.toml";
  std::ofstream(path) << "[friction]\nmu = 0.7\n";
  const auto good = config::load_file(path, root);
  EXPECT_TRUE(good) << (good ? "" : good.error());
  EXPECT_EQ(data.mu, 0.7);
  std::ofstream(path, std::ios::trunc).flush();
  EXPECT_TRUE(config::load_file(path, root)) << "an empty file is a valid configuration";
  std::remove(path.c_str());
}

TEST(Effective, RoundTripKeepsValuesAndWhatWasNamed) {
  rt::Random random(20240601);
  for (int i = 0; i < 300; ++i) {
    std::string text;
    if (random.uniform() < 0.5) text += "title = \"t\\u0001\\\"\\\\ \\n\"\n";
    if (random.uniform() < 0.5) text += "seed = " + std::to_string(random() >> 1U) + "\n";
    const bool friction = random.uniform() < 0.5;
    char buffer[64];
    if (random.uniform() < 0.5) {
      std::snprintf(buffer, sizeof buffer, "fusion.voxel_m = %.17g\n", random.uniform(0.005, 0.08));
      text += buffer;
    }
    if (friction) text += random.uniform() < 0.5 ? "[friction]\n" : "[friction]\nmu = 0.3\n";
    const auto boxes = random.integer(0, 3);
    for (int b = 0; b < boxes; ++b) {
      text += "[[box]]\n";
      if (random.uniform() < 0.5) text += "material = \"steel\"\n";
      if (random.uniform() < 0.5) text += "[[box.part]]\nsize_m = [0.1, 2, 1e-7]\n";
    }
    Loaded first(text);
    ASSERT_TRUE(first.result) << text << first.error();
    if (random.uniform() < 0.3) first.data.iterations = 9;  // set by code, not by the file
    const std::string written = config::effective(first.root);
    Loaded second(written);
    ASSERT_TRUE(second.result) << written << second.error();
    EXPECT_EQ(config::effective(second.root), written);
    EXPECT_EQ(second.data.title, first.data.title);
    EXPECT_EQ(second.data.seed, first.data.seed);
    EXPECT_EQ(second.data.voxel_m, first.data.voxel_m);
    EXPECT_EQ(second.data.iterations, first.data.iterations);
    EXPECT_EQ(second.root.named("friction"), friction);
    ASSERT_EQ(second.data.boxes.size(), first.data.boxes.size());
    for (std::size_t b = 0; b < first.data.boxes.size(); ++b) {
      EXPECT_EQ(second.data.boxes[b].material, first.data.boxes[b].material);
      ASSERT_EQ(second.data.boxes[b].parts.size(), first.data.boxes[b].parts.size());
    }
  }
}

TEST(Effective, ShowsDefaultsAsComments) {
  Loaded l("[fusion]\nvoxel_m = 0.02");
  const std::string text = config::effective(l.root);
  EXPECT_THAT(text, HasSubstr("\nvoxel_m = 0.02\n"));
  EXPECT_THAT(text, HasSubstr("# iterations = 4\n"));
  EXPECT_THAT(text, HasSubstr("# [friction]\n# mu = 0.3\n"));
}

TEST(ReferenceTable, OneRowAKey) {
  Loaded l("[[box]]");
  const std::string table = config::reference_table(l.root);
  EXPECT_THAT(table, HasSubstr("| `fusion.voxel_m` | `0.01` | 0.005..0.08 | edge of a voxel |\n"));
  EXPECT_THAT(table, HasSubstr("| true or false | a \\| bar |"));
  EXPECT_THAT(table, HasSubstr("| `box[].material` |"));
}

TEST(Schema, WrongDescriptionsAreBugs) {
  config::Section s;
  double d = 5;
  EXPECT_THROW(s.number("d", d, 0, 1, ""), std::logic_error);
  EXPECT_THROW(s.number("d", d, 9, 1, ""), std::logic_error);
  s.number("d", d, 0, 9, "");
  EXPECT_THROW(s.number("d", d, 0, 9, ""), std::logic_error);
  EXPECT_THROW(s.section("d"), std::logic_error);
  std::string t = "x";
  EXPECT_THROW(s.text("t", t, {"a"}, ""), std::logic_error);
  EXPECT_EQ(&s.section("sub"), &s.section("sub"));
}

// Mutated input never crashes, and gives either success or one line that starts with the file name.
TEST(Fuzz, MutatedTextGivesOneMessage) {
  const std::string corpus[] = {
      "title = \"kitchen\"\nseed = 42\norigin_m = [1, 2.5]\n[fusion]\nvoxel_m = 0.02\n"
      "iterations = 7\n[fusion.deep]\nenabled = true\ngain = -3\n[[box]]\nmaterial = \"steel\"\n"
      "[[box]]\nsize_m = [1, 1, 1]\n[[box.part]]\n",
      "a.b.c = {x = 1979-05-27T07:32:00Z, y = [[1, 2], ['a', '''b''']]}\nfusion.deep = {}\n"
      "\"quoted key\" = 0x1F\nseed = 1_000\n",
      "box = [{material = \"wood\", part = [{part = []}]}, {}]\n"};
  static constexpr char kAlphabet[] =
      "[]{}=.,\"'\\\n\r\t #_-+eE0123456789abfnrtuxTZ:\x01\x7f\xff\xc3";
  const std::uint64_t seed = 7;
  rt::Random random(seed, 1);
  int accepted = 0, refused = 0;
  for (int i = 0; i < 20000; ++i) {
    std::string text = corpus[random.integer(0, 2)];
    const auto edits = random.integer(1, 6);
    for (int e = 0; e < edits && !text.empty(); ++e) {
      const auto at =
          static_cast<std::size_t>(random.integer(0, static_cast<std::int64_t>(text.size()) - 1));
      switch (random.integer(0, 4)) {
        case 0:
          text[at] = kAlphabet[random.integer(0, sizeof kAlphabet - 2)];
          break;
        case 1:
          text.insert(at, 1, kAlphabet[random.integer(0, sizeof kAlphabet - 2)]);
          break;
        case 2:
          text.erase(at, static_cast<std::size_t>(random.integer(1, 12)));
          break;
        case 3:
          text.insert(at, text.substr(0, at));
          break;
        default:
          text.resize(at);
          break;
      }
    }
    Loaded l(text);
    if (l.result) {
      ++accepted;
      Loaded again(config::effective(l.root));
      ASSERT_TRUE(again.result) << "seed " << seed << " case " << i << ": " << again.error();
    } else {
      ++refused;
      ASSERT_THAT(l.error(), testing::StartsWith("scene.toml")) << "seed " << seed << " case " << i;
      ASSERT_EQ(l.error().find_first_of("\n\r"), std::string::npos);
      ASSERT_LT(l.error().size(), 700U);
    }
  }
  std::printf("seed %llu: %d accepted, %d refused\n", static_cast<unsigned long long>(seed),
              accepted, refused);
  EXPECT_GT(accepted, 100);
  EXPECT_GT(refused, 1000);
}

TEST(Fuzz, DeepAndLargeInputIsRefusedNotFollowed) {
  EXPECT_FALSE(Loaded(std::string(2U << 20U, ' ')).result);
  std::string dotted = "a";
  for (int i = 0; i < 4000; ++i) dotted += ".a";
  EXPECT_FALSE(Loaded(dotted + " = 1").result);
  EXPECT_FALSE(Loaded(dotted + dotted + dotted + " = 1").result);
  EXPECT_FALSE(Loaded("seed = " + std::string(5000, '[')).result);
}

}  // namespace
