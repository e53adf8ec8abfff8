// Maps as files: the same map back, the same bytes, and one line for each way a file can be wrong.
#include <gtest/gtest.h>

#include <unistd.h>

#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <memory>

#include "perception/geometry/no_colour.hpp"
#include "perception/map_file/map_file.hpp"
#include "tests/unit/perception_tsdf/scene.hpp"

namespace tests {
namespace {

TsdfConfig config_of(int blocks = 8192) {
  TsdfConfig c = small_map(0.02);
  c.max_blocks = blocks;
  c.far_store_kib = 4096;
  return c;
}

struct Map {
  rt::Startup startup;
  TsdfMap tsdf;
  Keyframes keyframes;
  explicit Map(const TsdfConfig& c = config_of(), const KeyframeConfig& k = {})
      : tsdf(startup.token(), c), keyframes(startup.token(), k) {}
  [[nodiscard]] std::string bytes() { return encode_map(startup.token(), tsdf, keyframes); }
  rt::Result<bool> take(const std::string& bytes) {
    const auto file = parse_map(startup.token(), bytes, "m.map");
    if (!file) return rt::Error{file.error()};
    return restore_map(startup.token(), file.value(), tsdf, keyframes);
  }
};

// With colour, labels, free space, keyframes and a part that is put away.
std::unique_ptr<Map> filled() {
  auto m = std::make_unique<Map>();
  const Intrinsics k = small_camera();
  std::vector<std::uint8_t> labels(static_cast<std::size_t>(k.width * k.height), 0);
  std::fill_n(labels.begin() + 3000, 4000, std::uint8_t{7});
  rt::Random random(3);
  for (int n = 0; n < 5; ++n) {
    Frame f = render(table_top(), k, around(n), 0.001, 0.02);
    for (int i = 0; i < k.width * k.height; ++i)
      if (i % k.width > 60 || random.uniform() < 0.2) f.colour.data()[i] = kNoColour;
    m->tsdf.integrate(f.view(true), around(n), 1);
    m->tsdf.vote_labels({labels.data(), k.width, k.height, k.width});
    Thumbnail t;
    for (auto& d : t.depth) d = static_cast<std::uint8_t>(random());
    for (auto& g : t.grey) g = static_cast<std::uint8_t>(random());
    m->keyframes.add(around(n), t);
  }
  // Looks elsewhere: what the last image shows is not put away.
  const Vec3 aside(6.3, 0, 0);
  const Pose away = look_at(aside, aside + Vec3::UnitX());
  m->tsdf.integrate(render(Scene{}, k, away).view(), away, 1);
  EXPECT_GT(m->tsdf.page({&aside, 1}, 1 << 20).put_away, 0);
  EXPECT_GT(m->tsdf.block_count(), 0);
  return m;
}

TEST(MapFile, GivesTheSameMapBackAndTheSameBytes) {
  const auto m = filled();
  const std::string bytes = m->bytes();
  std::printf(
      "  %d blocks near, %d far, %zu bytes, %.0f a block\n", m->tsdf.block_count(),
      m->tsdf.far_block_count(), bytes.size(),
      static_cast<double>(bytes.size()) / (m->tsdf.block_count() + m->tsdf.far_block_count()));
  Map back;
  ASSERT_TRUE(back.take(bytes));
  EXPECT_EQ(back.tsdf.far_block_count(), 0) << "there is room for all of it";
  const Vec3 here(0, 0, 0);
  m->tsdf.page({&here, 1}, 1 << 20);
  ASSERT_EQ(m->tsdf.far_block_count(), 0);
  int known = 0, labelled = 0, free = 0;
  for (int i = -70; i < 70; ++i)
    for (int j = -70; j < 70; ++j)
      for (int h = -70; h < 70; ++h) {
        ASSERT_EQ(back.tsdf.word_at(i, j, h), m->tsdf.word_at(i, j, h));
        ASSERT_EQ(back.tsdf.free_at(i, j, h), m->tsdf.free_at(i, j, h));
        ASSERT_EQ(back.tsdf.label_at(i, j, h), m->tsdf.label_at(i, j, h));
        known += back.tsdf.word_at(i, j, h) != 0;
        labelled += back.tsdf.label_at(i, j, h).label == 7;
        free += back.tsdf.free_at(i, j, h);
      }
  EXPECT_GT(known, 20000);
  EXPECT_GT(labelled, 100);
  EXPECT_GT(free, 20000);
  int never = 0, less = 0;
  m->tsdf.for_each_block([&](std::int32_t b, BlockCoord at) {
    const std::int32_t c = back.tsdf.find_block(at);
    ASSERT_NE(c, TsdfMap::kNoBlock);
    EXPECT_EQ(std::memcmp(m->tsdf.block_colours(b), back.tsdf.block_colours(c), 2048), 0);
    for (int n = 0; n < TsdfMap::kBlockVoxels; ++n) {
      const std::uint32_t word = back.tsdf.block_colours(c)[n];
      never += readings_of(word) > 0 && coloured_readings_of(word) == 0 ? 1 : 0;
      less += coloured_readings_of(word) > 0 && coloured_readings_of(word) < readings_of(word);
    }
  });
  EXPECT_GT(never, 100) << "never coloured";
  EXPECT_GT(less, 100) << "coloured less often than read";
  ASSERT_EQ(back.keyframes.size(), m->keyframes.size());
  for (int n = 0; n < back.keyframes.size(); ++n) {
    EXPECT_TRUE(back.keyframes.at(n).X_WC.isApprox(m->keyframes.at(n).X_WC, 0));
    EXPECT_EQ(back.keyframes.at(n).view.depth, m->keyframes.at(n).view.depth);
    EXPECT_EQ(back.keyframes.at(n).view.grey, m->keyframes.at(n).view.grey);
  }
  EXPECT_EQ(back.bytes(), bytes);
  EXPECT_EQ(m->bytes(), bytes) << "near or far makes no difference";
  Map small(config_of(60));
  ASSERT_TRUE(small.take(bytes)) << "the far store takes what the pool does not";
  EXPECT_GT(small.tsdf.far_block_count(), 0);
  EXPECT_EQ(small.bytes(), bytes);
}

TEST(MapFile, AnEmptyMapIsAMap) {
  Map m, back;
  const std::string bytes = m.bytes();
  EXPECT_EQ(bytes.size(), kMapHeaderBytes);
  EXPECT_TRUE(back.take(bytes));
  EXPECT_EQ(back.tsdf.block_count(), 0);
}

void expect_error(const rt::Result<bool>& r, const std::string& word) {
  ASSERT_FALSE(r) << "accepted; expected " << word;
  EXPECT_EQ(r.error().rfind("m.map", 0), 0U) << r.error();
  EXPECT_NE(r.error().find(word), std::string::npos) << r.error();
  EXPECT_EQ(r.error().find('\n'), std::string::npos) << r.error();
}

TEST(MapFile, EveryFaultIsNamedAndLeavesNothing) {
  const auto m = filled();
  const std::string good = m->bytes();
  Map back;
  const auto refused = [&](std::string bytes, const std::string& word, bool seal = true) {
    if (seal) {
      // A damaged header is sealed by its own announcement of length, too.
      seal_map(back.startup.token(), bytes);
    }
    expect_error(back.take(bytes), word);
    EXPECT_EQ(back.tsdf.block_count() + back.tsdf.far_block_count(), 0);
    EXPECT_EQ(back.keyframes.size(), 0);
  };
  const auto with = [&](std::size_t at, auto value) {
    std::string b = good;
    std::memcpy(b.data() + at, &value, sizeof value);
    return b;
  };
  refused("", "shorter", false);
  refused(good.substr(0, 95), "shorter", false);
  refused(good.substr(0, good.size() - 1), "announced", false);
  refused(good + "x", "announced", false);
  refused(with(0, 'X'), "not a map file");
  refused(with(8, std::uint32_t{1}), "is a map of version 1; this program reads version 2");
  refused(with(8, std::uint32_t{3}), "is a map of version 3; this program reads version 2");
  refused(with(16, std::uint32_t{1}), "checksum", false);
  refused(with(good.size() - 5, '\x55'), "damaged", false);
  refused(with(12, std::uint32_t{95}), "another layout");
  refused(with(64, std::uint64_t{1}), "another layout");
  refused(with(28, std::uint16_t{33}), "another layout");
  refused(with(16, std::uint32_t{0xffffffff}), "chunks = ");
  refused(with(20, std::uint32_t{0xffffffff}), "more than");
  refused(with(24, std::uint32_t{256}), "more than");
  refused(with(24, std::uint32_t{257}), "keyframes = ");
  refused(with(32, 1e300), "voxel_size_m");
  refused(with(32, std::nan("")), "voxel_size_m");
  for (double in : {0.002, 0.01, 0.1}) refused(with(32, in), "voxels of");
  for (double out : {std::nextafter(0.002, 0.0), std::nextafter(0.1, 1.0)})
    refused(with(32, out), "voxel_size_m");
  for (double in : {0.005, 0.06, 0.5}) refused(with(40, in), "truncation of");
  for (double out : {std::nextafter(0.005, 0.0), std::nextafter(0.5, 1.0)})
    refused(with(40, out), "truncation_m");
  refused(with(96, std::uint32_t{0xfffffff0}), "bytes");
  refused(with(96, std::uint32_t{3}), "bytes");
  refused(with(100, std::int32_t{1 << 30}), "malformed");  // x of the first chunk
  refused(with(112, std::uint32_t{5}), "malformed");       // carved
  const std::size_t last_pose = good.size() - 12 * sizeof(double) - 2 * Thumbnail::kCells;
  refused(with(last_pose, std::nan("")), "keyframe 4");
  refused(with(last_pose, 2.0), "keyframe 4");
  refused(with(last_pose + 9 * sizeof(double), 1e9), "keyframe 4");
  std::string more = with(24, std::uint32_t{4});
  refused(more, "behind its last keyframe");
  TsdfConfig small = config_of(60);
  small.far_store_kib = 0;
  Map tiny(small);
  expect_error(tiny.take(good), "tsdf.max_blocks = 60");
  EXPECT_EQ(tiny.tsdf.block_count(), 0);
  // A good one after all that.
  ASSERT_TRUE(back.take(good));
  EXPECT_EQ(back.bytes(), good);
}

TEST(MapFile, DamageBehindGoodChecksumsIsReadWithinBounds) {
  const auto m = filled();
  const std::string good = m->bytes();
  Map back;
  rt::Random random(17);
  std::printf("  seed 17\n");
  int taken = 0;
  for (int n = 0; n < 400; ++n) {
    std::string b = good;
    const auto edits = random.integer(1, 4);
    for (std::int64_t e = 0; e < edits; ++e) {
      const auto at =
          static_cast<std::size_t>(random.integer(0, static_cast<std::int64_t>(b.size()) - 1));
      if (random.uniform() < 0.1) {
        b.erase(at, 1 + random() % 100);
      } else {
        b[at] = static_cast<char>(random());
      }
      if (b.empty()) b = "x";
    }
    seal_map(back.startup.token(), b);
    const auto r = back.take(b);
    taken += r ? 1 : 0;
    if (!r) {
      ASSERT_EQ(back.tsdf.block_count() + back.tsdf.far_block_count(), 0);
    }
  }
  std::printf("  %d of 400 damaged files were still maps\n", taken);
}

TEST(MapFile, IsReadFromDisk) {
  namespace fs = std::filesystem;
  const fs::path path = fs::temp_directory_path() / ("teletact_map_" + std::to_string(getpid()));
  const auto m = filled();
  const std::string good = m->bytes();
  rt::Startup startup;
  std::ofstream(path, std::ios::binary) << good;
  auto file = read_map_file(startup.token(), path.string());
  ASSERT_TRUE(file) << file.error();
  EXPECT_EQ(file.value().bytes, good);
  EXPECT_EQ(static_cast<int>(file.value().info.blocks),
            m->tsdf.block_count() + m->tsdf.far_block_count());
  fs::resize_file(path, good.size() / 2);
  file = read_map_file(startup.token(), path.string());
  ASSERT_FALSE(file);
  EXPECT_NE(file.error().find(path.string()), std::string::npos);
  EXPECT_NE(file.error().find("announced"), std::string::npos) << file.error();
  fs::remove(path);
  EXPECT_FALSE(read_map_file(startup.token(), path.string()));
  const auto folder = read_map_file(startup.token(), fs::temp_directory_path().string());
  ASSERT_FALSE(folder);
  EXPECT_NE(folder.error().find("no plain file"), std::string::npos) << folder.error();
}

}  // namespace
}  // namespace tests
