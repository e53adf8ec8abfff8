// A hand on the recorded kitchen, for some seconds; `teletact bench haptic --rgbd DIR` does it for sixty.
#include "tools/haptic/recording_touch.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <iostream>

namespace {

TEST(RecordingTouch, HoldsForSomeSeconds) {
  teletact::RecordingTouchOptions o;
  o.rgbd = std::string(TELETACT_SOURCE_DIR) + "/../shared/data/rgbd/7scenes_redkitchen";
  if (!std::filesystem::exists(o.rgbd + "/depth.txt")) GTEST_SKIP() << "no recording at " << o.rgbd;
  o.seconds = 6;
  o.beside = false;
  const auto r = teletact::touch_recording(std::cout, o);
  r.print(std::cout);
  const auto& path = r.paths.front();
  const auto& row = path.rows.front();
  EXPECT_EQ(r.frames_played, 180);
  EXPECT_GT(r.integrated, 150);
  EXPECT_LE(path.hand_speed_max_m_per_s, 0.2 + 1e-9);
  EXPECT_GT(row.contact, 2000U);
  EXPECT_LE(row.jump_share(), 0.01);
  EXPECT_LE(row.longest_jump, 2U);
  EXPECT_EQ(row.not_finite, 0U);
  EXPECT_EQ(row.sunk + row.flipped, 0U);
}

}  // namespace
