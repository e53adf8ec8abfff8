// The program's exit code is the bench's verdict: 1 where a limit is missed, 0 where all are met.
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <string>

#include <opencv2/imgcodecs.hpp>

#include "tests/support/paths.hpp"

namespace {

namespace fs = std::filesystem;

std::pair<int, std::string> run(const std::string& words) {
  std::FILE* pipe = ::popen((tests::in_build("teletact") + " " + words + " 2>&1").c_str(), "r");
  std::string text;
  char part[4096];
  for (std::size_t n = 0; (n = std::fread(part, 1, sizeof part, pipe)) > 0;) text.append(part, n);
  const int status = ::pclose(pipe);
  return {WIFEXITED(status) ? WEXITSTATUS(status) : 128, text};
}

// An image of two halves, and a person who saw these, or `stripes` that are not there.
std::pair<int, std::string> table2(const std::string& name, int stripes) {
  const fs::path folder = fs::temp_directory_path() / (name + std::to_string(::getpid()));
  fs::create_directories(folder / "images");
  fs::create_directories(folder / "segmentations");
  cv::Mat image(120, 160, CV_8UC3, cv::Scalar(20, 40, 200)), map(120, 160, CV_8UC1);
  image.colRange(80, 160).setTo(cv::Scalar(200, 120, 20));
  for (int u = 0; u < 160; ++u) map.col(u).setTo(u * stripes / 160);
  cv::imwrite((folder / "images/a.png").string(), image);
  cv::imwrite((folder / "segmentations/a_0.png").string(), map);
  auto out = run("bench table2 --data " + folder.string());
  fs::remove_all(folder);
  return out;
}

TEST(BenchExit, IsOneWhereALimitIsMissed) {
  const auto [good, said] = table2("teletact_met_", 2);
  EXPECT_EQ(good, 0) << said;
  EXPECT_NE(said.find("6 met, 0 MISSED, 0 not measured\n"), std::string::npos) << said;
  const auto [bad, complained] = table2("teletact_missed_", 16);
  EXPECT_EQ(bad, 1) << complained;
  EXPECT_NE(complained.find(" MISSED\n"), std::string::npos) << complained;
}

}  // namespace
