// The log's text file: its newest lines, and what a disk that refuses does to it.
#include "rt/audit/log_file.hpp"

#include <gtest/gtest.h>
#include <signal.h>
#include <spdlog/spdlog.h>
#include <sys/resource.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

namespace {

namespace fs = std::filesystem;

// No file of this process may grow beyond so much, while it lives: what a full disk does, without a
// disk.
class NoMoreThan {
 public:
  explicit NoMoreThan(rlim_t bytes) {
    ::signal(SIGXFSZ, SIG_IGN);
    ::getrlimit(RLIMIT_FSIZE, &before_);
    const rlimit limit{bytes, before_.rlim_max};
    EXPECT_EQ(::setrlimit(RLIMIT_FSIZE, &limit), 0);
  }
  ~NoMoreThan() { ::setrlimit(RLIMIT_FSIZE, &before_); }
  NoMoreThan(const NoMoreThan&) = delete;
  NoMoreThan& operator=(const NoMoreThan&) = delete;

 private:
  rlimit before_{};
};

struct LogFileTest : testing::Test {
  fs::path folder = fs::temp_directory_path() / ("teletact-log-" + std::to_string(::getpid()));
  rt::Startup startup;
  std::vector<std::string> seen;
  int refused = 0;
  LogFileTest() { fs::create_directories(folder); }
  ~LogFileTest() override { fs::remove_all(folder); }
  std::shared_ptr<spdlog::logger> open(std::size_t bytes) {
    rt::LogFile file{(folder / "robot.log").string()};
    file.also = [this](std::string_view line) { seen.emplace_back(line); };
    file.refused = [this] { ++refused; };
    file.bytes = bytes;
    return rt::open_log_file(startup.token(), std::move(file));
  }
  std::string text(const char* name = "robot.log") const {
    std::ifstream in(folder / name);
    return {std::istreambuf_iterator<char>(in), {}};
  }
};

TEST_F(LogFileTest, KeepsTheNewestLinesAndBeginsAnew) {
  std::ofstream(folder / "robot.log") << "of an earlier run\n";
  std::ofstream(folder / "robot.2.log") << "of an earlier run\n";
  const auto log = open(1000);
  log->info("first");
  EXPECT_EQ(text(), "info first\n");
  EXPECT_EQ(text("robot.2.log"), "");
  for (int i = 0; i < 1000; ++i) log->info("line {}", i);
  EXPECT_NE(text().find("line 999\n"), std::string::npos);
  EXPECT_EQ(seen.size(), 1001U);
  EXPECT_EQ(refused, 0);
}

TEST_F(LogFileTest, ALineThatTheDiskRefusesIsToldOnce) {
  const auto log = open(std::size_t{1} << 20U);
  {
    const NoMoreThan limit(4000);
    for (int i = 0; i < 1000; ++i) log->warn("line {}", i);
    EXPECT_EQ(refused, 1);
    EXPECT_LE(text().size(), 4000U);
    EXPECT_EQ(text().rfind("warning line 0\n", 0), 0U);
  }
  EXPECT_EQ(seen.size(), 1000U) << "nothing is lost but in the file";
  log->warn("room again");
  EXPECT_NE(text().find("room again"), std::string::npos);
  EXPECT_EQ(refused, 1);
}

}  // namespace
