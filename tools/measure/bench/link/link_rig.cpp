#include "tools/measure/bench/link/link_rig.hpp"

#include <fcntl.h>
#include <poll.h>
#include <sched.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <stdexcept>
#include <thread>

#include "rt/clock/box_time.hpp"
#include "tools/box/box_status.hpp"
#include "tools/keys/key_lab.hpp"
#include "tools/measure/bench/other_load.hpp"
#include "tools/measure/tun_road/tun_device.hpp"
#include "tools/scene/scene.hpp"

namespace teletact {

namespace {

namespace fs = std::filesystem;
using Words = std::vector<std::string>;

constexpr int kPort = 47110;
constexpr const char* kRobotAddress = "10.77.0.2";
// A box's own lead, the hand-shake over a slow road, its report.
constexpr double kMoreSeconds = 90;
constexpr int kReady_ms = 5000;

bool shell(const std::string& command) {
  return std::system((command + " >/dev/null 2>&1").c_str()) == 0;
}

// Into the namespace, for good; in a process of its own.
bool enter(const std::string& ns) {
  const int fd = ::open(("/run/netns/" + ns).c_str(), O_RDONLY | O_CLOEXEC);
  return fd >= 0 && ::setns(fd, CLONE_NEWNET) == 0;
}

[[noreturn]] void become(const Words& words) {
  std::vector<char*> argv;
  for (const auto& w : words) argv.push_back(const_cast<char*>(w.c_str()));
  argv.push_back(nullptr);
  ::execv(argv[0], argv.data());
  ::_exit(127);
}

// A program with its output in a file (or in a pipe); ended with the object.
class Child {
 public:
  Child() = default;
  ~Child() {
    if (pid_ <= 0) return;
    ::kill(pid_, SIGKILL);
    (void)wait_for(2);
  }
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;

  // `ns` empty: in this one. `folder`: of the box's status socket.
  void start(const Words& words, const std::string& ns, const std::string& folder,
             const std::string& output) {
    pid_ = ::fork();
    if (pid_ != 0) return;
    if (!ns.empty() && !enter(ns)) ::_exit(126);
    ::setenv("XDG_RUNTIME_DIR", folder.c_str(), 1);
    ::setenv("XDG_STATE_HOME", folder.c_str(), 1);
    const int fd = ::open(output.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
    ::dup2(fd, 1);
    ::dup2(fd, 2);
    become(words);
  }
  // Its output to `out`, its messages to `err`.
  void start(const Words& words, int out, int err) {
    pid_ = ::fork();
    if (pid_ != 0) return;
    ::dup2(out, 1);
    ::dup2(err, 2);
    become(words);
  }
  void ask_to_end() const {
    if (pid_ > 0) ::kill(pid_, SIGTERM);
  }
  // Exit code; -1: it still runs.
  int wait_for(double seconds) {
    for (int i = 0; pid_ > 0 && i < static_cast<int>(100 * seconds) + 1; ++i) {
      int status = 0;
      if (::waitpid(pid_, &status, WNOHANG) == pid_) {
        pid_ = 0;
        return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
      }
      ::usleep(10000);
    }
    return -1;
  }

 private:
  pid_t pid_ = 0;
};

// teletact-road, from "ready" on.
class RoadProgram {
 public:
  explicit RoadProgram(const Words& words) {
    std::array<int, 2> err{};
    if (::pipe2(out_.data(), O_CLOEXEC) != 0 || ::pipe2(err.data(), O_CLOEXEC) != 0)
      throw std::runtime_error(std::string("pipe: ") + std::strerror(errno));
    child_.start(words, out_[1], err[1]);
    ::close(out_[1]);
    ::close(err[1]);
    std::string said;
    char c = 0;
    pollfd p{err[0], POLLIN, 0};
    while (::poll(&p, 1, kReady_ms) > 0 && ::read(err[0], &c, 1) == 1 && c != '\n') said += c;
    epoch_ns = rt::monotonic_ns();
    ::close(err[0]);
    if (said != "teletact-road: ready") throw std::runtime_error(said.empty() ? "no road" : said);
  }
  ~RoadProgram() { ::close(out_[0]); }
  RoadProgram(const RoadProgram&) = delete;
  RoadProgram& operator=(const RoadProgram&) = delete;

  // What it has counted; discarded JSON where it said nothing.
  [[nodiscard]] nlohmann::json end() {
    child_.ask_to_end();
    std::string text;
    std::array<char, 4096> part{};
    for (ssize_t n = 0; (n = ::read(out_[0], part.data(), part.size())) > 0;)
      text.append(part.data(), static_cast<std::size_t>(n));
    (void)child_.wait_for(5);
    return nlohmann::json::parse(text, nullptr, false);
  }
  std::int64_t epoch_ns = 0;

 private:
  Child child_;
  std::array<int, 2> out_{};
};

std::string congestion_now(const std::string& folder, const char* box) {
  const auto answer = ask_status(folder + "/teletact/" + box + ".sock");
  if (!answer) return {};
  const auto j = nlohmann::json::parse(answer.value(), nullptr, false);
  return j.is_object() ? j.value("congestion", std::string()) : std::string();
}

std::string last_lines(const std::string& file) {
  std::ifstream in(file);
  std::string last, before;
  for (std::string line; std::getline(in, line);) {
    if (line.empty()) continue;
    before = std::exchange(last, line);
  }
  return before.empty() ? last : before + " / " + last;
}

constexpr const char* kCalibration = "calibration.toml";

Words box_words(const std::string& program, const char* box, const RigRun& what,
                const std::string& folder, const std::string& lab) {
  const bool robot = std::string(box) == "robot";
  char rate[32], seconds[32];
  std::snprintf(rate, sizeof rate, "%g", what.rate_Mbit_per_s);
  std::snprintf(seconds, sizeof seconds, "%g", what.seconds);
  Words words{
      program,
      box,
      "--scene",
      find_config("scenes", what.scene),
      "--keys",
      lab + "/boxes/" + box,
      "--rate",
      rate,
      "--seconds",
      seconds,
      "--report",
      folder + "/" + box,
      "--one-host",
      "--calibration",
      what.calibration ? folder + "/" + kCalibration : find_config("limits", "reference_costs")};
  const std::string place = std::string(kRobotAddress) + ":" + std::to_string(kPort);
  words.insert(words.end(), {robot ? "--listen" : "--robot-address", place});
  if (what.record && !robot) words.emplace_back("--record");
  for (const auto& key : what.keys) words.insert(words.end(), {"--set", key});
  return words;
}

std::string beside(const std::string& folder, const std::string& name,
                   const std::string& installed) {
  std::error_code failed;
  const fs::path own =
      folder.empty() ? fs::read_symlink("/proc/self/exe", failed).parent_path() : fs::path(folder);
  for (const auto& path : {own / name, (own / installed / name).lexically_normal()}) {
    if (::access(path.c_str(), X_OK) == 0) return path.string();
  }
  throw std::runtime_error(name + " is not beside " + own.string());
}

}  // namespace

std::string link_rig_refusal() {
  if (const auto why = road_refusal(); !why.empty()) return why;
  const std::string probe = "tlink-p" + std::to_string(::getpid());
  if (!shell("ip netns add " + probe))
    return "no network namespace can be made here (ip netns add)";
  (void)shell("ip netns del " + probe);
  return {};
}

LinkRig::LinkRig(const std::string& programs)
    : left_("tlink-l" + std::to_string(::getpid())),
      right_("tlink-r" + std::to_string(::getpid())),
      program_(beside(programs, "teletact", "../../bin")),
      road_program_(beside(programs, "teletact-road", ".")) {
  std::string name = (fs::temp_directory_path() / "teletact_link_XXXXXX").string();
  if (::mkdtemp(name.data()) == nullptr) throw std::runtime_error(name + ": can not be made");
  folder_ = name;
  if (!shell("ip netns add " + left_) || !shell("ip netns add " + right_))
    throw std::runtime_error("no network namespace can be made here (ip netns add)");
  const std::int64_t now_s = std::time(nullptr);
  const std::string lab = folder_ + "/lab";
  if (auto ok = KeyLab::init(lab, "bench", 2, now_s); !ok) throw std::runtime_error(ok.error());
  auto made = KeyLab::open(lab);
  if (!made) throw std::runtime_error(made.error());
  for (const auto box : {rt::Box::kRobot, rt::Box::kOperator}) {
    const auto ok =
        made.value().issue(box, box == rt::Box::kRobot ? "robot" : "operator", 1, now_s);
    if (!ok) throw std::runtime_error(ok.error());
  }
}

LinkRig::~LinkRig() {
  (void)shell("ip netns del " + left_);
  (void)shell("ip netns del " + right_);
  std::error_code ignored;
  fs::remove_all(folder_, ignored);
}

RigResult LinkRig::run(const RigRun& what) const {
  RigResult out;
  out.folder = folder_ + "/" + what.name;
  fs::create_directories(out.folder);
  if (what.calibration) tasks::save_calibration(out.folder + "/" + kCalibration, *what.calibration);
  Words road{road_program_, "--left", left_, "--right", right_};
  for (const auto& key : what.road) road.insert(road.end(), {"--set", key});
  OtherLoad others;
  RoadProgram line(road);
  out.road_epoch_ns = line.epoch_ns;
  int code_robot = -1, code_op = -1;
  {
    Child robot, op;
    robot.start(box_words(program_, "robot", what, out.folder, folder_ + "/lab"), right_,
                out.folder, out.folder + "/robot.out");
    op.start(box_words(program_, "operator", what, out.folder, folder_ + "/lab"), left_, out.folder,
             out.folder + "/operator.out");
    for (int i = 0; i < static_cast<int>(what.seconds + kMoreSeconds) && code_op < 0; ++i) {
      if (code_robot < 0) code_robot = robot.wait_for(0.5);
      code_op = op.wait_for(0.5);
      if (const auto now = congestion_now(out.folder, "robot"); !now.empty())
        out.robot_congestion = now;
      if (const auto now = congestion_now(out.folder, "operator"); !now.empty())
        out.operator_congestion = now;
      if (code_robot > 1) break;
    }
    if (code_robot < 0) code_robot = robot.wait_for(kMoreSeconds);
  }
  const auto counted = line.end();
  out.others_cores = others.cores();
  if (counted.is_object()) {
    out.road_busy_Mbit_per_s = counted["to_left"].value("busy_Mbit_per_s", 0.0);
    out.road_late_p95_us = counted["late_us"].value("p95", 0.0);
  }
  load_half(out.folder + "/operator/raw", out.op);
  load_half(out.folder + "/robot/raw", out.robot);
  // 1: its report names a problem of the machine's; the run is whole all the same.
  const auto bad = [&](const char* box, int code, bool complete) {
    if ((code == 0 || code == 1) && complete) return;
    out.problem += std::string(out.problem.empty() ? "" : "; ") + box + " ended with " +
                   std::to_string(code) + ": " + last_lines(out.folder + "/" + box + ".out");
  };
  bad("robot", code_robot, out.robot.complete);
  bad("operator", code_op, out.op.complete);
  return out;
}

}  // namespace teletact
