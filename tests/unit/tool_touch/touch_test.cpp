// teletact touch on files: the trace it writes.
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <limits>
#include <sstream>

#include "tests/unit/tool_touch/touch_files.hpp"

namespace {

using namespace touch_files;

TEST_F(Touch, FloorGivesStiffnessTimesDepth) {
  ASSERT_EQ(run(standard()), 0);
  const auto r = rows(dir_ / "trace.csv");
  ASSERT_EQ(r.size(), 1000U);
  int pressed = 0;
  for (const auto& row : r) {
    const double depth = 0.415 - row[3];
    EXPECT_NEAR(row[9], depth > 0 ? 1000 * depth : 0, 0.02) << row[0];
    EXPECT_NEAR(row[7], 0, 0.02);
    EXPECT_NEAR(row[8], 0, 0.02);
    if (depth > 1e-4) {
      ++pressed;
      EXPECT_EQ(row[10], 1);
      EXPECT_NEAR(row[4], row[1], 2e-5);
      EXPECT_NEAR(row[6], 0.415, 1e-5);
    } else if (depth < 0) {
      EXPECT_EQ(row[10], 0);
      EXPECT_NEAR(row[6], row[3], 1e-9);
    }
  }
  EXPECT_GT(pressed, 700);
}

TEST_F(Touch, SameInputSameBytesButForTheCpuColumn) {
  ASSERT_EQ(run(standard("a.csv")), 0);
  ASSERT_EQ(run(standard("b.csv")), 0);
  const auto strip = [](const std::string& text) {
    std::istringstream in(text);
    std::string line, out;
    while (std::getline(in, line)) out += line.substr(0, line.rfind(',')) + "\n";
    return out;
  };
  const std::string a = strip(read(dir_ / "a.csv"));
  EXPECT_EQ(a, strip(read(dir_ / "b.csv")));
  EXPECT_GT(a.size(), 40000U);
}

TEST_F(Touch, OptionsReachTheTask) {
  auto args = standard();
  args.insert(args.end(), {"--stiffness", "500", "--tip-radius", "0.003", "--force-limit", "4",
                           "--debug", (dir_ / "debug.csv").string()});
  ASSERT_EQ(run(args), 0);
  const auto r = rows(dir_ / "trace.csv");
  double most = 0;
  for (const auto& row : r) most = std::max(most, row[9]);
  EXPECT_NEAR(most, 4.0, 1e-6);  // 500 x 11 mm = 5.5 N, cut
  EXPECT_NEAR(r[500][6], 0.418, 2e-5);
  EXPECT_NE(read(dir_ / "debug.csv").find("guard_use"), std::string::npos);
}

TEST_F(Touch, RateResamplesTheHand) {
  auto args = standard();
  args.insert(args.end(), {"--rate", "2000"});
  ASSERT_EQ(run(args), 0);
  const auto r = rows(dir_ / "trace.csv");
  EXPECT_EQ(r.size(), 1999U);
  EXPECT_NEAR(r[1000][9], 8, 0.01);
}

TEST_F(Touch, ListedFieldsReplaceEachOtherSmoothly) {
  write(dir_ / "high.npy", floor(0.004F));
  write(dir_ / "list.csv", "t_s,file\n0,floor.npy\n0.4,high.npy\n");
  auto args = standard();
  args[0] = "--fields";
  args[1] = (dir_ / "list.csv").string();
  ASSERT_EQ(run(args), 0);
  const auto r = rows(dir_ / "trace.csv");
  EXPECT_NEAR(r[395][9], 8, 0.02);
  EXPECT_NEAR(r[470][9], 12, 0.02);
  for (std::size_t i = 1; i < r.size(); ++i) EXPECT_LE(std::abs(r[i][9] - r[i - 1][9]), 0.3 + 1e-6);
}

// A field a millisecond: the windows that the task blends stay as they are, and the newest pending
// one wins.
TEST_F(Touch, FieldsFasterThanTheBlendAreNotWrittenOver) {
  std::string list = "t_s,file\n";
  char line[64];
  for (int i = 0; i < 400; ++i) {
    if (i < 20)
      write(dir_ / ("f" + std::to_string(i) + ".npy"), floor(0.0002F * static_cast<float>(i)));
    // Rises by 0.2 mm a millisecond to 3.8 mm and falls back, again and again.
    const int phase = i % 38;
    std::snprintf(line, sizeof line, "%.3f,f%d.npy\n", 0.3 + 1e-3 * i,
                  phase < 20 ? phase : 38 - phase);
    list += line;
  }
  write(dir_ / "list.csv", "t_s,file\n0,floor.npy\n" + list.substr(list.find('\n') + 1));
  auto args = standard();
  args[0] = "--fields";
  args[1] = (dir_ / "list.csv").string();
  args.insert(args.end(),
              {"--debug", (dir_ / "debug.csv").string(), "--window", "16", "--guard", "off"});
  ASSERT_EQ(run(args), 0);
  auto table = teletact::read_csv((dir_ / "debug.csv").string());
  ASSERT_TRUE(table) << table.error();
  const auto column = [&](const char* name, std::size_t row) {
    const int at = table.value().column(name);
    EXPECT_GE(at, 0) << name;
    return table.value().number(row, static_cast<std::size_t>(at)).value();
  };
  // Between two fixed windows the force of a resting hand goes linearly with the blend; a window
  // written over in the middle of it bends that.
  int blends = 0, inside = 0;
  for (std::size_t i = 302; i < 700; ++i) {
    const double s0 = column("blend", i - 2), s1 = column("blend", i - 1), s2 = column("blend", i);
    if (s1 < s0) ++blends;
    if (!(s0 < s1 && s1 < s2 && s2 < 1)) continue;
    ++inside;
    const double f0 = column("raw_fz", i - 2), f1 = column("raw_fz", i - 1),
                 f2 = column("raw_fz", i);
    EXPECT_NEAR((f1 - f0) / (s1 - s0), (f2 - f1) / (s2 - s1), 0.05) << i;
  }
  EXPECT_GT(blends, 8);
  EXPECT_GT(inside, 250);
}

// The first contact is with the field that is visible then, not with the first one listed.
TEST_F(Touch, DefaultViewIsOfTheFieldThatIsTouched) {
  write(dir_ / "deep.npy", floor(-0.05F));
  write(dir_ / "list.csv", "t_s,file\n0,deep.npy\n0.4,floor.npy\n");
  auto args = standard();
  args[0] = "--fields";
  args[1] = (dir_ / "list.csv").string();
  for (auto& a : args) {
    if (a == "constrained") a = "force_shading";
  }
  ASSERT_EQ(run(args), 0);
  const auto r = rows(dir_ / "trace.csv");
  EXPECT_NEAR(r[390][9], 0, 1e-9);
  // Seen from above: the rows of pixels are 1 m / 365 apart.
  EXPECT_NEAR(r[600][9], 8, 0.05);
}

// Two materials by label: the force is the label's share; and what is wrong with either file.
TEST_F(Touch, LabelsAndPaletteReachTheTask) {
  std::string labels;
  for (int x = 0; x < 24; ++x) labels += std::string(24 * 24, x < 12 ? '\0' : '\x03');
  const auto npy = [](const std::string& bytes, const std::string& shape) {
    return npy_bytes({}, shape, "|u1") + bytes;
  };
  const std::string good = npy(labels, "(24, 24, 24)");
  const std::string palette = "label,stiffness,friction\n0,1,0\n3,0.5,0.3\n";
  write(dir_ / "labels.npy", good);
  write(dir_ / "palette.csv", palette);
  const auto with = [&] {
    auto args = standard();
    args.insert(args.end(), {"--labels", (dir_ / "labels.npy").string(), "--palette",
                             (dir_ / "palette.csv").string()});
    return args;
  };
  ASSERT_EQ(run(with()), 0);
  const auto r = rows(dir_ / "trace.csv");
  EXPECT_NEAR(r[250][9], 8, 0.02);  // x = -0.003: label 0
  EXPECT_NEAR(r[770][9], 4, 0.02);  // x = 0.049: label 3
  EXPECT_NEAR(r[770][7], -0.24 * 4, 0.05);
  EXPECT_NEAR(r[250][7], 0, 0.02);
  struct Bad {
    std::string labels, palette;
    const char* says;
  };
  for (const Bad& bad : std::initializer_list<Bad>{
           {npy_bytes(std::vector<float>(24 * 24 * 24, 0), "(24, 24, 24)"), palette, "|u1"},
           {npy(labels, "(24, 576)"), palette, "shape"},
           {npy(labels.substr(1), "(24, 24, 24)"), palette, "bytes of data"},
           {good, "label,stiffness\n0,1\n", "label 3 has no row"},
           {good, "label,stiffness\n0,1\n16,1\n", "0 to 15"},
           {good, "label,stiffness\n0,1\n3,2\n", "stiffness 2"},
           {good, "label,stiffness\n0,1\n3,1\n3,1\n", "a row already"},
           {good, "label,colour\n0,1\n", "'colour'"},
           {good, "0,1\n3,1\n", "'label'"},
           {good, "label,friction,friction_dynamic\n0,0,0\n3,0.1,0.2\n", "above friction"},
       }) {
    write(dir_ / "labels.npy", bad.labels);
    write(dir_ / "palette.csv", bad.palette);
    fs::remove(dir_ / "trace.csv");
    const std::string message = refusal(with());
    EXPECT_NE(message.find(bad.says), std::string::npos) << bad.says << ": " << message;
    EXPECT_FALSE(fs::exists(dir_ / "trace.csv"));
  }
  auto alone = standard();
  alone.insert(alone.end(), {"--labels", (dir_ / "labels.npy").string()});
  EXPECT_NE(refusal(alone).find("--labels needs --palette"), std::string::npos);
  auto both = with();
  both.insert(both.end(), {"--friction", "0.3"});
  EXPECT_NE(refusal(both).find("--friction has no meaning"), std::string::npos);
  auto bumps = standard();
  bumps.push_back("--bump-normal");
  EXPECT_NE(refusal(bumps).find("--bump-normal needs"), std::string::npos);
  auto circle = standard();
  circle.insert(circle.end(), {"--paper-friction", "0.4"});
  EXPECT_NE(refusal(circle).find("--paper-friction has no meaning with --method"),
            std::string::npos);
  *std::find(circle.begin(), circle.end(), "constrained") = "force_shading";
  EXPECT_EQ(run(circle), 0);
}

TEST_F(Touch, RecordedRunReplaysToTheLastBit) {
  const auto file = [&](const char* name) { return (dir_ / name).string(); };
  auto args = standard();
  args.insert(args.end(), {"--record", file("a.run"), "--friction", "0.3"});
  ASSERT_EQ(run(args), 0);
  ASSERT_EQ(run({"--replay", file("a.run"), "--out", file("again.csv")}), 0);
  const auto first = rows(dir_ / "trace.csv"), again = rows(dir_ / "again.csv");
  ASSERT_EQ(first.size(), again.size());
  for (std::size_t i = 0; i < first.size(); ++i) {
    for (std::size_t c = 1; c < 11; ++c) EXPECT_NEAR(first[i][c], again[i][c], 1e-9) << i;
  }
  // The same hand and windows through the memoryless baseline.
  ASSERT_EQ(run({"--replay", file("a.run"), "--method", "nearest10", "--out", file("n.csv")}), 0);
  EXPECT_EQ(rows(dir_ / "n.csv").size(), first.size());
  EXPECT_NE(
      refusal({"--replay", file("hand.csv"), "--out", file("x.csv")}).find("not a haptic run"),
      std::string::npos);
  EXPECT_NE(refusal({"--replay", file("a.run"), "--voxel", "0.01", "--out", file("x.csv")})
                .find("--voxel has no meaning"),
            std::string::npos);
  // Whatever the run was recorded with stays as it was, and is not passed over in silence.
  for (const char* option : {"--stiffness", "--friction", "--debug", "--guard"}) {
    EXPECT_NE(refusal({"--replay", file("a.run"), option, "1", "--out", file("x.csv")})
                  .find(std::string(option) + " has no meaning"),
              std::string::npos);
  }
  EXPECT_FALSE(fs::exists(dir_ / "x.csv"));
}

TEST_F(Touch, UnevenRowsAreRefusedOrInterpolated) {
  std::ostringstream out;
  out << "t_s,x,y,z\n";
  for (int i = 0; i < 300; ++i) {
    const double t = 1e-3 * i + (i % 2 == 1 && i < 299 ? 7e-4 : 0);
    out << t << ",-0.01,0.31," << 0.425 - 0.05 * t << '\n';
  }
  write(dir_ / "hand.csv", out.str());
  EXPECT_NE(refusal(standard()).find("give --rate"), std::string::npos);
  // The rate that the rows have in the mean: still interpolated.
  auto args = standard();
  args.insert(args.end(), {"--rate", "1000"});
  ASSERT_EQ(run(args), 0);
  const auto trace = rows(dir_ / "trace.csv");
  ASSERT_EQ(trace.size(), 300U);
  for (std::size_t i = 0; i < trace.size(); ++i) {
    EXPECT_NEAR(trace[i][0], 1e-3 * static_cast<double>(i), 1e-9);
    EXPECT_NEAR(trace[i][3], 0.425 - 0.05 * trace[i][0], 1e-7) << i;
  }
}

TEST_F(Touch, AViewThatSeesNothingIsSaid) {
  auto args = standard();
  *std::find(args.begin(), args.end(), "constrained") = "force_shading";
  auto away = args;
  away.insert(away.end(), {"--view", "0,0.3,0.8,0,0.3,2"});
  EXPECT_NE(refusal(away).find("no surface is seen"), std::string::npos);
  EXPECT_FALSE(fs::exists(dir_ / "trace.csv"));
  args.insert(args.end(), {"--view", "0,0.3,0.8,0,0.3,0.4"});
  EXPECT_EQ(run(args), 0);
}

// The clutch is held while the device goes back over the floor: the scene's hand waits, and goes on
// from there.
TEST_F(Touch, ClutchColumnMovesTheWorkspace) {
  std::ostringstream out;
  out << "t_s,x,y,z,clutch\n";
  char line[96];
  for (int i = 0; i < 900; ++i) {
    const double down = 1e-4 * std::min(i, 180);
    const double aside = i < 300 ? 0 : 1e-4 * (std::min(i, 600) - 300);
    std::snprintf(line, sizeof line, "%.6f,%.9f,%.9f,%.9f,%d\n", 1e-3 * i, -0.01 + aside, 0.31,
                  0.425 - down, i >= 300 && i < 600 ? 1 : 0);
    out << line;
  }
  write(dir_ / "hand.csv", out.str());
  ASSERT_EQ(run(standard()), 0);
  const auto r = rows(dir_ / "trace.csv");
  EXPECT_NEAR(r[290][9], 8, 0.02);
  EXPECT_NEAR(r[550][9], 0, 1e-6) << "forces fade out";
  EXPECT_NEAR(r[550][1], -0.01, 1e-6) << "the scene's hand stands";
  EXPECT_NEAR(r[890][9], 8, 0.02);
  EXPECT_NEAR(r[890][1], -0.01 + 1e-4, 1e-6) << "and goes on from there, by the one step after it";
  write(dir_ / "hand.csv", "t_s,x,y,z,clutch\n0,0,0,0,0\n0.001,0,0,0,2\n");
  EXPECT_NE(refusal(standard()).find("clutch"), std::string::npos);
}

// Known above 0.42 m only: the hand goes down out of what was seen, into what was not.
TEST_F(Touch, UnobservedSpaceGivesNoForce) {
  std::vector<float> v;
  for (int i = 0; i < 24 * 24; ++i) {
    for (int k = 0; k < 24; ++k) v.push_back(k < 12 ? std::nanf("") : 0.2F);
  }
  write(dir_ / "floor.npy", npy_bytes(v, "(24, 24, 24)"));
  ASSERT_EQ(run(standard()), 0);
  for (const auto& row : rows(dir_ / "trace.csv")) {
    EXPECT_EQ(row[7], 0);
    EXPECT_EQ(row[9], 0);
    EXPECT_EQ(row[10], 0);
  }
}

// The device's base goes along: a hand far from the world's origin is one near it, moved.
TEST_F(Touch, FieldAndPathMovedTogetherFeelTheSame) {
  ASSERT_EQ(run(standard()), 0);
  const auto here = rows(dir_ / "trace.csv");
  for (const double aside : {5.0, 20.0, -400.0}) {
    write(dir_ / "hand.csv", press(aside));
    auto args = standard("there.csv");
    args[4] = "--origin=" + std::to_string(aside - 0.1) + ",0.2,0.3";
    args.insert(args.end(), {"--record", (dir_ / "there.run").string()});
    ASSERT_EQ(run(args), 0);
    const auto there = rows(dir_ / "there.csv");
    ASSERT_EQ(there.size(), here.size());
    for (std::size_t i = 0; i < here.size(); ++i) {
      EXPECT_NEAR(there[i][1], here[i][1] + aside, 1e-6) << i;
      EXPECT_NEAR(there[i][4], here[i][4] + aside, 2e-5) << i;
      for (std::size_t c = 7; c < 10; ++c) EXPECT_NEAR(there[i][c], here[i][c], 1e-3) << i;
    }
    EXPECT_EQ(
        run({"--replay", (dir_ / "there.run").string(), "--out", (dir_ / "again.csv").string()}),
        0);
  }
}

}  // namespace
