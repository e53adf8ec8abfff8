// What a command line asks for and no command does: one line that names the option, exit code 2, and no
// file written, before anything starts.
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

namespace {

namespace fs = std::filesystem;

struct Refusal {
  std::string words, names;
};

TEST(Options, WhatCanNotBeIsRefusedBeforeAnythingStarts) {
  const fs::path folder =
      fs::temp_directory_path() / ("teletact_options_" + std::to_string(::getpid()));
  fs::create_directories(folder / "dir");
  std::ofstream(folder / "odo.csv") << "t_s,x_m,y_m,yaw_rad,vx,vy,wz\n0,0,0,0,0,0,0\n";
  const std::string in = folder.string();
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
      {"segment --color " + in + "/c.png --touch 1,1 --out " + in + "/c.png", "also read"},
  };
  for (const auto& r : refusals) {
    SCOPED_TRACE(r.words);
    const std::string command = "timeout 20 " TELETACT_BINARY_DIR "/teletact " + r.words + " 2>&1";
    std::FILE* pipe = ::popen(command.c_str(), "r");
    std::string text;
    char part[4096];
    for (std::size_t n = 0; (n = std::fread(part, 1, sizeof part, pipe)) > 0;) text.append(part, n);
    const int status = ::pclose(pipe);
    EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 2) << status << ": " << text;
    EXPECT_NE(text.find(r.names), std::string::npos) << text;
    std::size_t files = 0;
    for (const auto& e : fs::recursive_directory_iterator(folder)) files += e.is_regular_file();
    EXPECT_EQ(files, 1U) << "a file was left";
  }
  fs::remove_all(folder);
}

}  // namespace
