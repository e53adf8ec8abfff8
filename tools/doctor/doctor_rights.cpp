// What this user may ask for.
#include <cctype>
#include <cstdlib>
#include <limits>
#include <sstream>

#include "tools/doctor/doctor_tree.hpp"

namespace teletact::doctor {

using Level = DoctorCheck::Level;

namespace {

constexpr int kCapNetRaw = 13, kCapIpcLock = 14, kCapSysNice = 23;

bool has(unsigned long long caps, int bit) { return (caps >> bit & 1U) != 0; }

}  // namespace

Limits limits_of(const Tree& tree) {
  Limits l;
  std::istringstream lines(tree.text("/proc/self/limits").value_or(""));
  for (std::string line; std::getline(lines, line);) {
    for (auto& [name, value] : {std::pair{std::string("Max realtime priority"), &l.rtprio},
                                std::pair{std::string("Max locked memory"), &l.memlock}}) {
      if (line.compare(0, name.size(), name) != 0) continue;
      std::istringstream words(line.substr(name.size()));
      std::string soft;
      words >> soft;
      if (soft == "unlimited") {
        *value = std::numeric_limits<double>::infinity();
      } else if (!soft.empty() && std::isdigit(static_cast<unsigned char>(soft[0])) != 0) {
        *value = std::strtod(soft.c_str(), nullptr);
      }
    }
  }
  std::istringstream status(tree.text("/proc/self/status").value_or(""));
  for (std::string line; std::getline(status, line);) {
    if (line.compare(0, 12, "NoNewPrivs:\t") == 0) l.no_new_privileges = line[12] == '1';
    const unsigned long long caps =
        line.size() > 7 ? std::strtoull(line.c_str() + 7, nullptr, 16) : 0;
    if (line.compare(0, 7, "CapEff:") == 0) {
      l.cap_nice = has(caps, kCapSysNice);
      l.cap_lock = has(caps, kCapIpcLock);
      l.cap_raw = has(caps, kCapNetRaw);
    } else if (line.compare(0, 7, "CapBnd:") == 0) {
      l.bounding_nice = has(caps, kCapSysNice);
      l.bounding_lock = has(caps, kCapIpcLock);
    }
  }
  return l;
}

DoctorCheck rtprio(const Tree& tree) {
  DoctorCheck c{
      "rtprio",
      "real-time priority",
      Level::kUnfit,
      "",
      "without SCHED_FIFO any ordinary program may run before the force loop",
      "tools/run --rights (capabilities for the program), or give the group of the user rtprio 98 "
      "in /etc/security/limits.d (config/system/limits.d has the file) and log in again"};
  const Limits l = limits_of(tree);
  if (l.cap_nice) {
    c.level = Level::kFine;
    c.state = "allowed by CAP_SYS_NICE";
  } else if (!l.rtprio) {
    c.level = Level::kAdvice;
    c.state = "limit can not be read";
  } else {
    c.state = "limit " + std::to_string(static_cast<long>(std::min(*l.rtprio, 999.0)));
    // A sentinel has 95, the watchdog 94.
    if (*l.rtprio >= 95)
      c.level = Level::kFine;
    else if (*l.rtprio >= 1)
      c.level = Level::kAdvice;
  }
  if (c.level == Level::kFine) c.todo.clear();
  return c;
}

DoctorCheck memlock(const Tree& tree) {
  DoctorCheck c{
      "memlock",
      "locked memory",
      Level::kUnfit,
      "",
      "memory that is not locked can fault inside a job: 1 us at best, the disk at worst",
      "tools/run --rights (capabilities for the program), or give the group of the user memlock "
      "unlimited in /etc/security/limits.d (config/system/limits.d has the file) and log in again"};
  constexpr double kNeeded = 2048.0 * 1024 * 1024;  // map, channels and stacks of both boxes
  const Limits l = limits_of(tree);
  if (l.cap_lock) {
    c.level = Level::kFine;
    c.state = "allowed by CAP_IPC_LOCK";
  } else if (!l.memlock) {
    c.level = Level::kAdvice;
    c.state = "limit can not be read";
  } else {
    const bool unlimited = *l.memlock > 1e18;
    c.state = unlimited ? "unlimited"
                        : "limit " + std::to_string(static_cast<long long>(*l.memlock / 1048576)) +
                              " MiB, 2048 MiB are asked for";
    if (*l.memlock >= kNeeded) c.level = Level::kFine;
  }
  if (c.level == Level::kFine) c.todo.clear();
  return c;
}

}  // namespace teletact::doctor
