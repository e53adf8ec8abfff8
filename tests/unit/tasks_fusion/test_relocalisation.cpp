// A camera that was lost comes back to where it is, and to nowhere else.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <numbers>
#include <vector>

#include "rt/quantile.hpp"
#include "tests/unit/tasks_fusion/hall.hpp"

namespace tasks {
namespace {

using tests::add_box;
using tests::AnalyticScene;
using tests::coarse;
using tests::hall;
using tests::in_hall;
using tests::kDt;
using tests::kWrong_m;
using tests::off_m;
using tests::Rig;

void tour(Rig& rig, const AnalyticScene& scene) { tests::tour(rig, scene, 120, 0.1); }
Pose tour_start() { return in_hall(0); }

TEST(Relocalisation, AfterASecondOfDarknessElsewhere) {
  const AnalyticScene scene = hall();
  Rig rig(coarse(), tour_start());
  tour(rig, scene);
  std::printf("  %d keyframes, %.2f MiB\n", rig.task->keyframes().size(),
              static_cast<double>(rig.task->keyframes().memory_bytes()) / (1 << 20));
  EXPECT_LE(rig.task->keyframes().size(), 256);
  EXPECT_LE(rig.task->keyframes().memory_bytes(), std::size_t{8} << 20U);
  for (const double yaw : {0.4, 2.0, -1.5}) {
    const auto before = rig.task->map().checksum();
    for (int i = 0; i < 30; ++i) {
      rig.see(AnalyticScene{}, in_hall(yaw));
      EXPECT_FALSE(rig.out.camera.claimed);
    }
    EXPECT_EQ(rig.task->map().checksum(), before) << "nothing is fused in the dark";
    int took = 0;
    do {
      ++took;
      rig.see(scene, in_hall(yaw + 0.002 * took, 0.05), 0.0015);
    } while (!rig.out.camera.claimed && took < 15);
    EXPECT_TRUE(rig.out.camera.claimed) << "yaw " << yaw;
    EXPECT_GE(took, 2) << "two frames must agree";
    const double off = off_m(rig, in_hall(yaw + 0.002 * took, 0.05));
    std::printf(
        "  after 30 dark frames, turned to %.1f rad: claimed after %d frames, %.1f mm off\n", yaw,
        took, 1000 * off);
    EXPECT_LT(off, 0.02);
  }
}

struct Kidnaps {
  int asked = 0;
  std::uint64_t seed = 13;
  explicit Kidnaps(int by_default) : asked(by_default) {
    if (const char* n = std::getenv("TELETACT_KIDNAPS")) asked = std::atoi(n);
    if (const char* n = std::getenv("TELETACT_KIDNAP_SEED")) seed = std::strtoull(n, nullptr, 10);
    std::printf("  seed %llu (TELETACT_KIDNAP_SEED), %d kidnaps (TELETACT_KIDNAPS)\n",
                static_cast<unsigned long long>(seed), asked);
  }
};

struct Returns {
  int found = 0, wrong = 0, near = 0, near_found = 0;
  std::vector<bool> claimed;  // of each kidnap
};

// Kidnapped again and again, to places seen from near by and to places never seen. `there(k,
// X_WC)`: what the camera of kidnap k then sees.
template <typename There>
Returns kidnap(Rig& rig, const Kidnaps& kidnaps, There&& there) {
  rt::Random random(kidnaps.seed);
  Returns r;
  int slowest = 0;
  double worst = 0;
  for (int k = 0; k < kidnaps.asked; ++k) {
    const bool familiar = k % 2 == 0;
    const double yaw = 2 * std::numbers::pi * random.uniform();
    const double reach = familiar ? 0.25 : 1.2;
    const double x = reach * (2 * random.uniform() - 1), y = reach * (2 * random.uniform() - 1);
    const double pitch =
        familiar ? -0.35 + 0.1 * (random.uniform() - 0.5) : -0.6 * random.uniform();
    r.near += familiar ? 1 : 0;
    int took = 0;
    bool claimed = false;
    for (int i = 0; i < 15 && !claimed; ++i) {
      const Pose X_WC = in_hall(yaw + 0.003 * i, x + 0.002 * i, y, pitch);
      rig.see(there(k, X_WC), X_WC, 0.0015);
      ++took;
      if (!rig.out.camera.claimed) continue;
      claimed = true;
      const double off = off_m(rig, X_WC);
      worst = std::max(worst, off);
      const auto& t = rig.out.tracking;
      std::printf(
          "  kidnap %d, %s: %.1f mm off, share %.2f overlap %.2f residual %.1f mm against %.4f "
          "clash %.4f condition %.0f after %d frames\n",
          k, familiar ? "seen before" : "elsewhere", 1000 * off, t.inlier_share, t.overlap,
          1000 * t.residual_m, t.contradiction, t.clash, t.condition, took);
      r.wrong += off > kWrong_m ? 1 : 0;
    }
    r.claimed.push_back(claimed);
    r.found += claimed ? 1 : 0;
    r.near_found += claimed && familiar ? 1 : 0;
    slowest = std::max(slowest, claimed ? took : 0);
  }
  std::printf(
      "  found %d of %d (of %d near the way: %d), slowest %d frames, worst %.1f mm, wrong %d\n",
      r.found, kidnaps.asked, r.near, r.near_found, slowest, 1000 * worst, r.wrong);
  return r;
}

TEST(Relocalisation, NeverToTheWrongPlace) {
  const Kidnaps kidnaps(100);
  const AnalyticScene scene = hall();
  Rig rig(coarse(), tour_start());
  tour(rig, scene);
  const Returns r = kidnap(
      rig, kidnaps, [&](int, const Pose&) -> const auto& { return scene; });
  EXPECT_EQ(r.wrong, 0);
  EXPECT_GE(r.near_found, r.near * 9 / 10);
}

// Somebody, as a box.
AnalyticScene with_somebody(AnalyticScene s, double x, double y, double yaw) {
  add_box(s, Vec3(x, y, 0.85), Vec3(0.45, 0.3, 1.7), yaw);
  return s;
}

// Keyframes that show what is not the place: nearer than the place by a tenth in a twentieth of
// their cells and more.
int keyframes_that_hold_somebody(const Rig& rig, const AnalyticScene& place) {
  using perception::Thumbnail;
  const auto& kept = rig.task->keyframes();
  const auto& k = rig.setup.camera;
  int hold = 0;
  for (int i = 0; i < kept.size(); ++i) {
    const auto& e = kept.at(i);
    int cells = 0;
    for (int v = 0; v < Thumbnail::kHeight; ++v)
      for (int u = 0; u < Thumbnail::kWidth; ++u) {
        const auto code = e.view.depth[static_cast<std::size_t>(v * Thumbnail::kWidth + u)];
        const Vec3 d = e.X_WC.linear() *
                       k.unproject(perception::cell_to_pixel(u, Thumbnail::kWidth, k.width),
                                   perception::cell_to_pixel(v, Thumbnail::kHeight, k.height), 1.0);
        cells += code != 0 &&
                 perception::thumbnail_depth(code) < 0.9 * place.cast(e.X_WC.translation(), d).t;
      }
    hold += cells * 20 >= Thumbnail::kCells;
  }
  return hold;
}

// What is kept of the place was taken with people in it, who are gone or stand elsewhere when the
// camera comes back. First two stand, in the map too; then one walks before the camera as it turns.
// With seed 15 the first kidnap is wrong: half a turn in the hall, and somebody hides the boxes in
// which its halves differ. That image is the one of standing still (docs/fusion.md).
TEST(Relocalisation, NeverToTheWrongPlaceByViewsWithPeopleInThem) {
  const Kidnaps kidnaps(25);
  const AnalyticScene scene = hall();
  for (const bool walks : {false, true}) {
    SCOPED_TRACE(walks ? "walks" : "stand");
    const int frames = walks ? 240 : 120;
    Rig rig(coarse(), tour_start());
    int claimed = 0;
    for (int i = 0; i < frames; ++i) {
      const double a = 2 * std::numbers::pi * i / frames;
      AnalyticScene seen = scene;
      if (walks) {  // 1.1 m/s; comes into view after a second, and to and fro in it
        const double b = a + (i < 60 ? 1.0 - 0.0125 * i : 0.25 * std::cos(0.05 * (i - 60)));
        seen = with_somebody(seen, 1.4 * std::cos(b), 1.4 * std::sin(b), b);
      } else {
        for (const double b : {0.9, 4.0})
          seen = with_somebody(seen, 1.5 * std::cos(b), 1.5 * std::sin(b), b);
      }
      rig.see(seen, in_hall(a, 0.1 * std::sin(a), 0.1 * (1 - std::cos(a))), 0.0015);
      claimed += rig.out.camera.claimed;
    }
    const int hold = keyframes_that_hold_somebody(rig, scene);
    std::printf("  %s: %d of %d frames claimed, %d of %d keyframes hold somebody\n",
                walks ? "one walks" : "two stand", claimed, frames, hold,
                rig.task->keyframes().size());
    const Returns r = kidnap(rig, kidnaps, [&](int k, const Pose& X_WC) {
      if (k % 3 != 0) return scene;
      const Vec3 p = X_WC * Vec3(k % 2 == 0 ? 0.3 : -0.3, 0, 1.4);
      return with_somebody(scene, p.x(), p.y(), 0.7 * k);
    });
    // Found again: of those who came back alone to where they had been. With somebody before the
    // camera it mostly stays lost, and where two stood and are gone the map speaks against every
    // other view.
    int alone = 0, alone_found = 0;
    for (std::size_t k = 0; k < r.claimed.size(); k += 2) {
      alone += k % 3 != 0;
      alone_found += k % 3 != 0 && r.claimed[k];
    }
    std::printf("  alone and near the way: %d of %d\n", alone_found, alone);
    EXPECT_EQ(claimed, frames) << "the tour itself is not lost";
    EXPECT_GE(hold, walks ? 1 : 8) << "or nobody was kept";
    EXPECT_EQ(r.wrong, 0);
    EXPECT_GE(alone_found, walks ? alone * 2 / 3 : alone / 4);
  }
}

// The same in both corners but for one box; it is not seen when looking this way, nor from where
// the other half looks the same.
AnalyticScene nearly_turned_hall() {
  AnalyticScene s = hall();
  s.boxes.resize(7);  // the two groups, and the box of one of them
  add_box(s, Vec3(0.6, -1.5, 0.3), Vec3(0.5, 0.3, 0.6), 0.7);
  add_box(s, Vec3(-0.6, 1.5, 0.3), Vec3(0.5, 0.3, 0.6), 0.7);
  return s;
}
constexpr double kAlike = -0.42;

TEST(Relocalisation, StaysLostWhileTwoPlacesLookTheSame) {
  const AnalyticScene scene = nearly_turned_hall();
  Rig rig(coarse(), tour_start());
  tour(rig, scene);
  for (int i = 0; i < 5; ++i) rig.see(AnalyticScene{}, in_hall(0));
  const auto before = rig.task->map().checksum();
  double yaw = kAlike;
  for (int i = 0; i < 20; ++i) {
    rig.see(scene, in_hall(yaw, 0.04, 0.01), 0.0015);
    EXPECT_FALSE(rig.out.camera.claimed) << "frame " << i;
  }
  EXPECT_EQ(rig.task->map().checksum(), before);
  int took = 0;
  do {
    ++took;
    rig.see(scene, in_hall(yaw += 0.03, 0.04, 0.01), 0.0015);
  } while (!rig.out.camera.claimed && took < 30);
  std::printf("  claimed %.0f degrees on, %.1f mm off\n", 180 / std::numbers::pi * (yaw - kAlike),
              1000 * off_m(rig, in_hall(yaw, 0.04, 0.01)));
  EXPECT_TRUE(rig.out.camera.claimed) << "the box has come into view";
  EXPECT_LT(off_m(rig, in_hall(yaw, 0.04, 0.01)), 0.02);
}

// From one half to where the other looks the same, a few degrees and centimetres on.
TEST(Relocalisation, ALeapToAPlaceThatLooksTheSameIsNotTracked) {
  const AnalyticScene scene = nearly_turned_hall();
  for (const bool doubted : {true, false}) {
    FusionConfig config = coarse();
    // What moves is not looked for either: a leap by which half of the image moves is not claimed.
    if (!doubted)
      config.leap_translation_m = 10, config.leap_rotation_deg = 180, config.motion.on = false;
    Rig rig(config, tour_start());
    tour(rig, scene);
    for (int i = 1; i <= 20; ++i) {
      rig.see(scene, in_hall(kAlike * i / 20, 0.002 * i, 0.0005 * i), 0.0015);
      ASSERT_TRUE(rig.out.camera.claimed) << "frame " << i;
    }
    const Pose there = in_hall(std::numbers::pi + kAlike + 0.1, 0.0, -0.01);
    rig.see(scene, there, 0.0015);
    EXPECT_NE(rig.out.camera.claimed, doubted) << "without the rule it is claimed, and wrong";
    if (!doubted) {
      EXPECT_GT(
          perception::rotation_angle(rig.out.camera.X_WC.linear().transpose() * there.linear()),
          2.5);
      continue;
    }
    for (int i = 0; i < 15; ++i) {
      rig.see(scene, there, 0.0015);
      if (rig.out.camera.claimed) {
        EXPECT_LT(off_m(rig, there), 0.02) << "frame " << i;
      }
    }
  }
}

}  // namespace
}  // namespace tasks
