// The twin drives, with wheels that are worn and slip and a camera that is mounted elsewhere than
// stated; what is found is near the truth, and the same from files.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "tools/robot/robot_drive.hpp"
#include "tools/teletact/commands.hpp"

namespace teletact {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

constexpr double kDeg = 0.017453292519943295;

struct Folder {
  fs::path path = fs::temp_directory_path() / ("identify_" + std::to_string(::getpid()));
  Folder() { fs::create_directories(path); }
  ~Folder() { fs::remove_all(path); }
  [[nodiscard]] std::string file(const std::string& name) const { return (path / name).string(); }
};

// Images of half the size: the same drive in a third of the time.
const std::vector<std::string>& off() {
  static const std::vector<std::string> keys{
      "camera.resolution=\"half\"",
      "fusion.tsdf.voxel_size_m=0.02",
      "robot.plant.wheel_radius_error=[-0.01, -0.02, 0.01, 0.0]",
      "camera.true_mount.differs=true",
      "camera.true_mount.position_m=[-0.18, -0.015, 0.96]",
      "camera.true_mount.yaw_deg=2",
      "camera.true_mount.pitch_deg=28.5",
      "camera.true_mount.roll_deg=1"};
  return keys;
}

int run(std::vector<std::string> args) {
  args.insert(args.begin(), {"identify", "robot"});
  std::vector<char*> argv;
  for (std::string& a : args) argv.push_back(a.data());
  argv.push_back(nullptr);
  return cmd_identify(static_cast<int>(args.size()), argv.data());
}

std::string refusal(const std::vector<std::string>& args) {
  try {
    EXPECT_NE(run(args), 0);
  } catch (const std::exception& e) {
    return e.what();
  }
  return {};
}

std::string read(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

double metric(const std::string& json, const std::string& name) {
  const auto whole = nlohmann::json::parse(json);
  for (const auto& m : whole["metrics"])
    if (m["name"] == name) return m["value"].get<double>();
  ADD_FAILURE() << name << " is not among the metrics";
  return -1;
}

TEST(IdentifyRobot, TheTwinsTruthIsFoundAndTheFilesGiveTheSame) {
  const Folder folder;
  std::vector<std::string> args{"--record", folder.file("drive"),
                                "--json",   folder.file("twin.json"),
                                "--write",  folder.file("robot.toml")};
  for (const std::string& key : off()) args.insert(args.end(), {"--set", key});
  ASSERT_EQ(run(args), 0);
  const std::string twin = read(folder.file("twin.json"));
  EXPECT_GT(metric(twin, "identify.robot.claimed_share"), 0.8);
  EXPECT_LT(metric(twin, "identify.robot.truth.wheel_error"), 0.012);
  EXPECT_LT(metric(twin, "identify.robot.truth.camera_error_mm"), 10);
  EXPECT_LT(metric(twin, "identify.robot.truth.camera_error_deg"), 0.5);
  EXPECT_LT(metric(twin, "identify.robot.odometry_after_mm_per_m"),
            0.7 * metric(twin, "identify.robot.odometry_before_mm_per_m"));

  // What a robot of the same drive would have logged: all but the floor's images.
  ASSERT_EQ(run({"--wheels", folder.file("drive/wheels.csv"), "--poses",
                 folder.file("drive/poses.txt"), "--json", folder.file("files.json")}),
            0);
  const std::string files = read(folder.file("files.json"));
  for (const char* name : {"wheel.front_left", "wheel.back_right", "lever", "slide"}) {
    const std::string m = std::string("identify.robot.") + name;
    EXPECT_NEAR(metric(files, m), metric(twin, m), 2e-3) << name;
  }
  EXPECT_NEAR(metric(files, "identify.robot.camera.x_mm"),
              metric(twin, "identify.robot.camera.x_mm"), 2);
  EXPECT_EQ(metric(files, "identify.robot.camera.z_mm"), 950) << "no floor: as stated";

  // The keys that were written load: the stated mount moves to the true one, which stays where it
  // is.
  const auto scene = load_scene(find_config("scenes", "rounds"), off());
  const perception::Pose truth = scene->camera.true_X_BC();
  const auto loaded = config::load_file(folder.file("robot.toml"), scene->schema);
  ASSERT_TRUE(loaded) << loaded.error();
  EXPECT_TRUE(scene->camera.true_X_BC().matrix() == truth.matrix());
  const perception::Pose off_by = scene->camera.X_BC().inverse() * truth;
  EXPECT_LT(off_by.translation().norm(), 0.010);
  EXPECT_LT(perception::rotation_angle(off_by.linear()), 0.5 * kDeg);
}

TEST(IdentifyRobot, WhatItDoesNotTakeIsRefusedInOneLine) {
  const Folder folder;
  const auto with = [&](const std::string& name, const std::string& text) {
    std::ofstream(folder.file(name)) << text;
    return folder.file(name);
  };
  const std::string wheels = with("w.csv", "0,0,0,0,0\n1,0,0,0,0\n");
  EXPECT_THAT(refusal({"--wheels", wheels}), HasSubstr("--poses"));
  EXPECT_THAT(refusal({"--wheels", wheels, "--poses", with("p.txt", "0 0 0 0 0 0 0\n")}),
              HasSubstr("p.txt:1: 7 values"));
  EXPECT_THAT(refusal({"--wheels", with("n.csv", "0,0,0,0,nan\n"), "--poses", wheels}),
              HasSubstr("n.csv:1: 'nan'"));
  EXPECT_THAT(refusal({"--wheels", wheels, "--poses", with("q.txt", "0 0 0 0 0 0 0 1\n")}),
              HasSubstr("only 0.0 s with wheel angles"));
  EXPECT_THAT(refusal({"--set", "camera.kind=\"openni2\""}), HasSubstr("only the twin is driven"));
  EXPECT_THAT(refusal({"--set", "robot_io.start_x_m=2.3", "--set", "camera.resolution=\"half\""}),
              HasSubstr("the base ran into something"));
  // A drive that does not turn gives a part, and only to who asks for it.
  std::string csv, poses;
  char line[200];
  for (int k = 0; k < 1200; ++k) {
    const double t = 0.05 * k, x = 0.5 * std::sin(0.3 * t), a = x / 0.0475;
    std::snprintf(line, sizeof line, "%.2f,%.9f,%.9f,%.9f,%.9f\n", t, -a, a, -a, a);
    csv += line;
    // The camera of the default mount: -0.2 m behind, 0.95 m high, 30 degrees down.
    std::snprintf(line, sizeof line,
                  "%.2f %.9f 0 0.95 -0.612372436 0.612372436 -0.353553391 0.353553391\n", t,
                  x - 0.2);
    poses += line;
  }
  const std::string w = with("s.csv", csv), p = with("s.txt", poses);
  EXPECT_THAT(refusal({"--wheels", w, "--poses", p, "--write", folder.file("part.toml")}),
              HasSubstr("the drive does not constrain radii front against back, radii diagonally, "
                        "lever of the turn, "));
  EXPECT_FALSE(fs::exists(folder.file("part.toml")));
  EXPECT_EQ(run({"--wheels", w, "--poses", p, "--partial", "--write", folder.file("part.toml")}),
            0);
  EXPECT_THAT(read(folder.file("part.toml")),
              HasSubstr("lever_scale = 1.000000  # not constrained"));
}

TEST(IdentifyRobot, ThePlanIsTheDriveThatTheTwinTakes) {
  const Folder folder;
  ASSERT_EQ(run({"--plan", folder.file("plan.csv")}), 0);
  EXPECT_EQ(read(folder.file("plan.csv")), DriveScript().csv());
}

}  // namespace
}  // namespace teletact
