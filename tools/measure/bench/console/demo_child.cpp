#include "tools/measure/bench/console/demo_child.hpp"

#include <fcntl.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <stdexcept>
#include <utility>

#include "tools/measure/bench/callgrind.hpp"
#include "tools/scene/scene.hpp"

namespace teletact {

namespace {

namespace fs = std::filesystem;

constexpr double kStart_s = 90;  // until the address is told
constexpr double kEnd_s = 120;   // for ramp and report

[[noreturn]] void become(const std::vector<std::string>& words) {
  std::vector<char*> argv;
  for (const auto& w : words) argv.push_back(const_cast<char*>(w.c_str()));
  argv.push_back(nullptr);
  ::execvp(argv[0], argv.data());
  ::_exit(127);
}

std::string text_of(const std::string& file) {
  std::ifstream in(file);
  std::ostringstream all;
  all << in.rdbuf();
  return all.str();
}

std::vector<std::string> demo_words(const std::string& folder, std::vector<std::string> more) {
  std::vector<std::string> words{own_folder() + "/teletact",
                                 "demo",
                                 "--clock",
                                 "real",
                                 "--console",
                                 "--quiet",
                                 "--report",
                                 folder,
                                 "--calibration",
                                 find_config("limits", "reference_costs")};
  words.insert(words.end(), more.begin(), more.end());
  return words;
}

}  // namespace

BenchFolder::BenchFolder() : path_((fs::temp_directory_path() / "teletact_page_XXXXXX").string()) {
  if (::mkdtemp(path_.data()) == nullptr) throw std::runtime_error(path_ + ": can not be made");
}
BenchFolder::~BenchFolder() {
  std::error_code ignored;
  fs::remove_all(path_, ignored);
}

ChildProgram::ChildProgram(const std::vector<std::string>& words, std::string output, bool feed)
    : output_(std::move(output)) {
  std::array<int, 2> in{-1, -1};
  if (feed && ::pipe2(in.data(), O_CLOEXEC) != 0) throw std::runtime_error("no pipe");
  pid_ = ::fork();
  if (pid_ < 0) throw std::runtime_error("fork failed");
  if (pid_ == 0) {
    ::prctl(PR_SET_PDEATHSIG, SIGTERM);
    const int out = ::open(output_.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
    ::dup2(feed ? in[0] : ::open("/dev/null", O_RDONLY | O_CLOEXEC), 0);
    ::dup2(out, 1);
    ::dup2(out, 2);
    become(words);
  }
  if (feed) ::close(in[0]);
  input_ = in[1];
}

ChildProgram::~ChildProgram() {
  end_input();
  if (wait_for(0) >= 0) return;
  ask_to_end();
  if (wait_for(5) >= 0) return;
  ::kill(pid_, SIGKILL);
  (void)wait_for(5);
}

void ChildProgram::end_input() {
  if (input_ >= 0) ::close(std::exchange(input_, -1));
}

void ChildProgram::ask_to_end() const {
  if (pid_ > 0) ::kill(pid_, SIGTERM);
}

int ChildProgram::wait_for(double seconds) {
  for (int i = 0; pid_ > 0 && i <= static_cast<int>(100 * seconds); ++i) {
    int status = 0;
    if (::waitpid(pid_, &status, WNOHANG) == pid_) {
      pid_ = -1;
      code_ = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
      break;
    }
    if (seconds > 0) ::usleep(10000);
  }
  return code_;
}

std::string ChildProgram::said() const { return text_of(output_); }

std::string ChildProgram::last_line() const {
  std::istringstream in(said());
  std::string last;
  for (std::string line; std::getline(in, line);)
    if (!line.empty()) last = line;
  return last;
}

PagedDemo::PagedDemo(const std::string& folder, std::vector<std::string> words)
    : folder_(folder), child_(demo_words(folder, std::move(words)), folder + ".said") {
  const std::string before = "console: ";
  for (int i = 0; i < static_cast<int>(50 * kStart_s); ++i) {
    const std::string text = child_.said();
    const auto at = text.find(before);
    const auto end = at == text.npos ? at : text.find('\n', at);
    if (end != text.npos) {
      url_ = text.substr(at + before.size(), end - at - before.size());
      return;
    }
    if (child_.wait_for(0.02) >= 0) break;
  }
  throw std::runtime_error("teletact demo did not come up: " + child_.last_line());
}

void PagedDemo::end() {
  child_.ask_to_end();
  const int code = child_.wait_for(kEnd_s);
  // 1: its report names a problem of the machine's; the run is whole all the same.
  if (code != 0 && code != 1) problem = "demo ended with " + std::to_string(code);
  const std::string raw = folder_ + "/raw";
  load_half(raw, op);
  load_half(raw, robot);
  figures = nlohmann::json::parse(text_of(raw + "/console.json"), nullptr, false);
  if (!op.complete || !robot.complete)
    problem = "demo did not reach its end: " + child_.last_line();
  const std::string missing = text_of(raw + "/not_realtime");
  if (problem.empty() && !missing.empty())
    problem = "no real clock here: " + missing.substr(0, missing.find('\n'));
}

std::string page_script() {
  const std::string file = own_folder() + "/console_page/run/measure.mjs";
  return fs::exists(file) ? file : std::string();
}

std::string no_browser() {
  if (page_script().empty()) return "the page's scripts are not built here";
  if (!fs::exists("/usr/bin/chromium")) return "no chromium (apt-get install chromium)";
  return {};
}

nlohmann::json run_page_script(const std::vector<std::string>& words, const std::string& folder,
                               double most_s) {
  std::vector<std::string> all{"node", page_script()};
  all.insert(all.end(), words.begin(), words.end());
  ChildProgram child(all, folder + "/script.said");
  if (const int code = child.wait_for(most_s); code != 0)
    throw std::runtime_error("the page's script ended with " + std::to_string(code) + ": " +
                             child.last_line());
  auto json = nlohmann::json::parse(child.last_line(), nullptr, false);
  if (!json.is_object()) throw std::runtime_error("the page's script said no figures");
  return json;
}

}  // namespace teletact
