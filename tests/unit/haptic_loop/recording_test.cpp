// A hand on the recorded kitchen, for some seconds, from the corner of a box on; `teletact bench
// haptic --rgbd DIR` does it for sixty over five places.
#include "tests/support/paths.hpp"
#include "tools/measure/haptic/recording_touch.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <iostream>

namespace {

TEST(RecordingTouch, HoldsForSomeSeconds) {
  teletact::RecordingTouchOptions o;
  o.rgbd = tests::in_tree("../shared/data/rgbd/7scenes_redkitchen");
  if (!std::filesystem::exists(o.rgbd + "/depth.txt")) GTEST_SKIP() << "no recording at " << o.rgbd;
  o.seconds = 6;
  o.from_end = true;  // where the boxes are
  o.paths = 2;
  o.pool = 60;
  o.first = teletact::Place::Kind::kCorner;
  o.beside = false;
  const auto r = teletact::touch_recording(std::cout, o);
  r.print(std::cout);
  EXPECT_EQ(r.frames_played, 180);
  EXPECT_GT(r.integrated, 150);
  ASSERT_EQ(r.paths.size(), 2U);
  for (const auto& path : r.paths) {
    SCOPED_TRACE("seed " + std::to_string(path.seed));
    const auto& row = path.rows.front();
    EXPECT_LE(path.hand_speed_max_m_per_s, 0.2 + 1e-9);
    EXPECT_EQ(path.places.size(), 5U);
    EXPECT_EQ(path.places.front().kind, teletact::Place::Kind::kCorner);
    EXPECT_GT(row.places.front().contact_s, 1.0);
    EXPECT_EQ(row.places.back().contact_s, 0.0) << "on the ways it touches nothing";
    EXPECT_GT(row.contact, 2000U);
    EXPECT_LE(row.jump_share(), 0.01);
    EXPECT_LE(row.longest_jump, 2U);
    EXPECT_EQ(row.not_finite, 0U);
    EXPECT_EQ(row.sunk + row.flipped, 0U);
  }
}

}  // namespace
