// A recorded drive from disk: what is wrong in it is named by file and line.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "config/schema.hpp"
#include "tests/unit/tool_robot/drives.hpp"
#include "tools/robot/robot_files.hpp"

namespace tests {
namespace {

namespace fs = std::filesystem;
using teletact::read_wheels;
using testing::HasSubstr;

class WheelFile : public testing::Test {
 protected:
  ~WheelFile() override { fs::remove(path_); }
  const std::string& with(const std::string& text) {
    std::ofstream(path_, std::ios::binary) << text;
    return path_;
  }
  std::string refusal(const std::string& text) {
    const auto r = read_wheels(with(text), 0, 25);
    EXPECT_FALSE(r);
    return r ? std::string() : r.error();
  }
  std::string path_ =
      (fs::temp_directory_path() / ("wheels_" + std::to_string(::getpid()) + ".csv")).string();
};

constexpr const char* kHeader = "t_s,front_left,front_right,back_left,back_right\n";

TEST_F(WheelFile, RadiansAndTicks) {
  auto r = read_wheels(with(std::string(kHeader) + "1,0.1,0.2,0.3,0.4\n2,1,2,3,4\n"), 0, 25);
  ASSERT_TRUE(r) << r.error();
  ASSERT_EQ(r.value().size(), 2U);
  EXPECT_EQ(r.value()[1].t_s, 2);
  EXPECT_EQ(r.value()[1].rad, (drivers::WheelVector{1, 2, 3, 4}));
  // Of a motor that turns 25 times a wheel's turn, by 4000 ticks each.
  r = read_wheels(with("0,0,0,0,0\n1,100000,0,-50000,1\n"), 4000, 25);
  ASSERT_TRUE(r) << r.error();
  EXPECT_NEAR(r.value()[1].rad[0], 2 * std::numbers::pi, 1e-12);
  EXPECT_NEAR(r.value()[1].rad[2], -std::numbers::pi, 1e-12);
  // Columns by name, in any order, others left alone.
  r = read_wheels(with("back_right,t_s,load,front_left,back_left,front_right\n4,0,9,1,3,2\n"), 0,
                  1);
  ASSERT_TRUE(r) << r.error();
  EXPECT_EQ(r.value()[0].rad, (drivers::WheelVector{1, 2, 3, 4}));
}

TEST_F(WheelFile, WhatIsWrongIsNamedByFileAndLine) {
  const std::string head = kHeader;
  EXPECT_THAT(refusal(head + "1,0,0,0,0\n2,0,nan,0,0\n"), HasSubstr(path_ + ":3: 'nan'"));
  EXPECT_THAT(refusal(head + "1,0,0,0,0\n2,0,0,inf,0\n"), HasSubstr(path_ + ":3: 'inf'"));
  EXPECT_THAT(refusal(head + "1,0,0,0,0\n2,0,x,0,0\n"), HasSubstr(path_ + ":3: 'x'"));
  EXPECT_THAT(refusal(head + "1,0,0,0,0\n1,0,0,0,0\n"), HasSubstr(path_ + ":3: t_s must rise"));
  EXPECT_THAT(refusal(head + "2,0,0,0,0\n1,0,0,0,0\n"), HasSubstr(path_ + ":3: t_s must rise"));
  EXPECT_THAT(refusal(head + "1,0,0,0\n"), HasSubstr(path_ + ":2: 4 cells where 5"));
  EXPECT_THAT(refusal("1,0,0,0\n"), HasSubstr("4 columns where 5 are needed"));
  EXPECT_THAT(refusal("t_s,front_left,front_right,back_left\n1,0,0,0\n"),
              HasSubstr("column 'back_right' is missing"));
  EXPECT_THAT(refusal(head + "1,0,0,0,0\n2,0,0,0,90\n"),
              HasSubstr(path_ + ":3: back_right leaps by 90 rad"));
  EXPECT_THAT(refusal(head), HasSubstr("no data rows"));
  const auto none = read_wheels(path_ + ".none", 0, 1);
  ASSERT_FALSE(none);
  EXPECT_THAT(none.error(), HasSubstr("cannot be opened"));
}

TEST_F(WheelFile, WhatIsWrittenIsRead) {
  rt::Random random(2);
  std::vector<teletact::WheelAngles> rows;
  for (int k = 0; k < 50; ++k) {
    rows.push_back({0.005 * k, {}});
    for (double& r : rows.back().rad) r = random.uniform(-10, 10);
  }
  const auto r = read_wheels(with(teletact::wheels_csv(rows)), 0, 25);
  ASSERT_TRUE(r) << r.error();
  ASSERT_EQ(r.value().size(), rows.size());
  for (std::size_t k = 0; k < rows.size(); ++k) {
    EXPECT_NEAR(r.value()[k].t_s, rows[k].t_s, 1e-6);
    for (std::size_t i = 0; i < 4; ++i) EXPECT_NEAR(r.value()[k].rad[i], rows[k].rad[i], 1e-8);
  }
}

// The keys as they are written load into what they describe, and give the same robot.
TEST(CalibrationFile, GivesTheRobotThatWasFound) {
  rt::Random random(6);
  const RobotModel truth = any_model(random, 0.04, 0.1, 8);
  const teletact::DriveScript script;
  RobotDrive drive = exact_drive(
      truth, [&](double t) { return script.at(t); }, script.seconds(), Pose::Identity());
  drive.floor.assign(5, floor_of(truth));
  const auto fit = teletact::fit_robot(drive, stated_model());
  ASSERT_TRUE(fit) << fit.error();
  const std::string text = teletact::calibration_toml(fit.value(), stated_model(), "2000-01-01");
  drivers::SyntheticCameraConfig camera;
  drivers::MecanumConfig base;
  config::Section root;
  camera.describe(root.section("camera"));
  base.describe(root.section("robot_io").section("base"));
  const auto ok = config::load_text(text, "calibration", root);
  ASSERT_TRUE(ok) << ok.error();
  EXPECT_LT((camera.X_BC().matrix() - truth.X_BC.matrix()).norm(), 2e-5);
  for (std::size_t i = 0; i < 4; ++i)
    EXPECT_NEAR(base.wheel_scale[i], truth.base.wheel_scale[i], 2e-6);
  EXPECT_NEAR(base.lever_scale, truth.base.lever_scale, 2e-6);
  EXPECT_NEAR(base.slide_scale, truth.base.slide_scale, 2e-6);
  EXPECT_THAT(text, HasSubstr("Not constrained by the drive, as stated: nothing."));
}

}  // namespace
}  // namespace tests
