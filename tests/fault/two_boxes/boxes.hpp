// teletact robot and teletact operator as two processes that know each other only by the road, and
// what the boxes say of themselves (teletact status). No limit on wall time: waits are generous,
// and a run that the machine itself disturbed is to be made again.
#pragma once

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "tests/support/paths.hpp"
#include "tools/box/box_status.hpp"

namespace two_boxes {

namespace fs = std::filesystem;
using Json = nlohmann::json;

inline constexpr int kTries = 3;
inline constexpr double kPatience_s = 60;

inline std::string read_file(const fs::path& path) {
  std::ostringstream text;
  text << std::ifstream(path).rdbuf();
  return text.str();
}

inline int unused_port() {
  const int fd = ::socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in a{};
  a.sin_family = AF_INET;
  a.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t size = sizeof a;
  EXPECT_EQ(::bind(fd, reinterpret_cast<const sockaddr*>(&a), size), 0);
  ::getsockname(fd, reinterpret_cast<sockaddr*>(&a), &size);
  ::close(fd);
  return ntohs(a.sin_port);
}

// One box's program. Started as often as the story wants; its report folder is the same each time.
class BoxProgram {
 public:
  BoxProgram(fs::path folder, std::string box, std::vector<std::string> road)
      : folder_(std::move(folder)),
        box_(std::move(box)),
        road_(std::move(road)),
        report_(folder_ / box_) {}
  ~BoxProgram() {
    if (pid_ == 0) return;
    ::kill(pid_, SIGKILL);
    ::waitpid(pid_, nullptr, 0);
  }
  BoxProgram(const BoxProgram&) = delete;
  BoxProgram& operator=(const BoxProgram&) = delete;

  // Before start(): where it writes; its keys, without which the road is plain; another road.
  void report_to(fs::path report) { report_ = std::move(report); }
  void use_keys(fs::path keys) { keys_ = std::move(keys); }
  void go_by(std::vector<std::string> road) { road_ = std::move(road); }
  void say_to(int pipe) { pipe_ = pipe; }  // in place of a file; output() is empty then
  [[nodiscard]] pid_t pid() const noexcept { return pid_; }

  void start() {
    std::vector<std::string> words{tests::in_build("teletact"), box_};
    if (keys_.empty())
      words.emplace_back("--plain");
    else
      words.insert(words.end(), {"--keys", keys_.string()});
    words.insert(words.end(), road_.begin(), road_.end());
    words.insert(words.end(),
                 {"--calibration", tests::in_tree("config/limits/reference_costs.toml"), "--set",
                  "operator.re_engage_after_s=0", "--report", report_});
    ++starts_;
    pid_ = ::fork();
    if (pid_ != 0) return;
    if (pipe_ >= 0)
      ::dup2(pipe_, 1);
    else
      (void)!::freopen(output_file().c_str(), "w", stdout);
    ::dup2(1, 2);
    std::vector<char*> argv;
    for (auto& w : words) argv.push_back(w.data());
    argv.push_back(nullptr);
    ::execv(argv[0], argv.data());
    ::_exit(127);
  }
  void kill_it() {
    ::kill(pid_, SIGKILL);
    ::waitpid(pid_, nullptr, 0);
    pid_ = 0;
  }
  // Exit code; -1: it did not end.
  int stop(int signal = SIGTERM) {
    ::kill(pid_, signal);
    int status = 0;
    for (int i = 0; i < static_cast<int>(kPatience_s * 100); ++i) {
      if (::waitpid(pid_, &status, WNOHANG) == pid_) {
        pid_ = 0;
        return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
      }
      ::usleep(10000);
    }
    return -1;
  }
  bool ended() {
    if (pid_ != 0 && ::waitpid(pid_, nullptr, WNOHANG) == pid_) pid_ = 0;
    return pid_ == 0;
  }
  // Null while it does not answer, or another process does.
  Json status() {
    const auto path = teletact::status_socket(box_);
    const auto answer = path ? teletact::ask_status(path.value()) : path;
    if (!answer) return {};
    const auto j = Json::parse(answer.value(), nullptr, false);
    return j.is_object() && j["pid"] == pid_ ? j : Json();
  }
  std::string output() const { return read_file(output_file()); }
  fs::path report() const { return report_ / "report.html"; }

 private:
  fs::path output_file() const { return folder_ / (box_ + std::to_string(starts_) + ".out"); }
  fs::path folder_;
  std::string box_;
  std::vector<std::string> road_;
  fs::path report_, keys_;
  pid_t pid_ = 0;
  int starts_ = 0, pipe_ = -1;
};

enum class Ending { kGood, kDisturbed, kNoRoom };

struct Boxes {
  fs::path folder;
  int port = unused_port();
  BoxProgram robot, op;
  Ending ending = Ending::kGood;

  explicit Boxes(const std::string& name, bool robot_dials)
      : folder(fs::temp_directory_path() / ("teletact-two-" + std::to_string(::getpid()) + name)),
        robot(folder, "robot", {robot_dials ? "--operator-address" : "--listen", place()}),
        op(folder, "operator", {robot_dials ? "--listen" : "--robot-address", place()}) {
    fs::remove_all(folder);
    fs::create_directories(folder);
    ::setenv("XDG_RUNTIME_DIR", folder.c_str(), 1);
    ::setenv("XDG_STATE_HOME", (folder / "state").c_str(), 1);
  }
  ~Boxes() { fs::remove_all(folder); }
  // A lab, `rover` and `ada` of it: the road is TLS from the next start on.
  void use_keys() {
    keys("init lab");
    keys("issue robot rover");
    keys("issue operator ada");
    robot.use_keys(lab() / "boxes" / "rover");
    op.use_keys(lab() / "boxes" / "ada");
  }
  void revoke_operator() {
    keys("revoke ada");
    fs::copy_file(lab() / "ca.crl", lab() / "boxes" / "rover" / "new.crl");
    fs::rename(lab() / "boxes" / "rover" / "new.crl", lab() / "boxes" / "rover" / "ca.crl");
  }
  fs::path lab() const { return folder / "lab"; }
  void keys(const std::string& words) const {
    const std::string command = tests::in_build("teletact") + " keys " + words + " --folder " +
                                lab().string() + " > " + (folder / "keys.txt").string();
    EXPECT_EQ(std::system(command.c_str()), 0) << read_file(folder / "keys.txt");
  }
  std::string place() const { return "127.0.0.1:" + std::to_string(port); }
  std::string said() const { return robot.output() + op.output(); }

  // A fault that is not of the link: this machine was too slow for the tasks just now.
  static bool disturbed(const Json& s) {
    if (!s.is_object()) return false;
    const std::string cause = s["cause"];
    for (const char* of_link : {"F-SUP-02", "F-SUP-04", "F-SUP-06", "F-SUP-07"}) {
      if (cause.rfind(of_link, 0) == 0) return false;
    }
    return !cause.empty();
  }
  // False: it never came about, and `ending` says whether the machine is to blame.
  bool until(const std::function<bool(const Json& robot, const Json& op)>& done) {
    for (int i = 0; i < static_cast<int>(kPatience_s * 20); ++i) {
      const Json r = robot.status(), o = op.status();
      if (done(r, o)) return true;
      if (disturbed(r) || disturbed(o)) {
        ending = Ending::kDisturbed;
        return false;
      }
      if (said().find("not registered") != std::string::npos) {
        ending = Ending::kNoRoom;
        return false;
      }
      ::usleep(50000);
    }
    ADD_FAILURE() << "it did not come about\nrobot: " << robot.status()
                  << "\noperator: " << op.status() << '\n'
                  << said();
    return false;
  }
};

inline bool is(const Json& s, const char* key, const char* value) {
  return s.is_object() && s[key] == value;
}
inline bool connected(const Json& s) { return is(s, "link", "connected"); }
inline bool engaged(const Json& s) { return connected(s) && is(s, "mode", "engaged"); }
inline bool waits(const Json& s) { return is(s, "mode", "hold") && !connected(s); }

}  // namespace two_boxes
