// The kernel: how it preempts, keeps time and limits real-time tasks; what it runs on.
#include <algorithm>
#include <charconv>
#include <cstdio>
#include <cstdlib>
#include <set>
#include <sstream>

#include "tools/doctor/doctor_tree.hpp"

namespace teletact::doctor {

using Level = DoctorCheck::Level;

namespace {

// major.minor of the running kernel; 0.0 if it does not say.
std::pair<int, int> kernel_release(const Tree& tree) {
  const std::string t = tree.text("/proc/sys/kernel/osrelease").value_or("");
  int major = 0, minor = 0;
  const auto r = std::from_chars(t.data(), t.data() + t.size(), major);
  if (r.ec == std::errc{} && r.ptr < t.data() + t.size() && *r.ptr == '.') {
    std::from_chars(r.ptr + 1, t.data() + t.size(), minor);
  }
  return {major, minor};
}

}  // namespace

DoctorCheck preemption(const Tree& tree) {
  DoctorCheck c{"preemption",
                "kernel preemption",
                Level::kAdvice,
                "",
                "a kernel section that can not be preempted delays every task of its core, often "
                "by 0.1 to 1 ms",
                ""};
  const std::string version = tree.text("/proc/version").value_or("");
  const std::string name =
      "Linux " + one_line(tree.text("/proc/sys/kernel/osrelease").value_or("?"), 60);
  if (tree.number("/sys/kernel/realtime").value_or(0) == 1 ||
      version.find("PREEMPT_RT") != std::string::npos) {
    c.level = Level::kFine;
    c.state = name + ", PREEMPT_RT";
    return c;
  }
  const std::string rt_todo =
      "install a real-time kernel (Debian: apt install linux-image-rt-amd64) and boot it";
  if (version.find("PREEMPT_DYNAMIC") == std::string::npos) {
    const bool full = version.find("PREEMPT") != std::string::npos;
    c.state = name + (full ? ", full preemption" : ", no preemption of kernel code");
    c.todo = rt_todo;
    return c;
  }
  // The file marks the model in force with brackets: none voluntary (full).
  std::string model = boot_value(tree, "preempt");
  if (const auto file = tree.text("/sys/kernel/debug/sched/preempt")) {
    const auto open = file->find('('), close = file->find(')');
    if (open != std::string::npos && close != std::string::npos && close > open) {
      model = file->substr(open + 1, close - open - 1);
    }
  }
  c.state = name + ", PREEMPT_DYNAMIC, model " + (model.empty() ? "unknown" : one_line(model, 30));
  c.todo = model == "full" ? rt_todo
                           : rt_todo +
                                 "; until then boot with preempt=full (or, as root: echo full "
                                 "> /sys/kernel/debug/sched/preempt)";
  return c;
}

DoctorCheck clock_source(const Tree& tree) {
  DoctorCheck c{
      "clock",
      "clock source",
      Level::kFine,
      "",
      "every release and every measurement reads the clock; a slow one costs a system call "
      "or more each time",
      ""};
  const std::string folder = "/sys/devices/system/clocksource/clocksource0/";
  const auto now = tree.text(folder + "current_clocksource");
  if (!now) {
    c.level = Level::kAdvice;
    c.state = "not visible";
    c.todo = "check with: teletact bench wakeup";
    return c;
  }
  c.state = one_line(*now, 40);
  static const std::set<std::string> good{"tsc", "arch_sys_counter", "kvm-clock",
                                          "hyperv_clocksource_tsc_page"};
  if (good.count(*now) > 0) return c;
  const std::string others = one_line(tree.text(folder + "available_clocksource").value_or(""), 80);
  // A clock that advances by the timer tick can not time a 1 ms loop at all.
  c.level = now->find("jiffies") != std::string::npos ? Level::kUnfit : Level::kAdvice;
  c.todo =
      (" " + others + " ").find(" tsc ") != std::string::npos
          ? "as root: echo tsc > " + folder + "current_clocksource"
          : "the kernel has found the TSC unstable (dmesg says why); try tsc=reliable, another "
            "BIOS setting or another machine";
  return c;
}

DoctorCheck throttling(const Tree& tree) {
  DoctorCheck c{"throttle",
                "real-time throttling",
                Level::kFine,
                "",
                "the kernel stops all real-time tasks for the rest of each period once they have "
                "used their share",
                ""};
  const auto runtime = tree.number("/proc/sys/kernel/sched_rt_runtime_us");
  const auto period = tree.number("/proc/sys/kernel/sched_rt_period_us");
  if (!runtime || !period || *period <= 0) {
    c.state = "not visible";
    return c;
  }
  if (*runtime < 0) {
    c.state = "off: nothing stops a real-time task that never sleeps but the watchdog";
    return c;
  }
  const double share = static_cast<double>(*runtime) / static_cast<double>(*period);
  char text[64];
  std::snprintf(text, sizeof text, "%.0f %% of each %.0f ms", 100 * share,
                static_cast<double>(*period) / 1000);
  c.state = text;
  if (share >= 0.949) return c;  // admission stops at 0.90
  c.level = share < 0.90 ? Level::kUnfit : Level::kAdvice;
  c.todo = "as root: sysctl kernel.sched_rt_runtime_us=" +
           std::to_string(static_cast<long long>(0.95 * static_cast<double>(*period)));
  return c;
}

DoctorCheck fair_server(const Tree& tree) {
  DoctorCheck c{"fair_server",
                "fair server",
                Level::kFine,
                "",
                "from Linux 6.12 on, ordinary tasks that starve get 50 ms of each second before "
                "real-time ones: a hole of 53 ms was measured",
                ""};
  const auto [major, minor] = kernel_release(tree);
  const std::string folder = "/sys/kernel/debug/sched/fair_server";
  const auto cpus = tree.numbered(folder, "cpu");
  if (cpus.empty()) {
    if (major > 0 && (major < 6 || (major == 6 && minor < 12))) {
      c.state = "none in this kernel";
      return c;
    }
    c.level = Level::kAdvice;
    c.state = "present in such kernels, not visible here";
    c.todo = "as root, mount debugfs and look at " + folder +
             "; keep ordinary load off the real-time cores, then it never steps in";
    return c;
  }
  const auto isolated = isolated_cpus(tree);
  const std::set<int> quiet(isolated.begin(), isolated.end());
  double worst = 0;
  for (const auto& cpu : cpus) {
    if (!quiet.empty() && quiet.count(std::atoi(cpu.c_str() + 3)) == 0) continue;
    const double runtime =
        static_cast<double>(tree.number(folder + "/" + cpu + "/runtime").value_or(0));
    worst = std::max(worst, runtime * 1e-6);
  }
  if (worst <= 0) {
    c.state = "off on the real-time cores";
    return c;
  }
  char text[64];
  std::snprintf(text, sizeof text, "up to %.0f ms each period", worst);
  c.state = text;
  c.level = Level::kAdvice;
  c.todo = "as root, for each real-time core N: echo 0 > " + folder +
           "/cpuN/runtime; without it keep real-time load plus ordinary load below 0.90";
  return c;
}

DoctorCheck virtualisation(const Tree& tree) {
  DoctorCheck c{
      "virtual",
      "virtual machine",
      Level::kFine,
      "no sign of one",
      "a host may stop a whole core of a guest for milliseconds, and the guest can not see "
      "why",
      ""};
  std::istringstream lines(tree.text("/proc/cpuinfo").value_or(""));
  for (std::string line; std::getline(lines, line);) {
    if (line.compare(0, 5, "flags") != 0) continue;
    if ((line + " ").find(" hypervisor ") == std::string::npos) break;
    c.level = Level::kAdvice;
    c.state = "this is a guest";
    c.todo =
        "use bare metal with the device; on a guest trust the virtual clock and CPU figures only";
    break;
  }
  return c;
}

}  // namespace teletact::doctor
