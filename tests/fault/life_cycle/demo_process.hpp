// The program `teletact demo` as a child, its output in a file, and what it leaves.
#pragma once

#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "rt/time.hpp"
#include "tests/support/paths.hpp"
#include "tools/host/run_results.hpp"

namespace life_cycle {

namespace fs = std::filesystem;

class DemoProcess {
 public:
  DemoProcess(const std::string& name, double seconds, const std::vector<std::string>& more = {}) {
    folder_ = fs::temp_directory_path() / ("teletact-life-" + std::to_string(::getpid()) + name);
    fs::remove_all(folder_);
    fs::create_directories(folder_);
    std::vector<std::string> words{tests::in_build("teletact"),
                                   "demo",
                                   "--clock",
                                   "real",
                                   "--seconds",
                                   std::to_string(seconds),
                                   "--calibration",
                                   tests::in_tree("config/limits/reference_costs.toml"),
                                   "--quiet",
                                   "--report",
                                   folder_ / "report"};
    words.insert(words.end(), more.begin(), more.end());
    pid_ = ::fork();
    if (pid_ != 0) return;
    (void)!::freopen((folder_ / "output").c_str(), "w", stdout);
    ::dup2(1, 2);
    std::vector<char*> argv;
    for (auto& w : words) argv.push_back(w.data());
    argv.push_back(nullptr);
    ::execv(argv[0], argv.data());
    ::_exit(127);
  }
  ~DemoProcess() {
    if (!ended()) {
      ::kill(pid_, SIGTERM);
      (void)wait(30);
    }
    fs::remove_all(folder_);
  }
  DemoProcess(const DemoProcess&) = delete;
  DemoProcess& operator=(const DemoProcess&) = delete;

  [[nodiscard]] bool ended() {
    if (!ended_ && ::waitpid(pid_, &status_, WNOHANG) == pid_) ended_ = true;
    return ended_;
  }
  // Exit code; -1: it did not end in time; 128 + n: signal n.
  [[nodiscard]] int wait(double seconds) {
    for (int i = 0; i < static_cast<int>(seconds * 100) && !ended(); ++i) ::usleep(10000);
    if (!ended_) return -1;
    return WIFEXITED(status_) ? WEXITSTATUS(status_) : 128 + WTERMSIG(status_);
  }
  // Another program holds the cores: then a test can say nothing.
  [[nodiscard]] bool no_room() {
    return ended() && output().find("not registered") != std::string::npos;
  }
  void signal(int number) const { ::kill(pid_, number); }
  // Children, {operator, robot}; {0, 0} before they exist.
  [[nodiscard]] std::pair<pid_t, pid_t> boxes() const {
    std::pair<pid_t, pid_t> p{0, 0};
    std::ifstream(raw() + "/pids") >> p.first >> p.second;
    return p;
  }
  [[nodiscard]] teletact::OperatorHalf op() const {
    teletact::OperatorHalf h;
    teletact::load_half(raw(), h);
    return h;
  }
  [[nodiscard]] teletact::RobotHalf robot() const {
    teletact::RobotHalf h;
    teletact::load_half(raw(), h);
    return h;
  }
  // Waits until the saved halves satisfy `done`; they are saved once a second.
  template <class Condition>
  [[nodiscard]] bool until(const Condition& done, double seconds) {
    for (int i = 0; i < static_cast<int>(seconds * 50) && !ended(); ++i) {
      if (done(*this)) return true;
      ::usleep(20000);
    }
    return false;
  }
  [[nodiscard]] std::string raw() const { return folder_ / "report/raw"; }
  [[nodiscard]] bool report_written() const {
    return fs::exists(folder_ / "report/report.html") &&
           fs::file_size(folder_ / "report/report.html") > 1000;
  }
  [[nodiscard]] std::string output() const {
    std::ostringstream text;
    text << std::ifstream(folder_ / "output").rdbuf();
    return text.str();
  }
  // What the tasks of both boxes said.
  [[nodiscard]] std::string log() const {
    std::ostringstream text;
    text << std::ifstream(raw() + "/operator.log").rdbuf();
    text << std::ifstream(raw() + "/robot.log").rdbuf();
    return text.str();
  }
  // When the cable was cut, host clock; 0: it was not.
  [[nodiscard]] std::int64_t cut_ns() const {
    std::int64_t t = 0;
    std::ifstream(raw() + "/link.cut") >> t;
    return t;
  }
  [[nodiscard]] std::int64_t stop_request_ns(const std::string& box) const {
    std::int64_t t = 0;
    std::ifstream(raw() + "/" + box + ".stop") >> t;
    return t;
  }

 private:
  fs::path folder_;
  pid_t pid_ = 0;
  int status_ = 0;
  bool ended_ = false;
};

}  // namespace life_cycle
