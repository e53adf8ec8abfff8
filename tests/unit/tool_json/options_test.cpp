// What a command line asks for and no command does: one line that names the option, exit code 2,
// and no file written, before anything starts.
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <set>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "rt/audit/run_file.hpp"
#include "tests/support/paths.hpp"
#include "tests/support/whole.hpp"

namespace {

namespace fs = std::filesystem;

struct Refusal {
  std::string words, names;
};

// Exit code, and what it printed on both streams.
std::pair<int, std::string> run(const std::string& words) {
  const std::string command = "timeout 20 " + tests::in_build("teletact") + " " + words + " 2>&1";
  std::FILE* pipe = ::popen(command.c_str(), "r");
  std::string text;
  char part[4096];
  for (std::size_t n = 0; (n = std::fread(part, 1, sizeof part, pipe)) > 0;) text.append(part, n);
  const int status = ::pclose(pipe);
  return {WIFEXITED(status) ? WEXITSTATUS(status) : 128, text};
}

// "teletact COMMAND: what is wrong", once.
void expect_one_line(const std::string& words, const std::string& text) {
  const std::string name = words.substr(0, words.find(' '));
  const std::string head = "teletact " + name + ": ";
  EXPECT_EQ(text.substr(0, head.size()), head) << text;
  EXPECT_EQ(text.find('\n'), text.size() - 1) << text;
  EXPECT_EQ(text.find(name + ": ", head.size()), std::string::npos) << "named twice: " << text;
}

// Each command of the program's usage, with nothing but an option that none has.
TEST(Options, AWrongOptionIsOneLineThatNamesTheCommand) {
  std::istringstream usage(run("--help").second);
  int commands = 0;
  bool listed = false;
  for (std::string line; std::getline(usage, line);) {
    listed = listed || line.rfind("usage:", 0) == 0;
    if (!listed || line.rfind("  ", 0) != 0) continue;
    std::string name;
    std::istringstream(line) >> name;
    SCOPED_TRACE(name);
    ++commands;
    for (const char* wrong : {" --no-such-option", " --json"}) {
      const auto [code, text] = run(name + wrong);
      EXPECT_EQ(code, 2);
      expect_one_line(name, text);
    }
    const auto [code, text] = run(name + " --help");
    EXPECT_EQ(code, 0);
    const bool in_parts =
        text.find("Subcommands:") != std::string::npos;  // each has its own options
    EXPECT_TRUE(in_parts || text.find("--json") != std::string::npos) << text;
  }
  EXPECT_GE(commands, 12);
}

void write_log(const std::string& file) {
  rt::RunLog log;
  rt::TaskLog task;
  task.spec.name = "haptic";
  task.spec.rate = {1000, 1};
  log.tasks = {task};
  rt::RunFileWriter writer(file, log);
  writer.add(rt::JobRecord{});
}

TEST(Options, WhatCanNotBeIsRefusedBeforeAnythingStarts) {
  const fs::path folder =
      fs::temp_directory_path() / ("teletact_options_" + std::to_string(::getpid()));
  fs::create_directories(folder / "dir");
  std::ofstream(folder / "odo.csv") << "t_s,x_m,y_m,yaw_rad,vx,vy,wz\n0,0,0,0,0,0,0\n";
  const std::string in = folder.string();
  write_log(in + "/a.run");
  const std::string demo = "demo --clock virtual --bodies stub --report " + in + "/report ";
  const std::string predict = "predict --delay 0.1 --log " + in + "/odo.csv ";
  const std::string touch = "touch --field " + in + "/f.npy --voxel 0.01 --path " + in + "/h.csv ";
  const std::vector<Refusal> refusals{
      {demo + "--seconds -5", "--seconds"},
      {demo + "--seconds 0", "--seconds"},
      {demo + "--seconds nan", "--seconds"},
      {demo + "--seconds 1e30", "--seconds"},
      {demo + "--cut-link nan", "--cut-link"},
      {demo + "--cut-link -3", "--cut-link"},
      {demo + "--black-box nan", "--black-box"},
      {demo + "--json /nonexistent/j.json", "--json"},
      {demo + "--seconds 5 --rgbd " + in + "/none", "none"},
      {demo + "--seconds abc", "--seconds"},
      {demo + "--bodies wooden", "--bodies"},
      {"demo --clock virtual --seconds 1 --report " + in + "/odo.csv", "--report"},
      {"demo --clock virtual --seconds 1 --report " + in + "/odo.csv/r", "--report"},
      {"demo --clock virtual --seconds 1 --report /proc/r", "--report /proc/r"},
      {"bench audit --json /nonexistent/j.json", "--json"},
      {"bench rings --rounds many", "--rounds"},
      {"calibrate --out /nonexistent/c.toml", "--out"},
      {"calibrate --out " + in + "/c.toml --json " + in + "/dir", "--json"},
      {"calibrate --out " + in + "/c --json " + in + "/dir/../c", "also the file of --out"},
      {"audit " + in + "/none.run", "none.run"},
      {"audit " + in + "/a.run --csv /nonexistent/a.csv --trace " + in + "/t", "--csv"},
      {"audit " + in + "/a.run --csv " + in + "/c --trace /nonexistent/t", "--trace"},
      {"audit " + in + "/a.run --csv " + in + "/c --json " + in + "/dir", "--json"},
      {"audit " + in + "/a.run --csv " + in + "/a.run", "also read"},
      {"audit " + in + "/a.run --csv " + in + "/c --html " + in + "/odo.csv", "--html"},
      {"audit " + in + "/a.run --csv " + in + "/c --html " + in + "/odo.csv/h", "--html"},
      {"replay " + in + " --json /nonexistent/j.json", "--json"},
      {"replay " + in, "operator"},
      {"device --kind twin --json /nonexistent/j.json", "--json"},
      {"device --kind wooden", "wooden"},
      {"stability --json /nonexistent/j.json", "--json"},
      {"stability --svg " + in + "/odo.csv", "--svg"},
      {"stability --cases 99", "--cases '99': allowed are numbers 1 to 20"},
      {"stability --cases 0", "--cases"},
      {"stability --cases 1,,2", "--cases"},
      {"stability --cases 3x", "--cases"},
      {"stability --cases nan", "--cases"},
      {"stability --method wooden", "--method 'wooden': allowed are constrained, nearest"},
      {"stability --layer maybe", "--layer 'maybe': allowed are on, off, both"},
      {"stability --tip-radius 4.1", "--tip-radius: Value 4.1 not in FLOAT in [0 - 4]"},
      {"stability --tip-radius -1", "--tip-radius"},
      {"stability --tip-radius nan", "--tip-radius"},
      {"stability --tip-radius 3 --cases 20", "--tip-radius: case 20"},
      {"stability --tip-radius 3 --fused", "--tip-radius"},
      {"stability --angles 361", "--angles: Value 361 not in FLOAT in [-360 - 360]"},
      {"stability --angles nan", "--angles"},
      {"stability --angles 10,west", "--angles"},
      {"stability --offsets 1.01", "--offsets: Value 1.01 not in FLOAT in [0 - 1]"},
      {"stability --offsets=-0.5", "--offsets"},
      {"stability --speeds 0.5", "--speeds: Value 0.5 not in FLOAT in [1 - 1000]"},
      {"stability --speeds 20,inf", "--speeds"},
      {"stability --fused --speeds 20", "--fused"},
      {"stability --fused --cases 9", "--fused: case 9"},
      {"stability --fused --method force_shading", "--method 'force_shading'"},
      {"doctor --json /dev/null", "--json"},
      {"doctor --root " + in + "/none", "none"},
      {predict + "--out " + in + "/p.csv --method wooden", "--method"},
      {"predict --delay 0.1 --log " + in + "/none.csv --out " + in + "/p.csv", "none.csv"},
      {touch + "--out " + in + "/t.csv", "h.csv"},
      {touch + "--out " + in + "/t.csv --origin 1,2", "--origin"},
      {"calibrate --seconds nan --out " + in + "/c.toml", "--seconds"},
      {"bench wakeup --slice nan", "--slice"},
      {"device --seconds nan", "--seconds"},
      {predict + "--out " + in + "/dir --json " + in + "/j.json", "--out"},
      {predict + "--out " + in + "/odo.csv", "also read"},
      {predict + "--out " + in + "/a --json " + in + "/dir/../a", "also the file of --out"},
      {touch + "--out " + in + "/t.csv --debug " + in + "/t.csv", "also the file of --out"},
      {touch + "--out " + in + "/f.npy", "also read"},
      {touch + "--out " + in + "/t.csv --truncation -1", "--truncation"},
      {touch + "--out " + in + "/t.csv --truncation nan", "--truncation"},
      {"fuse --rgbd " + in + " --poses " + in + "/o --ply " + in + "/o",
       "also the file of --poses"},
      {"fuse --rgbd " + in + " --poses " + in + "/o --ply " + in + "/q --set fusion.tsdf.voxel=1",
       "nearest known key"},
      {"fuse --rgbd " + in + " --poses " + in + "/o --ply " + in + "/q --pixel-step 9",
       "--pixel-step"},
      {"demo --scene nosuch",
       "none of the names in config/scenes: any_recording, arm, bad_road, corridor"},
      {"accuracy fusion --voxels 1", "--voxels"},
      {"accuracy fusion --scenes nowhere", "nowhere"},
      {"accuracy segmentation", "--data"},
      {"accuracy weather", "weather"},
      {"bench drift --voxel nan", "--voxel"},
      {"bench haptic --record " + in + "/x.run",
       "--record has no meaning with haptic: it belongs to"},
      {"bench haptic --rgbd " + in + " --passes 2", "--passes has no meaning"},
      {"bench rings --voxel 0.02", "--voxel has no meaning with rings: it belongs to drift"},
      {"bench audit --count 30", "--frames has no meaning"},
      {"bench drift --no-synthetic", "--no-synthetic has no meaning"},
      {"bench rings --no-beside", "--no-beside has no meaning"},
      {"bench rings --no-fixed-voxel", "--no-fixed-voxel has no meaning"},
      {"bench fusion --no-instructions", "--no-instructions has no meaning"},
      {"accuracy haptic --rgbd /nonexistent", "--rgbd has no meaning with haptic"},
      {"accuracy haptic --voxels 20", "--voxels has no meaning"},
      {"accuracy segmentation --data " + in + " --frames 20", "--frames has no meaning"},
      {"accuracy fusion --seed 3", "--seed has no meaning"},
      {"accuracy fusion --samples 3", "--samples has no meaning with fusion"},
      {"accuracy weighting --rgbd-frames 30", "--rgbd-frames has no meaning"},
      {"accuracy weighting --data " + in, "--data has no meaning with weighting"},
      {"accuracy fusion --rgbd-frames 30", "--rgbd-frames has no meaning"},
      {touch + "--out \"\"", "--out is empty"},
      {"segment --color " + in + "/c.png --touch 1,1 --out " + in + "/c.png", "also read"},
  };
  for (const auto& r : tests::whole_or_each(refusals, 3)) {
    SCOPED_TRACE(r.words);
    const auto [code, text] = run(r.words);
    EXPECT_EQ(code, 2) << text;
    expect_one_line(r.words, text);
    EXPECT_NE(text.find(r.names), std::string::npos) << text;
    std::size_t files = 0;
    for (const auto& e : fs::recursive_directory_iterator(folder)) files += e.is_regular_file();
    EXPECT_EQ(files, 2U) << "a file was left";
  }
  fs::remove_all(folder);
}

}  // namespace
