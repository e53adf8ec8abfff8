// Pixels without colour: what is counted of them, that they darken nothing, and what shows where no
// colour ever came.
#include <gtest/gtest.h>

#include <array>
#include <cstring>

#include "perception/geometry/no_colour.hpp"
#include "perception/raycast/raycast.hpp"
#include "perception/simd/isa.hpp"
#include "perception/tsdf/blocks/map_reader.hpp"
#include "perception/tsdf/kernels/voxel_update.hpp"
#include "perception/tsdf/mesh/mesh.hpp"
#include "perception/tsdf/mesh/mesh_deltas.hpp"
#include "tests/unit/perception_tsdf/dense_reference.hpp"

namespace tests {
namespace {

// Every colour random, `lacking` of the pixels without one, some nearly black.
void colour_at_random(Frame& f, double lacking, rt::Random random) {
  const auto byte = [&] { return static_cast<std::uint8_t>(random.integer(0, 255)); };
  for (int i = 0; i < f.k.width * f.k.height; ++i) {
    const double kind = random.uniform();
    Rgb& c = f.colour.data()[i];
    c = {byte(), byte(), byte()};
    if (kind < 0.05) c = {0, 0, 1};
    if (kind > 0.95) c = {255, 255, 255};
    c = lifted(c);
    if (random.uniform() < lacking) c = kNoColour;
  }
}

TEST(NoColour, SameColoursAndCountsAsADenseIntegrator) {
  std::printf("  seed 21\n");
  rt::Startup startup;
  const TsdfConfig config = small_map(0.03);
  TsdfMap map(startup.token(), config);
  DepthPyramid pixels(startup.token());
  const int half = 21;
  DenseReference dense(-half, 2 * half, config);
  const Intrinsics k = small_camera();
  const double band = std::max(config.colour_band_m, config.voxel_size_m);
  for (int n = 0; n < 26; ++n) {  // beyond what is counted
    const Pose X = around(n);
    const rt::Random random(21, static_cast<std::uint64_t>(n));
    Frame f = render(table_top(), k, X, 0.004, 0.03, random);
    colour_at_random(f, n % 3 == 0 ? 0.0 : n % 3 == 1 ? 0.3 : 0.9, random);
    const bool coloured = n % 5 != 4;
    ASSERT_FALSE(map.integrate(f.view(coloured), X, 1).refused);
    pixels.build(f.depth.view(),
                 {0.2F, 5.0F, 0.04F, 0.02F, static_cast<float>(k.fx), static_cast<float>(k.fy),
                  static_cast<float>(k.cx), static_cast<float>(k.cy),
                  static_cast<float>(std::min(1.0, 2.5 * 0.03 / map.truncation())), false});
    dense.integrate(
        k, pixels.pixels(), X,
        [&](int i, int j, int l) {
          return map.find_block({i >> 3, j >> 3, l >> 3}) != TsdfMap::kNoBlock;
        },
        f.view(coloured).colour, band);
  }
  int read = 0, never = 0, full = 0, some = 0;
  for (int i = -half; i < half; ++i)
    for (int j = -half; j < half; ++j)
      for (int l = -half; l < half; ++l) {
        const std::int32_t b = map.find_block({i >> 3, j >> 3, l >> 3});
        if (b == TsdfMap::kNoBlock) continue;
        const std::uint32_t got = map.block_colours(b)[TsdfMap::in_block(i, j, l)];
        const auto& want = dense.at(i, j, l);
        ASSERT_EQ(readings_of(got), static_cast<std::uint32_t>(want.readings));
        ASSERT_EQ(coloured_readings_of(got), static_cast<std::uint32_t>(want.coloured));
        for (unsigned a = 0; a < 3; ++a)
          ASSERT_EQ((got >> (8 * a)) & 0xffU, static_cast<std::uint32_t>(want.colour[a]))
              << "node " << i << " " << j << " " << l << " channel " << a;
        read += want.readings > 0 ? 1 : 0;
        never += want.readings > 0 && want.coloured == 0 ? 1 : 0;
        some += want.coloured > 0 && want.coloured < want.readings ? 1 : 0;
        full += want.coloured == 15 ? 1 : 0;
      }
  std::printf("  %d nodes read: %d never coloured, %d less often than read, %d to the most\n", read,
              never, some, full);
  EXPECT_GT(read, 3000);
  EXPECT_GT(never, 20);
  EXPECT_GT(some, 1000);
  EXPECT_GT(full, 20);
}

// Any word that a voxel can hold and any pixel, the image's last one too: vectors and plain loops.
TEST(NoColour, EveryInstructionSetGivesTheSameWords) {
  std::printf("  seed 22\n");
  rt::Random random(22);
  constexpr int kWidth = 37, kHeight = 29;
  std::array<std::uint32_t, kWidth * kHeight + 1> pixels{};
  std::array<std::uint8_t, 3 * kWidth * kHeight> colour{};
  for (int round = 0; round < 60; ++round) {
    const double lacking = round % 4 == 0 ? 0.0 : round % 4 == 1 ? 1.0 : random.uniform();
    for (int n = 0; n < kWidth * kHeight; ++n) {
      pixels[static_cast<std::size_t>(n)] =
          static_cast<std::uint32_t>(random.integer(950, 1050)) | 128U << 16U | 32U << 24U;
      for (int a = 0; a < 3; ++a)
        colour[static_cast<std::size_t>(3 * n + a)] =
            random.uniform() < 0.1 ? std::uint8_t{0} : static_cast<std::uint8_t>(random());
      if (random.uniform() < lacking) std::fill_n(colour.begin() + 3 * n, 3, std::uint8_t{0});
    }
    UpdateCamera c{};
    c.fx = c.fy = 400, c.cx_plus_half = kWidth / 2.0F + 0.5F,
    c.cy_plus_half = kHeight / 2.0F + 0.5F;
    c.width = kWidth, c.height = kHeight;
    c.pixels = pixels.data();
    c.truncation_m = 0.05F, c.units_per_m = 32767 / 0.05F, c.weight_cap = 6400;
    c.place_nodes({0.01F, 0, 0}, {0, 0.01F, 0}, {0, 0, 0.01F});
    c.gather = round % 2 != 0;
    c.colour_band_m = 0.05F;
    c.colour = colour.data();
    c.colour_stride_px = kWidth;
    const float p0[3] = {-0.035F, -0.035F, 0.97F};
    struct Block {
      std::array<std::uint32_t, 512> words{}, colours{};
      std::array<std::uint64_t, 8> free{};
      BlockMemory memory() { return {words.data(), free.data(), colours.data(), words.data()}; }
    } before;
    for (std::size_t n = 0; n < 512; ++n) {
      const auto read = static_cast<std::uint32_t>(random.integer(0, 15));
      const auto coloured = static_cast<std::uint32_t>(random.integer(0, static_cast<int>(read)));
      before.colours[n] = read << 24U | coloured << 28U;
      if (coloured > 0) before.colours[n] |= static_cast<std::uint32_t>(random()) & 0xffffffU;
    }
    Block want = before;
    const BlockCounts counts = update_block_scalar(c, p0, want.memory());
    ASSERT_GT(counts.fused, 300);
    for (const simd::Isa isa : simd::available()) {
      ASSERT_TRUE(simd::choose(isa));
      Block got = before;
      update_block(c, p0, false, got.memory());
      EXPECT_EQ(got.colours, want.colours) << simd::name_of(isa) << " round " << round;
      EXPECT_EQ(got.words, want.words) << simd::name_of(isa) << " round " << round;
    }
    for (std::size_t n = 0; n < 512; ++n) {
      EXPECT_GE(readings_of(want.colours[n]), coloured_readings_of(want.colours[n]));
      if (lacking == 1.0) {
        EXPECT_EQ(want.colours[n] & 0xf0ffffffU, before.colours[n] & 0xf0ffffffU);
      }
    }
    EXPECT_TRUE(simd::choose("auto"));
  }
}

// A wall whose pixels between two columns have no colour.
Frame wall_without(const Scene& scene, const Pose& X, int first, int end, bool lift) {
  Frame f = render(scene, small_camera(), X);
  for (int v = 0; v < f.k.height; ++v)
    for (int u = first; u < end; ++u) f.colour.at(u, v) = kNoColour;
  if (lift) lift_black(f.colour.view());  // what black for no colour came to
  return f;
}

// A strip that the colour camera does not see in two frames of three, and elsewhere in each: all of
// it has the wall's colour in the end. Taken for black, it is dark.
TEST(NoColour, AHiddenStripKeepsTheColourOfTheWall) {
  rt::Startup startup;
  const Scene scene = table_top();
  const Pose X = around(0);
  for (const bool taken_for_black : {false, true}) {
    TsdfMap map(startup.token(), small_map(0.02));
    for (int n = 0; n < 12; ++n) {
      const int first = 20 + 10 * (n % 4);
      const Frame f = wall_without(scene, X, n % 3 == 2 ? 0 : first, n % 3 == 2 ? 0 : first + 40,
                                   taken_for_black);
      map.integrate(f.view(true), X, 1);
    }
    MapReader reader(map);
    int looked = 0, off = 0, worst = 0;
    const Frame truth = render(scene, small_camera(), X);
    for (int v = 5; v < 100; v += 2)
      for (int u = 15; u < 100; ++u) {
        if (truth.depth.at(u, v) == 0) continue;
        const Rgb want = truth.colour.at(u, v);
        // One thing and one face all round: an edge mixes two of them.
        bool even = true;
        for (int y = -5; y <= 5; ++y)
          for (int x = -5; x <= 5; ++x) even = even && truth.colour.at(u + x, v + y) == want;
        Rgb c;
        const Vec3 p = X * truth.k.unproject(u, v, truth.depth.at(u, v) * 1e-3);
        if (!even || !reader.colour(p, c)) continue;
        ++looked;
        const int d =
            std::max({std::abs(c.r - want.r), std::abs(c.g - want.g), std::abs(c.b - want.b)});
        worst = std::max(worst, d);
        off += d > 2 ? 1 : 0;
      }
    std::printf("  %s: %d places, %d more than 2 levels off, worst %d\n",
                taken_for_black ? "taken for black" : "no colour", looked, off, worst);
    EXPECT_GT(looked, 1000);
    if (taken_for_black) {
      EXPECT_GT(off, looked / 2) << "the case shows nothing";
    } else {
      EXPECT_EQ(off, 0);
    }
  }
}

// A strip that no frame sees in colour is a surface like the rest, and grey wherever it is shown.
TEST(NoColour, WhatWasNeverColouredIsGreyAndStillASurface) {
  rt::Startup startup;
  const Scene scene{{{{0.45, 0, 0}, -Vec3::UnitX()}}, {}, {}};
  const Pose X = look_at(Vec3(-0.6, 0, 0), Vec3(0.4, 0, 0));
  TsdfMap with(startup.token(), small_map(0.02)), without(startup.token(), small_map(0.02));
  for (int n = 0; n < 6; ++n) {
    with.integrate(render(scene, small_camera(), X).view(true), X, 1);
    without.integrate(wall_without(scene, X, 50, 80, false).view(true), X, 1);
  }
  MapReader reader(without);
  Rgb c;
  const Vec3 middle = X * small_camera().unproject(65, 50, 1.05);
  EXPECT_FALSE(reader.colour(middle, c));
  EXPECT_TRUE(reader.colour(X * small_camera().unproject(30, 50, 1.05), c));
  const Mesh all = extract_mesh(startup.token(), with),
             some = extract_mesh(startup.token(), without);
  ASSERT_EQ(all.triangles.size(), some.triangles.size()) << "readings count without colour";
  ASSERT_EQ(all.vertices_W.size(), some.vertices_W.size());
  std::size_t grey = 0;
  for (std::size_t n = 0; n < some.colours.size(); ++n) {
    const Rgb seen = some.colours[n];
    ASSERT_TRUE(seen == kNeutral || seen == all.colours[n]);
    if (seen == kNeutral && all.colours[n] != kNeutral) ++grey;
  }
  EXPECT_GT(grey, some.colours.size() / 10);
  MeshSender sender(startup.token(), without);
  MeshStore store;
  const auto delta = std::make_unique<MeshDelta>();
  while (sender.next(64, *delta)) ASSERT_TRUE(store.take(*delta));
  std::size_t sent_grey = 0;
  for (const Rgb& seen : store.mesh().colours) {
    ASSERT_NE(seen, kNoColour);
    sent_grey += seen == kNeutral ? 1 : 0;
  }
  EXPECT_GT(sent_grey, 0U);
  RaycastMaps maps(startup.token(), 128, 106);
  RaycastOptions o;
  o.colour = true;
  raycast(without, small_camera(), X, o, maps);
  EXPECT_EQ(maps.colour().at(65, 50), kNeutral);
  EXPECT_EQ(maps.colour().at(30, 50), render(scene, small_camera(), X).colour.at(30, 50));
}

TEST(NoColour, AQuickLookMissesNoPixel) {
  std::printf("  seed 23\n");
  rt::Random random(23);
  for (int round = 0; round < 2000; ++round) {
    const int n = static_cast<int>(random.integer(1, 70));
    std::vector<Rgb> row(static_cast<std::size_t>(n));
    const auto byte = [&] {
      return random.uniform() < 0.3 ? std::uint8_t{0} : static_cast<std::uint8_t>(random());
    };
    bool lacks = false, three = false;
    for (Rgb& c : row) c = {byte(), byte(), byte()}, lacks = lacks || !has_colour(c);
    const auto* b = reinterpret_cast<const std::uint8_t*>(row.data());
    for (int i = 0; i + 2 < 3 * n; ++i)
      three = three || (b[i] == 0 && b[i + 1] == 0 && b[i + 2] == 0);
    EXPECT_EQ(may_lack_colour(row.data(), n), three);
    if (lacks) {
      EXPECT_TRUE(three);
    }
  }
  std::vector<Rgb> bright(64, Rgb{0, 0, 9});
  EXPECT_FALSE(may_lack_colour(bright.data(), 64));
  EXPECT_FALSE(may_lack_colour(bright.data(), 0));
}

}  // namespace
}  // namespace tests
