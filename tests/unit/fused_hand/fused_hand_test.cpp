// A hand on a face of a fused map that starts to move, and how far a fused face lags behind one
// that moves slowly.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

#include "tests/support/whole.hpp"
#include "tests/unit/fused_hand/place.hpp"

namespace {

using fused_hand::face_frame;
using fused_hand::Place;
using fused_hand::Pose;
using fused_hand::Setting;
using fused_hand::SurfacePatch;
using fused_hand::Vec3;
using rig::Rig;
using rig::Row;
using Kind = tasks::TouchEvent::Kind;

constexpr double kDepth_m = 0.008;
constexpr double kOff_m = 0.03, kTouch_s = 1.0,
                 kDown_s = 0.3;  // the hand waits off the face, then goes down

struct Told {
  double event_s = -1, released_s = -1, before_N = 0, j_N = 0, most_N = 0, booked_J = 0, end_N = 0;
  int events = 0, ends = 0, not_finite = 0;
};

// Where the hand is, in S: before the face, down to kDepth_m in it, and there it stays.
Vec3 hand_at(double t) {
  const double s = std::clamp((t - kTouch_s) / kDown_s, 0.0, 1.0);
  return {0, 0, kOff_m - s * (kOff_m + kDepth_m)};
}

Told touch(const Setting& setting) {
  Place place(setting);
  rig::Scene scene;
  scene.X_WS = face_frame();
  scene.voxel = setting.voxel_m;
  Rig* hand = nullptr;
  auto last = std::make_unique<SurfacePatch>();
  scene.window = [&](const Vec3&, int, double t, SurfacePatch& out) {
    while (Place::time_of(place.frames()) <= t + 1e-9) place.see(hand->out().state, *last);
    out = *last;
  };
  Rig r(std::move(scene));
  hand = &r;
  Told told;
  const double start_s = Place::time_of(setting.first);
  double last_N = 0, booked_before_J = -1;
  for (double t = 0; t < start_s + 0.7; t += 1e-3) {
    const Row row = r.tick(hand_at(t));
    const double f = row.f.norm();
    told.not_finite += row.f.allFinite() ? 0 : 1;
    if (row.t < start_s) {
      told.before_N = f;
      booked_before_J = row.telemetry.booked_J;
    } else {
      told.j_N = std::max(told.j_N, std::abs(f - last_N));
      told.most_N = std::max(told.most_N, f);
      told.booked_J = std::max(told.booked_J, row.telemetry.booked_J - booked_before_J);
      for (int e = 0; e < r.out().event_count; ++e) {
        const Kind kind = r.out().events[static_cast<std::size_t>(e)].kind;
        if (kind == Kind::kSurfaceLeft && told.events++ == 0) told.event_s = row.t - start_s;
        told.ends += kind == Kind::kContactEnd ? 1 : 0;
      }
      if (told.released_s < 0 && f < 1e-9) told.released_s = row.t - start_s;
    }
    last_N = told.end_N = f;
  }
  std::printf(
      "%2.0f mm voxels, camera %s, %+4.0f %+4.0f mm a frame: %.2f N before, told after %.0f ms, "
      "let go "
      "after %.0f, most %.2f N, step %.3f N, booked %.2f mJ, %d events, %d ends, %.2f N at the "
      "end; %d of %d "
      "images claimed, worst %.1f mm\n",
      1e3 * setting.voxel_m, setting.carried ? "carried" : "stands ", 1e3 * setting.step_m.x(),
      1e3 * setting.step_m.y(), told.before_N, 1e3 * told.event_s, 1e3 * told.released_s,
      told.most_N, told.j_N, 1e3 * told.booked_J, told.events, told.ends, told.end_N,
      place.claimed(), place.frames(), 1e3 * place.worst_pose_m());
  return told;
}

void expect_gentle(const Told& t) {
  EXPECT_NEAR(t.before_N, 8, 0.5);
  EXPECT_LE(t.events, 1);
  EXPECT_LE(t.ends, 1);
  EXPECT_EQ(t.not_finite, 0);
  EXPECT_LE(t.j_N, 0.3 + 1e-9);  // 300 N/s: the hand stands
  EXPECT_LE(t.booked_J, 0.05);
  EXPECT_LE(t.most_N, t.before_N + 0.02);  // it is not pushed harder on its way
}

void expect_let_go(const Told& t, double within_s) {
  expect_gentle(t);
  EXPECT_EQ(t.events, 1);
  EXPECT_EQ(t.ends, 1);
  EXPECT_GE(t.event_s, 0);
  EXPECT_GT(t.released_s, 0);
  EXPECT_LE(t.released_s, within_s);
  EXPECT_EQ(t.end_N, 0);  // and not taken again from within
}

Setting setting(double voxel_m, bool carried, const Vec3& step_mm) {
  Setting s;
  s.voxel_m = voxel_m, s.carried = carried, s.step_m = 1e-3 * step_mm;
  return s;
}

TEST(FusedHand, AFaceThatStartsToMoveLetsTheHandGo) {
  std::vector<Setting> settings;
  for (const double voxel : {0.02, 0.01})
    for (const bool carried : {false, true})
      for (const double mm : {10.0, 50.0, 100.0})
        for (const double side : {1.0, -1.0})
          settings.push_back(setting(voxel, carried, {side * mm, 0, 0}));
  // Each value of each of the four.
  for (const Setting& s : tests::whole_or(settings, {1, 8, 10, 14, 19, 23}))
    expect_let_go(touch(s), 0.1);
}

// Along itself: its middle looks as before, only its rims tell, two images later. At 10 mm a frame
// the map follows instead, and the face is there to be touched: no limit on when it is told.
TEST(FusedHand, AFaceThatSlidesAlongItselfLetsTheHandGoTwoImagesLater) {
  for (const double voxel : {0.02, 0.01})
    for (const double mm : {10.0, 50.0, -100.0}) {
      const Told t = touch(setting(voxel, true, {0, mm, 0}));
      expect_gentle(t);
      if (std::abs(mm) >= 50) expect_let_go(t, 0.15);
    }
}

// What passes far before the face hides it and does not take it from the hand; close before it, it
// does.
TEST(FusedHand, SomebodyWhoPassesBeforeItDoesNot) {
  for (const double voxel : {0.02, 0.01}) {
    Setting s = setting(voxel, true, Vec3::Zero());
    s.passer_m = 0.5;
    const Told far = touch(s);
    expect_gentle(far);
    EXPECT_EQ(far.events, 0);
    EXPECT_EQ(far.ends, 0);
    EXPECT_NEAR(far.end_N, 8, 0.5);
    s.passer_m = 0.15;
    const Told near = touch(s);
    expect_gentle(near);
    EXPECT_EQ(near.events, 1);
  }
}

// Where the newest window has the face, along the box's normal through its middle, m from where it
// began; NaN: nowhere.
double face_at(const SurfacePatch& patch, const Vec3& about_W) {
  tasks::Field field;
  field.set(nullptr, &patch, 1);
  double before = -1;
  for (double d = -0.06; d < 0.06; d += 0.0005) {
    const auto s = field.sample(about_W + Vec3(d, 0, 0));
    if (!s.known) continue;
    if (before > 0 && s.value <= 0) return d - 0.0005 * s.value / (s.value - before);
    before = s.value;
  }
  return std::nan("");
}

struct Lag {
  double still_mm = 0, most_mm = 0, last_mm = 0;  // before it moves, then, and in the last image
  int told = 0;                                   // images that say that it moves
  bool claimed = false;                           // all of them
};

Lag lag_of(Setting s) {
  s.way_m = std::min(0.09, 40 * s.step_m.norm());
  s.first = 40;
  Place place(s);
  const auto patch = std::make_unique<SurfacePatch>();
  tasks::HapticState hand;
  Lag out;
  for (int i = 0; i < s.first + 60; ++i) {
    const Vec3 face = fused_hand::kFace_W + place.moved(i);
    hand.seq = static_cast<std::uint64_t>(i) + 1;
    hand.contacts = i > 30 ? 1 : 0;
    hand.p_WP = face;
    hand.p_WH = face + Vec3(kDepth_m, 0, 0);
    place.see(hand, *patch);
    out.told += patch->touched_moves ? 1 : 0;
    out.last_mm = 1e3 * std::abs(face_at(*patch, face));
    double& most = i < s.first ? out.still_mm : out.most_mm;
    if (i >= 20 && !(out.last_mm <= most)) most = out.last_mm;
  }
  out.claimed = place.claimed() == place.frames();
  std::printf(
      "%2.0f mm voxels, camera %s, %+4.0f mm/s: at rest %.2f mm off, then %.2f at most, %.2f at "
      "last; "
      "told to move %d times; %d of %d images claimed, camera %.1f mm off at most\n",
      1e3 * s.voxel_m, s.carried ? "carried" : "stands ", 30e3 * s.step_m.x(), out.still_mm,
      out.most_mm, out.last_mm, out.told, place.claimed(), place.frames(),
      1e3 * place.worst_pose_m());
  return out;
}

// The whole way of a window, with a camera that is tracked and goes by hand: lag as for a map alone
// (tests/unit/perception_tsdf/test_follow.cpp), here with what tracking adds.
TEST(FusedHand, ASlowFaceIsFollowedByACameraThatIsTracked) {
  double side = 1;
  int n = 0;
  for (const double voxel : {0.02, 0.01})
    for (const bool carried : {false, true})
      for (const double mm_s : {3.0, 10.0, 30.0, 50.0, 100.0}) {
        side = -side;
        if (!tests::whole() && n++ % 3 != 0) continue;  // each value of each of the three
        const Lag lag = lag_of(setting(voxel, carried, {side * mm_s / 30, 0, 0}));
        EXPECT_LE(lag.still_mm, 1.5);
        // Missed below 30 mm/s, and bounded here: what creeps carries the camera by up to 3.8 mm
        // before it is seen to.
        EXPECT_LE(lag.most_mm, mm_s < 30 ? 4.0 : 3 * mm_s / 30 + 1.5);
        EXPECT_LE(lag.last_mm, 3.5);
        EXPECT_EQ(lag.told, 0) << "it is followed, not let go";
        EXPECT_TRUE(lag.claimed);
      }
}

}  // namespace
