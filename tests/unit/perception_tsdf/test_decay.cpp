// Forgetting: weights that fall, and what becomes of things that were taken away.
#include <gtest/gtest.h>

#include <map>

#include "tests/unit/perception_tsdf/scene.hpp"

namespace tests {
namespace {

TsdfConfig decaying(double half_life_s) {
  TsdfConfig c = small_map(0.02);
  c.decay_half_life_s = half_life_s;
  return c;
}

void observe(TsdfMap& map, int frames) {
  for (int n = 0; n < frames; ++n)
    map.integrate(render(table_top(), small_camera(), around(n)).view(true), around(n), 1);
}

TEST(Decay, EveryWeightFallsAsTheReferenceSaysAndHalvesInItsTime) {
  rt::Startup startup;
  constexpr double kHalf_s = 3, kDt = 0.0125;
  TsdfMap map(startup.token(), decaying(kHalf_s));
  observe(map, 6);
  struct Node {
    int i, j, k;
    std::uint32_t word;
  };
  std::vector<Node> before;
  for (int i = -40; i < 40; ++i)
    for (int j = -40; j < 40; ++j)
      for (int k = -40; k < 40; ++k)
        if (map.word_at(i, j, k) != 0) before.push_back({i, j, k, map.word_at(i, j, k)});
  ASSERT_GT(before.size(), 10000U);
  constexpr int kRounds = 8;  // of 0.4 s
  // Pool parts move when blocks go; none goes so soon, so each block is met once a round.
  for (int n = 0; n < kRounds * TsdfMap::kDecayRound; ++n) map.decay(kDt);
  const auto keep =
      static_cast<std::uint64_t>(65536.0 * std::exp2(-kDt * TsdfMap::kDecayRound / kHalf_s));
  double worst = 0;
  for (const Node& n : before) {
    std::uint64_t weight = n.word >> 16U;
    for (int r = 0; r < kRounds; ++r) weight = weight * keep / 65536;
    const std::uint32_t now = map.word_at(n.i, n.j, n.k);
    ASSERT_EQ(TsdfMap::word_weight(now), weight < 32 ? 0 : weight);
    if (weight >= 32) {
      ASSERT_EQ(TsdfMap::word_distance(now), TsdfMap::word_distance(n.word));
    }
    const double exact =
        (n.word >> 16U) * std::exp2(-kRounds * kDt * TsdfMap::kDecayRound / kHalf_s);
    worst = std::max(worst, std::fabs(static_cast<double>(weight) - exact) / exact);
  }
  std::printf("  against the exponential: %.1f %% at most\n", 100 * worst);
  EXPECT_LT(worst, 0.09);  // rounded down 8 times, from 128 and more
}

TEST(Decay, WhatIsNotSeenAgainIsUnknownInTheEndAndFreeSpaceStays) {
  rt::Startup startup;
  TsdfMap map(startup.token(), decaying(1));
  observe(map, 6);
  const int blocks = map.block_count();
  std::vector<std::array<int, 3>> free;
  for (int i = -40; i < 40; i += 2)
    for (int j = -40; j < 40; j += 2)
      for (int k = -40; k < 40; k += 2)
        if (map.word_at(i, j, k) == 0 && map.free_at(i, j, k)) free.push_back({i, j, k});
  ASSERT_GT(free.size(), 500U);
  for (int n = 0; n < 600; ++n) map.decay(0.05);  // 30 s
  EXPECT_GT(blocks, 100);
  EXPECT_EQ(map.block_count(), 0);
  int kept = 0;
  for (const auto& [i, j, k] : free) kept += map.free_at(i, j, k);
  // A block that goes keeps its free bits for cells of 2^3 nodes that are free as a whole.
  EXPECT_GT(kept, static_cast<int>(free.size()) / 2);
}

TEST(Decay, WhatIsSeenStaysAndOffMeansOff) {
  rt::Startup startup;
  TsdfMap map(startup.token(), decaying(1)), off(startup.token(), decaying(0));
  for (int n = 0; n < 120; ++n) {
    const Pose X = around(0);
    static const Frame f = render(table_top(), small_camera(), X);
    for (TsdfMap* m : {&map, &off}) {
      m->decay(1.0 / 30);
      m->integrate(f.view(), X, 1);
    }
  }
  EXPECT_EQ(map.block_count(), off.block_count());
  int observed = 0, same = 0;
  for (int i = -40; i < 40; ++i)
    for (int j = -40; j < 40; ++j)
      for (int k = -40; k < 40; ++k) {
        const bool a = off.seen_at(i, j, k) == Seen::kBand, b = map.seen_at(i, j, k) == Seen::kBand;
        observed += a, same += a && b;
      }
  EXPECT_GT(observed, 1000);
  EXPECT_EQ(same, observed) << "half of the weight a second, thirty observations";
  const auto before = off.checksum();
  for (int n = 0; n < 64; ++n) off.decay(1);
  EXPECT_EQ(off.checksum(), before);
}

}  // namespace
}  // namespace tests
