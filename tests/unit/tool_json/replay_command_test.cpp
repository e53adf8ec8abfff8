// teletact replay on the run of one box, as `robot --record` and `operator --record` leave it: what
// is there is replayed, without a word for which box.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <string>
#include <utility>

#include "tests/support/paths.hpp"

namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;
using testing::Not;

// Exit code, and what it printed on both streams.
std::pair<int, std::string> run(const std::string& words) {
  std::FILE* pipe = ::popen((tests::in_build("teletact") + " " + words + " 2>&1").c_str(), "r");
  std::string text;
  char part[4096];
  for (std::size_t n = 0; (n = std::fread(part, 1, sizeof part, pipe)) > 0;) text.append(part, n);
  const int status = ::pclose(pipe);
  return {WIFEXITED(status) ? WEXITSTATUS(status) : 128, text};
}

TEST(ReplayCommand, OfTheRunOfOneBoxThatOneIsReplayed) {
  const fs::path report =
      fs::temp_directory_path() / ("teletact_replay_one_" + std::to_string(::getpid()));
  const auto [recorded, said] =
      run("demo --clock virtual --quiet --seconds 1 --record --report " + report.string());
  ASSERT_LE(recorded, 1) << said;
  const fs::path op = report / "raw/operator.inputs", robot = report / "raw/robot.inputs",
                 aside = report / "aside";
  const std::string words = "replay " + (report / "raw").string();
  fs::rename(op, aside);
  const auto of_robot = run(words);
  EXPECT_EQ(of_robot.first, 0) << of_robot.second;
  EXPECT_THAT(of_robot.second, HasSubstr("robot"));
  EXPECT_THAT(of_robot.second, Not(HasSubstr("operator")));
  fs::remove(robot);
  const auto of_none = run(words);
  EXPECT_EQ(of_none.first, 2) << of_none.second;
  EXPECT_THAT(of_none.second, HasSubstr("operator.inputs"));
  fs::rename(aside, op);
  const auto of_operator = run(words);
  EXPECT_EQ(of_operator.first, 0) << of_operator.second;
  EXPECT_THAT(of_operator.second, Not(HasSubstr("robot")));
  EXPECT_EQ(run(words + " --box robot").first, 2) << "who names one is told that it is not there";
  fs::remove_all(report);
}

}  // namespace
