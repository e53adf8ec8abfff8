// teletact demo --rgbd on recordings that nobody scripted: rendered rooms forwards and backwards,
// half of the kitchen, and what can not be touched, with its exit code and its one message.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>

#include "tests/support/paths.hpp"
#include "tests/unit/tasks_fusion/recording.hpp"
#include "tools/record/recording_writer.hpp"
#include "tools/record/scenes.hpp"

namespace {

namespace fs = std::filesystem;
using perception::Vec3;
using teletact::looking;
using teletact::SyntheticRoom;
using testing::HasSubstr;

class Folder {
 public:
  Folder()
      : path_(fs::temp_directory_path() /
              ("teletact_recordings_" + std::to_string(::getpid()) + "_" +
               testing::UnitTest::GetInstance()->current_test_info()->name())) {
    fs::remove_all(path_);
    fs::create_directories(path_);
  }
  ~Folder() { fs::remove_all(path_); }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  [[nodiscard]] std::string operator/(const std::string& name) const {
    return (path_ / name).string();
  }

 private:
  fs::path path_;
};

struct Outcome {
  int code = -1;
  std::string text;
  std::map<std::string, double> value;
};

// The program itself, on the virtual clock.
Outcome demo(const Folder& folder, const std::string& rgbd, const std::string& more = "") {
  const std::string json = folder / "figures.json";
  const std::string words = tests::in_build("teletact") + " demo --clock virtual" + " --rgbd " +
                            rgbd + " --report " + (folder / "report") + " --json " + json + " " +
                            more + " 2>&1";
  Outcome out;
  std::FILE* pipe = ::popen(words.c_str(), "r");
  char part[4096];
  for (std::size_t n = 0; (n = std::fread(part, 1, sizeof part, pipe)) > 0;)
    out.text.append(part, n);
  const int status = ::pclose(pipe);
  out.code = WIFEXITED(status) ? WEXITSTATUS(status) : 128;
  std::ifstream file(json);
  if (!file) return out;
  const auto figures = nlohmann::json::parse(file);
  for (const auto& m : figures["metrics"]) {
    if (m["value"].is_number()) out.value[m["name"]] = m["value"].get<double>();
  }
  return out;
}

void write(const std::string& folder, const SyntheticRoom& room, int frames,
           bool backwards = false) {
  rt::Startup startup;
  teletact::FusionSequence sequence;
  teletact::film(startup.token(), room, 0, frames, sequence);
  teletact::write_recording(sequence, folder, backwards);
}

// What the issue of a user's own recording asks for.
void expect_touched(Outcome o) {
  EXPECT_EQ(o.code, 0) << o.text;
  EXPECT_GE(o.value["haptic.contact_share"], 0.4);
  EXPECT_GE(o.value["haptic.contacts"], 5);
  EXPECT_GE(o.value["visits.met"], 5);
  EXPECT_GE(o.value["haptic.force_samples"], 200) << "planes pressed on";
  EXPECT_LE(o.value["haptic.force_error_p95"], 0.10);
  EXPECT_LE(o.value["haptic.reach_max"], 0.95);
  EXPECT_EQ(o.value["haptic.not_finite"], 0);
  EXPECT_LE(o.value["haptic.guard_share"], 0.01);
}

// One line on stderr says why, before anything runs.
void expect_refused(const Outcome& o, const std::string& rgbd, const std::string& why) {
  EXPECT_EQ(o.code, 2);
  EXPECT_THAT(o.text, HasSubstr("teletact demo: " + rgbd + ": can not be touched: "));
  EXPECT_THAT(o.text, HasSubstr(why));
  EXPECT_EQ(std::count(o.text.begin(), o.text.end(), '\n'), 1) << o.text;
}

TEST(DemoRecordings, RoomForwards) {
  const Folder f;
  write(f / "room", teletact::scene_named("room"), 60);
  Outcome o = demo(f, f / "room", "--seconds 14");
  expect_touched(o);
  EXPECT_GE(o.value["visits.top"], 2);
  EXPECT_GE(o.value["visits.wall"], 1);
  EXPECT_THAT(o.text, HasSubstr("s  top at ("));
  EXPECT_THAT(o.text, HasSubstr("s  wall at ("));
  std::ostringstream report;
  report << std::ifstream(f / "report/report.html").rdbuf();
  EXPECT_THAT(report.str(), HasSubstr("s  wall at ("));
}

TEST(DemoRecordings, RoomBackwards) {
  const Folder f;
  write(f / "room", teletact::scene_named("room"), 60, true);
  expect_touched(demo(f, f / "room", "--seconds 14 --quiet"));
}

// Frames 76 to 150 of the kitchen, the last one first: no constant was chosen on these.
TEST(DemoRecordings, SecondHalfOfTheKitchenBackwards) {
  if (!tests::have_recording()) GTEST_SKIP() << "no recording at " << tests::recording_folder();
  const Folder f;
  const std::string half = f / "half";
  fs::create_directories(half);
  for (const char* part : {"rgb", "depth"})
    fs::create_directory_symlink(tests::recording_folder() + "/" + part, half + "/" + part);
  for (const char* file : {"intrinsics.txt", "colour_registration.txt"})
    fs::copy_file(tests::recording_folder() + "/" + file, half + "/" + file);
  std::vector<std::array<std::string, 4>> rows;
  std::ifstream in(tests::recording_folder() + "/associations.txt");
  for (std::string line; std::getline(in, line);) {
    std::istringstream words(line);
    std::array<std::string, 4> row;
    if (line[0] != '#' && words >> row[0] >> row[1] >> row[2] >> row[3]) rows.push_back(row);
  }
  ASSERT_EQ(rows.size(), 150U);
  {
    std::ofstream out(half + "/associations.txt");
    for (std::size_t i = 75; i < 150; ++i) {
      const auto &stamp = rows[i], &image = rows[224 - i];
      out << stamp[0] << ' ' << image[1] << ' ' << stamp[2] << ' ' << image[3] << '\n';
    }
  }
  expect_touched(demo(f, half, "--quiet"));
}

TEST(DemoRecordings, TooShort) {
  const Folder f;
  write(f / "short", teletact::scene_named("room"), 5);
  expect_refused(demo(f, f / "short"), f / "short", "too short: 5 images");
}

// Only a wall: which way the camera went along it nobody can tell, so nothing but the first image
// is fused.
TEST(DemoRecordings, OnlyAWall) {
  const Folder f;
  SyntheticRoom room;
  room.noise = teletact::furnished_room().noise;
  room.path = [](double t) { return looking(Vec3(0.5, 0.1 * t, 1.2), 0, 0); };
  auto& wall = room.world.planes.emplace_back();
  wall.name = "wall", wall.point_m = {2, 0, 0}, wall.normal = {-1, 0, 0};
  write(f / "wall", room, 24);
  expect_refused(demo(f, f / "wall"), f / "wall", "does not tell how it moves");
}

TEST(DemoRecordings, HardlyAnyReadings) {
  const Folder f;
  SyntheticRoom room = teletact::scene_named("room");
  room.range_max_m = 1.45;  // a corner of what it shows
  write(f / "dark", room, 16);
  expect_refused(demo(f, f / "dark"), f / "dark",
                 "of the pixels of its first 16 images have a reading");
}

// A workspace that the scene states is left where it is; from there nothing can be reached.
TEST(DemoRecordings, AStatedWorkspaceStays) {
  const Folder f;
  write(f / "room", teletact::scene_named("room"), 16);
  expect_refused(demo(f, f / "room", "--set haptic.workspace_W_m=[0,0,-5]"), f / "room",
                 "in reach of the workspace that the scene states");
}

}  // namespace
