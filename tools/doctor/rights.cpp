#include "tools/doctor/rights.hpp"

#include <pthread.h>
#include <sched.h>

#include <cstdio>
#include <cstring>
#include <filesystem>
#include <thread>

#include "rt/sched/admission.hpp"
#include "tools/doctor/doctor_tree.hpp"

namespace teletact {

namespace {

// Highest thread of a run without injected faults: a sentinel.
constexpr int kHighestPriority = 95;

// On a thread of its own, which ends with the answer.
std::string try_fifo() {
  int error = 0;
  std::thread([&] {
    sched_param param{};
    param.sched_priority = kHighestPriority;
    error = pthread_setschedparam(pthread_self(), SCHED_FIFO | SCHED_RESET_ON_FORK, &param);
  }).join();
  return error == 0 ? "" : std::strerror(error);
}

std::string in_a_shell(const std::string& path) {
  if (path.find_first_not_of(
          "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-./+") ==
      std::string::npos)
    return path;
  std::string out = "'";
  for (const char c : path) out += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return out + "'";
}

void add_command(const doctor::Limits& limits, const RightsAsked& asked, bool rights_missing,
                 Rights& r) {
  if (!rights_missing) {
    r.command = "give it the time of two cores (taskset, the container's --cpus)";
    return;
  }
  r.command = "sudo setcap cap_sys_nice,cap_ipc_lock=ep " + in_a_shell(asked.program);
  // A file that asks for more than the bounding set holds does not even start.
  if (!limits.bounding_nice || !limits.bounding_lock) {
    r.command +=
        " (in a session or container that may have them: --cap-add SYS_NICE --cap-add IPC_LOCK)";
  } else if (limits.no_new_privileges) {
    r.command += " (in a session or container without no-new-privileges)";
  }
}

}  // namespace

std::string Rights::why() const {
  std::string all;
  for (const auto& one : lacks) all += (all.empty() ? "" : ", ") + one;
  return all;
}

Rights find_rights(const RightsAsked& asked) {
  const doctor::Tree tree(asked.root);
  const doctor::Limits limits = doctor::limits_of(tree);
  Rights r;
  // The limit is what a user can look up; what was tried is what counts.
  if (!asked.no_fifo.empty()) {
    r.lacks.push_back("no real-time priority (" + doctor::rtprio(tree).state + ": " +
                      asked.no_fifo + ")");
  }
  const DoctorCheck memory = doctor::memlock(tree);
  if (memory.level == DoctorCheck::Level::kUnfit)
    r.lacks.push_back("memory can not be locked (" + memory.state + ")");
  const bool rights_missing = !r.lacks.empty();
  if (asked.cpus < 2) {
    r.lacks.emplace_back("one core");
  } else if (const auto quota = doctor::quota_cores(tree); quota && *quota < 2) {
    char text[60];
    std::snprintf(text, sizeof text, "a CPU quota of %.2g cores", *quota);
    r.lacks.emplace_back(text);
  }
  if (!r.lacks.empty()) add_command(limits, asked, rights_missing, r);
  return r;
}

Rights find_rights(const std::string& root) {
  std::error_code none;
  const auto link = std::filesystem::read_symlink("/proc/self/exe", none);
  const std::string program = none ? "teletact" : link.string();
  if (root.empty())
    return find_rights({"", program, static_cast<int>(rt::affinity_cpus().size()), try_fifo()});
  const doctor::Tree tree(root);
  const auto online = parse_cpu_list(tree.text("/sys/devices/system/cpu/online").value_or(""));
  const bool may = doctor::rtprio(tree).level == DoctorCheck::Level::kFine;
  return find_rights({root, program, static_cast<int>(online.size()), may ? "" : "too low"});
}

}  // namespace teletact
