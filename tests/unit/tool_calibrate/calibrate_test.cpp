// Calibration on stored input: the same input and the same work each time; which cached file is
// taken, and why not.
#include "tools/host/calibrate.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>

namespace {

namespace fs = std::filesystem;
using tasks::Calibration;
using testing::HasSubstr;

rt::NonRealtime& nrt() {
  static rt::Startup startup;
  return startup.token();
}

// One voxel, so that there are few passes.
std::unique_ptr<teletact::Scene> scene(const std::vector<std::string>& more = {}) {
  std::vector<std::string> set{"fusion.tsdf.voxel_size_m=0.02"};
  set.insert(set.end(), more.begin(), more.end());
  return teletact::load_scene(teletact::find_config("scenes", "empty_room"), set);
}

struct Measured {
  Calibration calibration;
  teletact::CalibrationInput input;
};
const Measured& measured() {
  static const Measured m = [] {
    Measured out;
    const auto s = scene();
    out.calibration = teletact::calibrate(nrt(), *s, 2, true, &out.input);
    return out;
  }();
  return m;
}

TEST(Calibrate, EveryVariantHasARowPlanningToo) {
  const auto& c = measured().calibration;
  const auto s = scene();
  EXPECT_EQ(
      c.lacks(teletact::calibration_origin(*s), tasks::make_specs(c, teletact::choice_limits(*s))),
      "");
  EXPECT_EQ(c.rows.size(), 12U);  // 8 tasks; fusion has 3 levels, planning and capture 2
  EXPECT_EQ(measured().input.passes, 6U);
  for (const auto& r : c.rows) EXPECT_GT(r.p50_us, 0) << r.name;
  ASSERT_NE(c.find("planning", "", 1), nullptr);
  EXPECT_EQ(c.find("planning", "", 1)->budget().count(), 5'000'000) << "the declared one";
}

// What both ends of the link take goes with what they decode.
TEST(Calibrate, TellsWhatTheLinkTakesWithTheScenesCodecs) {
  const Calibration& plain = measured().calibration;
  EXPECT_GT(plain.link_share, 0.005);
  EXPECT_LT(plain.link_share, 1);
  const auto coded = scene({"link.depth_codec=\"moving\"", "link.colour_codec=\"jpeg\""});
  const Calibration c = teletact::with_link(nrt(), *coded, 2, plain);
  // Others' load only adds to a share: of two runs of either the one that had less of it.
  const double once_more = teletact::with_link(nrt(), *coded, 2, plain).link_share;
  const double plain_again = teletact::with_link(nrt(), *scene(), 2, plain).link_share;
  EXPECT_GT(std::min(c.link_share, once_more), 1.15 * std::min(plain.link_share, plain_again));
  EXPECT_EQ(c.rows.size(), plain.rows.size());
  EXPECT_EQ(c.camera_twin_share, plain.camera_twin_share);
  EXPECT_GT(c.find("capture", "", 0)->p50_us, plain.find("capture", "", 0)->p50_us + 1000);
  const auto s = scene();
  EXPECT_EQ(teletact::declared_link_share(*s, plain), tasks::declared_link_share(plain));
  EXPECT_EQ(teletact::declared_link_share(*coded, c), tasks::declared_link_share(c));
  // Measured without, or with others: they come on top, also of what was made for this scene.
  Calibration other = c;
  other.pictures = "depth quiet, colour jpeg";
  EXPECT_GT(teletact::declared_link_share(*coded, other), tasks::declared_link_share(c) + 0.05);
  EXPECT_GT(teletact::declared_link_share(*coded, teletact::as_asked(plain, *coded)),
            tasks::declared_link_share(plain) + 0.05);
  EXPECT_GT(teletact::declared_link_share(*coded, plain), tasks::declared_link_share(plain) + 0.05);
  EXPECT_GT(teletact::declared_link_share(*coded, {}),
            teletact::declared_link_share(*s, {}) + 0.05);
}

TEST(Calibrate, TellsHowEachVariantTracks) {
  for (const auto& r : measured().calibration.rows) {
    if (r.name != "fusion") {
      EXPECT_LT(r.claimed_share, 0) << r.name;
      EXPECT_LT(r.moving_p999_us, 0) << r.name;
      continue;
    }
    // Empty: not lost, but nothing constrains the camera along its walls.
    EXPECT_EQ(r.tracked_share, 1) << r.level;
    EXPECT_LT(r.claimed_share, 0.1) << r.level;
    EXPECT_EQ(measured().calibration.does_not_track(r), "") << r.level;
  }
  const auto furnished = teletact::load_scene(teletact::find_config("scenes", "default_room"),
                                              {"fusion.tsdf.voxel_size_m=0.02"});
  teletact::CalibrationInput input;
  const Calibration c = teletact::calibrate(nrt(), *furnished, 2, true, &input);
  // Somebody walks through the last 40 % of 60 images, and fusion sees them move.
  EXPECT_GE(input.moving_images, 20U);
  EXPECT_LE(input.moving_images, 24U);
  EXPECT_GT(input.moving_share, 0.05);
  EXPECT_LT(input.moving_share, 0.5);
  for (int level = 0; level < 3; ++level) {
    const auto* r = c.find("fusion", "20 mm", level);
    ASSERT_NE(r, nullptr);
    EXPECT_GE(r->claimed_share, 0.98) << level;
    EXPECT_GT(r->still_p50_us, 0) << level;
    EXPECT_GE(r->still_p999_us, r->still_p50_us) << level;
    EXPECT_GT(r->moving_p50_us, 0) << level;
    EXPECT_GE(1e-3 * static_cast<double>(r->budget().count()) + 1e-3, 1.2 * r->moving_p999_us)
        << level;
    // Any image is one or the other.
    EXPECT_NEAR(std::max(r->still_p999_us, r->moving_p999_us), r->quantiles_us.back(),
                0.1 * r->quantiles_us.back())
        << level;
    EXPECT_GE(r->off_mm, 0) << level;
    EXPECT_LT(r->off_mm, 20) << level;
    EXPECT_EQ(c.does_not_track(*r), "") << level;
  }
}

// Limits that no frame meets.
TEST(Calibrate, WhatTracksNothingIsRuledOutInWords) {
  const auto s = scene({"fusion.tracker.lost_overlap=1"});
  const Calibration c = teletact::calibrate(nrt(), *s, 2, true);
  ASSERT_NE(c.find("fusion", "20 mm", 0), nullptr);
  EXPECT_LT(c.find("fusion", "20 mm", 0)->tracked_share, 0.1);
  const auto specs = tasks::make_specs(c, teletact::choice_limits(*s));
  const auto& fusion = specs[static_cast<std::size_t>(tasks::TaskId::kFusion)];
  ASSERT_EQ(fusion.choices.size(), 1U);
  EXPECT_THAT(fusion.choices[0].ruled_out, HasSubstr("of the stored images, 50 % are allowed"));
}

TEST(Calibrate, TheSameInputAndWorkEachTime) {
  const auto s = scene();
  teletact::CalibrationInput again;
  const Calibration c = teletact::calibrate(nrt(), *s, 2, true, &again);
  EXPECT_EQ(again.operator_hash, measured().input.operator_hash);
  EXPECT_EQ(again.robot_hash, measured().input.robot_hash);
  ASSERT_EQ(c.rows.size(), measured().calibration.rows.size());
  for (std::size_t i = 0; i < c.rows.size(); ++i) {
    EXPECT_EQ(c.rows[i].work_min, measured().calibration.rows[i].work_min) << c.rows[i].name;
    EXPECT_EQ(c.rows[i].work_max, measured().calibration.rows[i].work_max) << c.rows[i].name;
  }
}

TEST(Calibrate, TheScratchFolderIsGone) {
  (void)measured();
  for (const auto& e : fs::directory_iterator(fs::temp_directory_path()))
    EXPECT_EQ(e.path().filename().string().find("teletact-calibrate-" + std::to_string(getpid())),
              std::string::npos);
}

class Cache : public testing::Test {
 protected:
  Cache() {
    fs::create_directories(root_ / "teletact");
    ::setenv("XDG_CACHE_HOME", root_.c_str(), 1);
    options_.scene_path = "elsewhere/empty_room.toml";
    options_.quiet = true;
  }
  ~Cache() override {
    ::unsetenv("XDG_CACHE_HOME");
    fs::remove_all(root_);
  }
  [[nodiscard]] std::string file() const {
    return (root_ / "teletact/calibration-empty_room.toml").string();
  }
  fs::path root_ = fs::temp_directory_path() / ("teletact-cache-" + std::to_string(::getpid()));
  teletact::DemoOptions options_;
};

TEST_F(Cache, OneMadeHereIsTaken) {
  tasks::save_calibration(file(), measured().calibration);
  const auto s = scene();
  std::string text;
  const auto c = teletact::host_calibration(nrt(), *s, options_, text);
  EXPECT_EQ(text.find("measured just now"), std::string::npos);
  EXPECT_NEAR(c.rows[0].p50_us, measured().calibration.rows[0].p50_us, 1e-3);
}

TEST_F(Cache, AnotherConfigurationIsMeasuredAgainAndSaidWhy) {
  tasks::save_calibration(file(), measured().calibration);
  const auto s = scene({"haptic.scale=2.5"});
  std::string text;
  testing::internal::CaptureStdout();
  const auto c = teletact::host_calibration(nrt(), *s, options_, text);
  const std::string said = testing::internal::GetCapturedStdout();
  EXPECT_THAT(said, HasSubstr(file()));
  EXPECT_THAT(said, HasSubstr("another configuration"));
  EXPECT_EQ(std::count(said.begin(), said.end(), '\n'), 1) << said;
  EXPECT_THAT(text, HasSubstr("measured just now"));
  const auto stored = tasks::load_calibration(file());
  ASSERT_TRUE(stored) << stored.error();
  EXPECT_EQ(stored.value().config, teletact::calibration_origin(*s).config);
  EXPECT_NE(stored.value().config, measured().calibration.config);
}

TEST(Origin, FollowsValuesRecordingAndProgram) {
  const auto base = teletact::calibration_origin(*scene());
  EXPECT_EQ(teletact::calibration_origin(*scene()).config, base.config);
  EXPECT_NE(teletact::calibration_origin(*scene({"fusion.patch_nodes=48"})).config, base.config);
  const auto recorded = scene();
  recorded->rgbd_dir = "some/recording";
  EXPECT_THAT(teletact::calibration_origin(*recorded).recording, HasSubstr("some/recording"));
  EXPECT_EQ(base.recording, "");
  EXPECT_EQ(base.host, tasks::host_id());
  EXPECT_THAT(base.build, HasSubstr(", "));
}

// Where the robot's bus is costs no task more; how it is reached does.
TEST(Origin, DoesNotFollowWhereTheRobotsBusIs) {
  const auto of = [](const std::vector<std::string>& set) {
    return teletact::calibration_origin(*scene(set)).config;
  };
  const std::string kind = "robot.bus.kind=\"ethercat\"";
  const std::string eth1 = of({kind, "robot.bus.interface=\"eth1\""});
  EXPECT_EQ(of({kind, "robot.bus.interface=\"enp3s0\""}), eth1);
  EXPECT_EQ(of({kind, "robot.bus.interface=\"eth1\"", "robot.bus.chain=\"base+arm\"",
                "robot.bus.most_current_A=5", "robot.bus.arm_rest=\"free\"",
                "robot.bus.ignored_flags=64"}),
            eth1);
  EXPECT_NE(of({}), eth1);
  EXPECT_NE(of({kind, "robot.bus.interface=\"eth1\"", "haptic.scale=2.5"}), eth1);
}

// The file of a real robot, as docs/robot.md has it: [robot.bus] alone.
TEST_F(Cache, TheBoxOfARobotMeasuresWhatItRuns) {
  const fs::path file = root_ / "robot.toml";
  std::ofstream(file) << "[robot.bus]\nkind = \"ethercat\"\ninterface = \"eth1\"\n";
  const auto s = teletact::load_scene(file, {});
  teletact::CalibrationInput input;
  const Calibration c = teletact::calibrate(nrt(), *s, 2, true, &input, rt::Box::kRobot);
  EXPECT_EQ(input.operator_hash, 0U) << "no pass of the operator's box";
  EXPECT_EQ(input.passes, 2U);
  auto specs = tasks::make_specs(c, teletact::choice_limits(*s));
  std::erase_if(specs, [](const rt::TaskSpec& t) { return t.box != rt::Box::kRobot; });
  ASSERT_EQ(specs.size(), c.rows.size() - 1) << "capture has two levels, the others one";
  EXPECT_EQ(c.lacks(teletact::calibration_origin(*s), specs), "");
  EXPECT_TRUE(s->world.boxes.empty()) << "the room was lent";
  // And it is taken the next time, on another card too.
  options_.scene_path = file;
  tasks::save_calibration((root_ / "teletact/calibration-robot-robot.toml").string(), c);
  const auto moved = teletact::load_scene(file, {"robot.bus.interface=\"eth2\""});
  std::string text;
  (void)teletact::host_calibration(nrt(), *moved, options_, text, rt::Box::kRobot);
  EXPECT_EQ(text.find("measured just now"), std::string::npos) << text;
}

// A world of nothing is no test of fusion: the operator's box gets the room's images.
TEST_F(Cache, WithNothingInTheWorldFusionIsMeasuredInTheRoom) {
  const fs::path file = root_ / "robot.toml";
  std::ofstream(file) << "[robot.bus]\nkind = \"ethercat\"\ninterface = \"eth1\"\n";
  const auto s = teletact::load_scene(file, {"fusion.tsdf.voxel_size_m=0.02"});
  const Calibration c = teletact::calibrate(nrt(), *s, 2, true);
  for (int level = 0; level < 3; ++level) {
    const auto* r = c.find("fusion", "20 mm", level);
    ASSERT_NE(r, nullptr);
    EXPECT_GE(r->tracked_share, 0.95) << level;
    EXPECT_EQ(c.does_not_track(*r), "") << level;
  }
}

TEST_F(Cache, ABadNamedFileIsAnError) {
  options_.calibration = (root_ / "bad.toml").string();
  std::ofstream(options_.calibration) << "host = \"x\"\n[[task]]\nname = \"haptic\"\nlevel = 2\n";
  const auto s = scene();
  std::string text;
  try {
    (void)teletact::host_calibration(nrt(), *s, options_, text);
    FAIL();
  } catch (const std::runtime_error& e) {
    EXPECT_THAT(e.what(), HasSubstr("bad.toml: key 'task[0].level' = 2: allowed 0..0 for haptic"));
  }
}

}  // namespace
