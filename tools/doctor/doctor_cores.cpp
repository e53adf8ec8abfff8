// Cores, what else runs on them, and who shares them.
#include <algorithm>
#include <cstdio>
#include <set>
#include <sstream>

#include "tools/doctor/doctor_tree.hpp"

namespace teletact::doctor {

using Level = DoctorCheck::Level;

namespace {

bool irqbalance_runs(const Tree& tree) {
  for (const auto& pid : tree.numbered("/proc", "")) {
    if (tree.text("/proc/" + pid + "/comm").value_or("") == "irqbalance") return true;
  }
  return false;
}

}  // namespace

DoctorCheck cores(const Tree& tree) {
  DoctorCheck c{"cores",
                "isolated cores",
                Level::kAdvice,
                "",
                "on a shared core every ordinary program's kernel work delays the force loop",
                ""};
  const auto online = parse_cpu_list(tree.text("/sys/devices/system/cpu/online").value_or(""));
  const auto isolated = isolated_cpus(tree);
  const auto nohz = parse_cpu_list(tree.text("/sys/devices/system/cpu/nohz_full").value_or(""));
  c.state = std::to_string(online.size()) + " online, isolated " + list_text(isolated) +
            ", without tick " + list_text(nohz);
  if (online.size() < 2) {
    c.level = Level::kUnfit;
    c.todo = "use a machine with two cores or more";
  } else if (isolated.empty()) {
    const int last = online.back();
    const int first = online.size() >= 4 ? online[online.size() - 2] : last;
    const std::string set = list_text(first == last ? std::vector{last} : std::vector{first, last});
    c.todo = "boot with isolcpus=managed_irq,domain," + set + " nohz_full=" + set +
             " rcu_nocbs=" + set +
             " (teletact uses only CPUs of its affinity mask: start it with "
             "taskset)";
  } else {
    c.level = Level::kFine;
  }
  return c;
}

namespace {

// Path of this process in a hierarchy, from a line "5:cpu,cpuacct:/path" of /proc/self/cgroup
// ("0::/path" for the unified one). Empty: not in it.
std::optional<std::string> group_of(const Tree& tree, const std::string& controller) {
  std::istringstream lines(tree.text("/proc/self/cgroup").value_or(""));
  for (std::string line; std::getline(lines, line);) {
    const auto first = line.find(':');
    const auto second = line.find(':', first == std::string::npos ? first : first + 1);
    if (second == std::string::npos) continue;
    const std::string names = "," + line.substr(first + 1, second - first - 1) + ",";
    if (names == ",,") {
      if (controller.empty()) return line.substr(second + 1);
    } else if (!controller.empty() && names.find("," + controller + ",") != std::string::npos) {
      return line.substr(second + 1);
    }
  }
  return std::nullopt;
}

// A container sees its own group at the top and may know its path from outside: folders that are
// not there are passed over.
template <class Read>
void up_the_groups(const std::string& mount, std::string path, const Read& read) {
  while (!path.empty() && path.back() == '/') path.pop_back();
  for (;;) {
    read(mount + path);
    const auto slash = path.rfind('/');
    if (slash == std::string::npos) return;
    path.resize(slash);
  }
}

}  // namespace

std::optional<double> quota_cores(const Tree& tree) {
  std::optional<double> least;
  const auto take = [&](double quota, double period) {
    if (quota > 0 && period > 0) least = std::min(least.value_or(quota / period), quota / period);
  };
  if (const auto path = group_of(tree, "")) {
    up_the_groups("/sys/fs/cgroup", *path, [&](const std::string& folder) {
      std::istringstream words(tree.text(folder + "/cpu.max").value_or(""));
      double quota = 0, period = 0;
      if (words >> quota >> period) take(quota, period);  // "max 100000" is no number
    });
  }
  if (const auto path = group_of(tree, "cpu")) {
    for (const char* mount : {"/sys/fs/cgroup/cpu", "/sys/fs/cgroup/cpu,cpuacct"}) {
      up_the_groups(mount, *path, [&](const std::string& folder) {
        const auto quota = tree.number(folder + "/cpu.cfs_quota_us");  // -1: none
        const auto period = tree.number(folder + "/cpu.cfs_period_us");
        if (quota && period) take(static_cast<double>(*quota), static_cast<double>(*period));
      });
    }
  }
  return least;
}

DoctorCheck quota(const Tree& tree) {
  DoctorCheck c{
      "quota",
      "CPU quota",
      Level::kFine,
      "none",
      "a container that has used up its share of a period stands still until the next one",
      ""};
  const auto cores = quota_cores(tree);
  if (!cores) return c;
  char text[60];
  std::snprintf(text, sizeof text, "time of %.2g cores", *cores);
  c.state = text;
  c.level = *cores < 2 ? Level::kUnfit : Level::kAdvice;
  c.todo =
      "start the container without a quota (--cpus), or keep it to cores of its own "
      "(--cpuset-cpus)";
  return c;
}

DoctorCheck interrupts(const Tree& tree) {
  DoctorCheck c{"irq",
                "interrupt affinity",
                Level::kFine,
                "",
                "an interrupt and its work run before every task of the core it is sent to",
                ""};
  const auto isolated = isolated_cpus(tree);
  const std::set<int> quiet(isolated.begin(), isolated.end());
  int total = 0, on_quiet = 0;
  std::string names;
  for (const auto& irq : tree.numbered("/proc/irq", "")) {
    // The effective mask where the kernel shows it: the other one is only a wish.
    auto where = tree.text("/proc/irq/" + irq + "/effective_affinity_list");
    if (!where || where->empty()) where = tree.text("/proc/irq/" + irq + "/smp_affinity_list");
    if (!where || where->empty()) continue;
    ++total;
    const auto cpus = parse_cpu_list(*where);
    if (std::none_of(cpus.begin(), cpus.end(), [&](int p) { return quiet.count(p) > 0; })) continue;
    if (++on_quiet <= 8) names += (names.empty() ? "" : ",") + irq;
  }
  const bool balance = irqbalance_runs(tree);
  c.state = std::to_string(total) + " interrupts";
  if (total == 0) {
    c.state = "not visible";
  } else if (quiet.empty()) {
    c.state += ", no isolated core to keep them off";
    c.level = Level::kAdvice;
    c.todo = "isolate a core first, then boot with irqaffinity= naming the other cores";
  } else if (on_quiet > 0) {
    c.state += ", " + std::to_string(on_quiet) + " on isolated cores (" + names +
               (on_quiet > 8 ? ",..." : "") + ")";
    c.level = Level::kAdvice;
    c.todo =
        "as root: echo the other cores into /proc/irq/N/smp_affinity_list, or boot with "
        "irqaffinity= naming them";
  } else {
    c.state += ", none on isolated cores";
  }
  if (balance) {
    c.state += "; irqbalance runs";
    if (!quiet.empty()) c.level = std::max(c.level, Level::kAdvice);
    c.todo += std::string(c.todo.empty() ? "" : "; ") +
              "stop irqbalance or set IRQBALANCE_BANNED_CPULIST to the isolated cores";
  }
  return c;
}

DoctorCheck smt(const Tree& tree) {
  DoctorCheck c{"smt",
                "simultaneous multi-threading",
                Level::kFine,
                "",
                "a busy sibling takes up to half of a core's speed from the task beside it, so a "
                "budget measured alone does not hold",
                ""};
  const auto active = tree.number("/sys/devices/system/cpu/smt/active");
  if (!active) {
    c.state = "not visible";
    return c;
  }
  if (*active == 0) {
    c.state = "off";
    return c;
  }
  c.state = "on";
  c.level = Level::kAdvice;
  c.todo =
      "as root: echo off > /sys/devices/system/cpu/smt/control, or boot with nosmt; else isolate "
      "whole cores, siblings together";
  const auto isolated = isolated_cpus(tree);
  const std::set<int> quiet(isolated.begin(), isolated.end());
  bool split = false;
  for (const int cpu : isolated) {
    const auto siblings =
        parse_cpu_list(tree.text("/sys/devices/system/cpu/cpu" + std::to_string(cpu) +
                                 "/topology/thread_siblings_list")
                           .value_or(""));
    for (const int s : siblings) split |= quiet.count(s) == 0;
  }
  if (!isolated.empty()) {
    c.state += split ? ", an isolated core shares with one that is not"
                     : ", isolated cores keep their siblings to themselves";
    if (!split) c.level = Level::kFine, c.todo.clear();
  }
  return c;
}

}  // namespace teletact::doctor
