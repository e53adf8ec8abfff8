// SIGINT and SIGTERM where no real-time task runs: a virtual run ends with the report of what ran,
// a calibration without a file. The signal is sent at an event of the program, never after a time.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "tests/support/paths.hpp"

namespace {

namespace fs = std::filesystem;

std::string read(const fs::path& file) {
  std::ostringstream out;
  out << std::ifstream(file).rdbuf();
  return out.str();
}

class Stop : public testing::Test {
 protected:
  Stop() : folder_(fs::temp_directory_path() / ("teletact_stop_" + std::to_string(::getpid()))) {
    fs::create_directories(folder_ / "tmp");
  }
  ~Stop() override {
    if (child_ > 0) {
      ::kill(child_, SIGKILL);
      ::waitpid(child_, nullptr, 0);
    }
    fs::remove_all(folder_);
  }

  void start(std::vector<std::string> words) {
    words.insert(words.begin(), tests::in_build("teletact"));
    std::vector<char*> argv;
    for (auto& w : words) argv.push_back(w.data());
    argv.push_back(nullptr);
    const std::string out = folder_ / "out.txt", tmp = folder_ / "tmp";
    child_ = ::fork();
    ASSERT_GE(child_, 0);
    if (child_ > 0) return;
    ::setenv("TMPDIR", tmp.c_str(), 1);
    const int fd = ::open(out.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0644);
    ::dup2(fd, 1);
    ::dup2(fd, 2);
    ::execv(argv[0], argv.data());
    ::_exit(127);
  }
  // Sends the signal once `event` holds; returns the exit code, 128 + the number of a signal that
  // killed it, -1 if it ended before.
  template <class Event>
  int signal_at(int signal, const Event& event) {
    int status = 0;
    while (!event()) {
      if (::waitpid(child_, &status, WNOHANG) == child_) {
        child_ = 0;
        return -1;
      }
      ::usleep(2000);
    }
    ::kill(child_, signal);
    ::waitpid(child_, &status, 0);
    child_ = 0;
    return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  }
  [[nodiscard]] std::string out() const { return read(folder_ / "out.txt"); }
  [[nodiscard]] auto printed(const std::string& text) const {
    return [this, text] { return out().find(text) != std::string::npos; };
  }
  double metric(const std::string& name) {
    const auto all = nlohmann::json::parse(read(folder_ / "j.json"));
    for (const auto& m : all["metrics"]) {
      if (m["name"] == name) return m["value"].get<double>();
    }
    ADD_FAILURE() << "no " << name;
    return -1;
  }
  void expect_no_calibration() {
    EXPECT_FALSE(fs::exists(folder_ / "c.toml"));
    EXPECT_FALSE(fs::exists(folder_ / "j.json"));
    EXPECT_TRUE(fs::is_empty(folder_ / "tmp")) << "the stored input is removed";
    const std::string text = out();
    const auto last = text.rfind('\n', text.size() - 2);
    EXPECT_EQ(text.substr(last + 1).rfind("teletact calibrate: stopped while", 0), 0U) << text;
  }

  fs::path folder_;
  pid_t child_ = 0;
};

TEST_F(Stop, AVirtualRunOfTheScheduleReportsWhatRan) {
  start({"demo", "--clock", "virtual", "--bodies", "stub", "--seconds", "864000", "--quiet",
         "--report", folder_ / "r", "--json", folder_ / "j.json"});
  EXPECT_EQ(signal_at(SIGINT, [&] { return fs::exists(folder_ / "r"); }), 0) << out();
  EXPECT_NE(out().find("stopped early: "), std::string::npos) << out();
  EXPECT_EQ(metric("run.stopped_early"), 1);
  EXPECT_EQ(metric("haptic.releases"),
            metric("haptic.completed") + metric("haptic.skipped") + metric("haptic.aborted"));
}

TEST_F(Stop, AVirtualRunWithBodiesWritesItsReport) {
  start({"demo", "--clock", "virtual", "--seconds", "600", "--report", folder_ / "r", "--json",
         folder_ / "j.json"});
  const auto ran = [&] { return fs::exists(folder_ / "r/raw/operator.log"); };
  EXPECT_EQ(signal_at(SIGTERM, ran), 0) << out();
  EXPECT_TRUE(fs::exists(folder_ / "r/report.html")) << out();
  EXPECT_NE(read(folder_ / "r/report.html").find("stopped early: "), std::string::npos);
  EXPECT_EQ(metric("run.stopped_early"), 1);
  EXPECT_LT(metric("haptic.releases"), 600'000);
}

TEST_F(Stop, ACalibrationThatIsStoringItsInputLeavesNothing) {
  start(
      {"calibrate", "--seconds", "600", "--out", folder_ / "c.toml", "--json", folder_ / "j.json"});
  EXPECT_EQ(signal_at(SIGINT, printed("storing")), 1) << out();
  expect_no_calibration();
}

TEST_F(Stop, ACalibrationThatIsMeasuringLeavesNothing) {
  start({"calibrate", "--seconds", "2", "--out", folder_ / "c.toml", "--json", folder_ / "j.json"});
  EXPECT_EQ(signal_at(SIGTERM, printed("operator's box at level 0")), 1) << out();
  expect_no_calibration();
}

}  // namespace
