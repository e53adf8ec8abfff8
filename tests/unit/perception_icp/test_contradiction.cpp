// What speaks against a pose: against plain loops on random images, and a box that one side does
// not have.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <vector>

#include "perception/icp/contradiction.hpp"
#include "rt/memory/section.hpp"
#include "rt/random.hpp"
#include "tests/support/analytic_scene.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace perception {
namespace {

const Intrinsics kCamera{46, 46, 31.5, 26.0, 64, 53};

DepthLevel level_of(const std::vector<double>& depth_m, const Intrinsics& k) {
  DepthLevel level;
  level.intrinsics = k;
  level.depth = PaddedImage(k.width, k.height);
  level.depth.reshape(k.width, k.height);
  for (int v = 0; v < k.height; ++v)
    for (int u = 0; u < k.width; ++u)
      level.depth.row(v)[u] =
          static_cast<float>(depth_m[static_cast<std::size_t>(v * k.width + u)]);
  return level;
}

std::vector<double> depths_of(const std::vector<float>& records) {
  std::vector<double> z;
  for (std::size_t i = 3; i < records.size(); i += 4) z.push_back(static_cast<double>(records[i]));
  return z;
}

// As the header says it: which points of `a` lie in front of `b`, and how many of them in patches.
void reference(const std::vector<double>& a, const Intrinsics& ka, const std::vector<double>& b,
               const Intrinsics& kb, const Pose& X_BA, const ClashRule& rule, Clash& sum) {
  std::vector<std::vector<bool>> front(static_cast<std::size_t>(ka.height + 2),
                                       std::vector<bool>(static_cast<std::size_t>(ka.width + 2)));
  const auto mark = [&](int u, int v) {
    return front[static_cast<std::size_t>(v + 1)][static_cast<std::size_t>(u + 1)];
  };
  for (int v = 0; v < ka.height; ++v) {
    for (int u = 0; u < ka.width; ++u) {
      const double z = a[static_cast<std::size_t>(v * ka.width + u)];
      if (z <= 0) continue;
      const Vec3 q = X_BA * ka.unproject(u, v, z);
      if (q.z() <= 0.05) continue;
      const double x = std::floor(kb.fx * q.x() / q.z() + kb.cx + 0.5);
      const double y = std::floor(kb.fy * q.y() / q.z() + kb.cy + 0.5);
      if (x < 1 || y < 1 || x > kb.width - 2 || y > kb.height - 2) continue;
      std::vector<double> about;
      for (int dy = -1; dy <= 1; ++dy) {
        for (int dx = -1; dx <= 1; ++dx) {
          const double d = b[static_cast<std::size_t>((static_cast<int>(y) + dy) * kb.width +
                                                      static_cast<int>(x) + dx)];
          if (d > 0) about.push_back(d);
        }
      }
      if (about.size() < 5) continue;
      ++sum.met;
      const double nearest = *std::min_element(about.begin(), about.end());
      front[static_cast<std::size_t>(v + 1)][static_cast<std::size_t>(u + 1)] =
          nearest - q.z() > rule.limit_m + rule.limit_per_m * q.z();
    }
  }
  for (int v = 0; v < ka.height; ++v) {
    for (int u = 0; u < ka.width; ++u) {
      int about = 0;
      for (int k = 0; k < 9; ++k) about += k != 4 && mark(u + k % 3 - 1, v + k / 3 - 1) ? 1 : 0;
      sum.against += mark(u, v) && about >= 5 ? 1 : 0;
    }
  }
}

// A wall with hills a few pixels wide, and holes.
std::vector<float> random_records(rt::Random& random, const Intrinsics& k, double holes) {
  std::vector<float> m(static_cast<std::size_t>(k.width * k.height) * 4, 0.0F);
  const double period = 4 + 8 * random.uniform(), height = 0.5 * random.uniform();
  const double phase = 6 * random.uniform();
  for (int v = 0; v < k.height; ++v) {
    for (int u = 0; u < k.width; ++u) {
      if (random.uniform() < holes) continue;
      const double z = 2 + height * std::sin(u / period + phase) * std::sin(v / period);
      m[static_cast<std::size_t>(v * k.width + u) * 4 + 3] = static_cast<float>(z);
    }
  }
  return m;
}

TEST(Clash, EqualsPlainLoops) {
  int patches = 0;
  for (std::uint64_t seed = 1; seed <= 40; ++seed) {
    rt::Random random(seed);
    const Intrinsics other{38, 40, 24.0, 22.0, 50, 46};
    const auto live = depths_of(random_records(random, kCamera, seed % 4 == 0 ? 0.5 : 0.05));
    const auto records = random_records(random, other, 0.1);
    const ModelView model{records.data(), other, Pose::Identity()};
    const Pose X_FC = tests::random_motion(random, 0.3, 0.2);
    const DepthLevel level = level_of(live, kCamera);
    rt_guard::reset();
    Clash got;
    {
      rt::Section section;
      got = clash(level, model, X_FC);
    }
    EXPECT_EQ(rt_guard::counts().total(), 0U);
    Clash want;
    // The product reads floats, so the reference does.
    std::vector<double> rounded;
    for (const double z : live) rounded.push_back(static_cast<double>(static_cast<float>(z)));
    reference(rounded, kCamera, depths_of(records), other, X_FC, {}, want);
    reference(depths_of(records), other, rounded, kCamera, X_FC.inverse(), {}, want);
    EXPECT_EQ(got.met, want.met) << "seed " << seed;
    EXPECT_EQ(got.against, want.against) << "seed " << seed;
    patches += got.against;
  }
  EXPECT_GT(patches, 1000) << "the random images must show some";
}

// A large model is thinned; nothing to compare says everything against.
TEST(Clash, LargeAndEmptyImages) {
  rt::Random random(7);
  const Intrinsics large{320, 320, 319.5, 239.5, 640, 480};
  const auto records = random_records(random, large, 0);
  const std::vector<double> none(static_cast<std::size_t>(kCamera.width * kCamera.height), 0.0);
  const ModelView model{records.data(), large, Pose::Identity()};
  EXPECT_EQ(clash(level_of(none, kCamera), model, Pose::Identity()).share(), 1.0);
  const std::vector<double> far(none.size(), 4.0);
  const Clash through = clash(level_of(far, kCamera), model, Pose::Identity());
  EXPECT_GT(through.share(), 0.7) << "all of the model is looked through";
  EXPECT_LE(through.against, ClashRule::kMostWidth * ClashRule::kMostHeight);
}

// Seen from up to 20 cm off where the map was cast: what is only hidden says nothing, a box too
// many does.
TEST(Clash, ABoxThatOneSideDoesNotHaveAndNothingElse) {
  double most_same = 0, least_other = 1;
  for (std::uint64_t seed = 1; seed <= 12; ++seed) {
    rt::Random random(seed);
    const tests::AnalyticScene room = tests::test_room();
    tests::AnalyticScene more = room;
    Pose X = Pose::Identity();
    X.translation() = Vec3(1.1 + 0.2 * random.uniform(), -0.2 * random.uniform(), 0.15);
    more.boxes.push_back({X, Vec3(0.12, 0.12, 0.15)});
    const Pose X_WF = tests::look_at(Vec3(-0.2, 0.1, 0.9), Vec3(1.8, 0, 0.3));
    const Pose X_WC = X_WF * tests::random_motion(random, 0.2, 0.15);
    const auto share = [&](const tests::AnalyticScene& map, const tests::AnalyticScene& seen) {
      const auto records = tests::cast_model(map, kCamera, X_WF);
      const DepthLevel live = level_of(tests::cast_depth(seen, kCamera, X_WC), kCamera);
      return clash(live, {records.data(), kCamera, X_WF}, X_WF.inverse() * X_WC).share();
    };
    most_same = std::max({most_same, share(room, room), share(more, more)});
    least_other = std::min({least_other, share(room, more), share(more, room)});
  }
  std::printf("  same scene at most %.4f, a box of 24 x 24 x 30 cm more or less at least %.4f\n",
              most_same, least_other);
  EXPECT_LE(most_same, 0.002);
  EXPECT_GE(least_other, 0.004);
}

}  // namespace
}  // namespace perception
