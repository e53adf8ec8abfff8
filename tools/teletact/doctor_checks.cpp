#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <optional>
#include <set>
#include <sstream>

#include "tools/teletact/doctor.hpp"

namespace teletact {

namespace {

namespace fs = std::filesystem;
using Level = DoctorCheck::Level;

constexpr int kCapIpcLock = 14, kCapSysNice = 23;

// The tree under test. Everything unreadable is "not there": a doctor must not fall ill itself.
class Tree {
 public:
  explicit Tree(std::string root) : root_(std::move(root)) {}

  [[nodiscard]] std::string at(const std::string& path) const { return root_ + path; }
  [[nodiscard]] std::optional<std::string> text(const std::string& path) const {
    struct stat info {};
    if (stat(at(path).c_str(), &info) != 0 || !S_ISREG(info.st_mode)) return std::nullopt;
    std::ifstream in(at(path), std::ios::binary);
    if (!in) return std::nullopt;
    std::string out(1U << 16U, '\0');
    in.read(out.data(), static_cast<std::streamsize>(out.size()));
    out.resize(static_cast<std::size_t>(in.gcount()));
    if (in.bad() || (out.empty() && !in.eof())) return std::nullopt;
    while (!out.empty() && std::isspace(static_cast<unsigned char>(out.back())) != 0)
      out.pop_back();
    return out;
  }
  [[nodiscard]] std::optional<long long> number(const std::string& path) const {
    const auto t = text(path);
    if (!t) return std::nullopt;
    long long v = 0;
    const auto r = std::from_chars(t->data(), t->data() + t->size(), v);
    if (r.ec != std::errc{}) return std::nullopt;
    return v;
  }
  // Names in a folder that begin with `prefix` followed by a digit, in order of the number.
  [[nodiscard]] std::vector<std::string> numbered(const std::string& folder,
                                                  const std::string& prefix) const {
    std::vector<std::pair<long, std::string>> found;
    std::error_code error;
    for (fs::directory_iterator it(at(folder), error), end; !error && it != end;
         it.increment(error)) {
      const std::string name = it->path().filename().string();
      if (name.size() <= prefix.size() || name.compare(0, prefix.size(), prefix) != 0) continue;
      const std::string digits = name.substr(prefix.size());
      if (digits.size() > 9 || digits.find_first_not_of("0123456789") != std::string::npos)
        continue;
      found.emplace_back(std::strtol(digits.c_str(), nullptr, 10), name);
    }
    std::sort(found.begin(), found.end());
    std::vector<std::string> out;
    for (auto& f : found) out.push_back(std::move(f.second));
    return out;
  }
  [[nodiscard]] bool writable(const std::string& path) const {
    return access(at(path).c_str(), W_OK) == 0;
  }
  [[nodiscard]] bool exists(const std::string& path) const {
    return access(at(path).c_str(), F_OK) == 0;
  }

 private:
  std::string root_;
};

std::string list_text(const std::vector<int>& cpus) {
  std::string out;
  for (std::size_t i = 0; i < cpus.size(); ++i) {
    std::size_t j = i;
    while (j + 1 < cpus.size() && cpus[j + 1] == cpus[j] + 1) ++j;
    if (!out.empty()) out += ',';
    out += std::to_string(cpus[i]);
    if (j > i) out.append("-").append(std::to_string(cpus[j]));
    i = j;
  }
  return out.empty() ? "none" : out;
}

std::string one_line(std::string text, std::size_t limit = 120) {
  std::replace_if(
      text.begin(), text.end(), [](char c) { return static_cast<unsigned char>(c) < 0x20; }, ' ');
  if (text.size() > limit) text = text.substr(0, limit) + "...";
  return text;
}

// The value of `key=` on the kernel's command line.
std::string boot_value(const Tree& tree, const std::string& key) {
  std::istringstream words(tree.text("/proc/cmdline").value_or(""));
  std::string out;
  for (std::string w; words >> w;) {
    if (w.compare(0, key.size() + 1, key + "=") == 0) out = w.substr(key.size() + 1);
  }
  return out;
}

std::vector<int> isolated_cpus(const Tree& tree) {
  return parse_cpu_list(tree.text("/sys/devices/system/cpu/isolated").value_or(""));
}

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

// ---- the checks, in the order they are printed
// ----------------------------------------------------

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

struct Limits {
  std::optional<double> rtprio, memlock;  // infinity: unlimited
  bool cap_nice = false, cap_lock = false;
};

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
    if (line.compare(0, 7, "CapEff:") != 0) continue;
    const unsigned long long caps = std::strtoull(line.c_str() + 7, nullptr, 16);
    l.cap_nice = (caps >> kCapSysNice & 1U) != 0;
    l.cap_lock = (caps >> kCapIpcLock & 1U) != 0;
  }
  return l;
}

DoctorCheck rtprio(const Tree& tree) {
  DoctorCheck c{"rtprio",
                "real-time priority",
                Level::kUnfit,
                "",
                "without SCHED_FIFO any ordinary program may run before the force loop",
                "give the group of the user rtprio 98 in /etc/security/limits.d "
                "(config/system/limits.d has the file), then log in again"};
  const Limits l = limits_of(tree);
  if (l.cap_nice) {
    c.level = Level::kFine;
    c.state = "allowed by CAP_SYS_NICE";
  } else if (!l.rtprio) {
    c.level = Level::kAdvice;
    c.state = "limit can not be read";
  } else {
    c.state = "limit " + std::to_string(static_cast<long>(std::min(*l.rtprio, 999.0)));
    // Highest task, sentinel and watchdog lie within 90.
    if (*l.rtprio >= 90)
      c.level = Level::kFine;
    else if (*l.rtprio >= 1)
      c.level = Level::kAdvice;
  }
  if (c.level == Level::kFine) c.todo.clear();
  return c;
}

DoctorCheck memlock(const Tree& tree) {
  DoctorCheck c{"memlock",
                "locked memory",
                Level::kUnfit,
                "",
                "memory that is not locked can fault inside a job: 1 us at best, the disk at worst",
                "give the group of the user memlock unlimited in /etc/security/limits.d "
                "(config/system/limits.d has the file), then log in again"};
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

DoctorCheck governor(const Tree& tree) {
  DoctorCheck c{
      "governor",
      "frequency governor",
      Level::kFine,
      "",
      "a core that has slowed down takes up to some ms to speed up again, and budgets are "
      "measured at full speed",
      ""};
  std::map<std::string, std::vector<int>> found;
  for (const auto& cpu : tree.numbered("/sys/devices/system/cpu", "cpu")) {
    const auto g = tree.text("/sys/devices/system/cpu/" + cpu + "/cpufreq/scaling_governor");
    if (g) found[one_line(*g, 30)].push_back(std::atoi(cpu.c_str() + 3));
  }
  if (found.empty()) {
    c.state = "not visible (a virtual machine, or fixed frequency)";
    return c;
  }
  for (const auto& [name, cpus] : found) {
    c.state += (c.state.empty() ? "" : "; ") + name + " on " + list_text(cpus);
    if (name != "performance") c.level = Level::kAdvice;
  }
  if (c.level != Level::kFine) {
    c.todo = "as root: cpupower frequency-set -g performance (Debian: apt install linux-cpupower)";
  }
  return c;
}

DoctorCheck idle_states(const Tree& tree) {
  DoctorCheck c{"cstates",
                "idle states",
                Level::kFine,
                "",
                "waking from a deep idle state takes up to 0.2 ms, each time the force loop sleeps",
                ""};
  constexpr long long kShallow_us = 20;
  long long worst = 0;
  std::string name;
  int states = 0;
  for (const auto& cpu : tree.numbered("/sys/devices/system/cpu", "cpu")) {
    const std::string folder = "/sys/devices/system/cpu/" + cpu + "/cpuidle";
    for (const auto& s : tree.numbered(folder, "state")) {
      ++states;
      const std::string base = folder + "/" + s;
      const long long latency = tree.number(base + "/latency").value_or(0);
      if (tree.number(base + "/disable").value_or(0) != 0 || latency <= worst) continue;
      worst = latency;
      name = one_line(tree.text(base + "/name").value_or(s), 30);
    }
  }
  if (states == 0) {
    c.state = "not visible (a virtual machine, or idle states are off)";
    return c;
  }
  c.state = worst == 0 ? "no deep state enabled"
                       : "deepest enabled: " + name + ", " + std::to_string(worst) + " us";
  if (worst <= kShallow_us) return c;
  if (tree.writable("/dev/cpu_dma_latency")) {
    c.state += "; /dev/cpu_dma_latency is writable, and teletact holds it at 0 while it runs";
    return c;
  }
  c.level = Level::kAdvice;
  c.todo =
      "allow the group to write /dev/cpu_dma_latency (config/system/udev has the rule), or boot "
      "with intel_idle.max_cstate=1 processor.max_cstate=1";
  return c;
}

bool irqbalance_runs(const Tree& tree) {
  for (const auto& pid : tree.numbered("/proc", "")) {
    if (tree.text("/proc/" + pid + "/comm").value_or("") == "irqbalance") return true;
  }
  return false;
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

}  // namespace

std::vector<int> parse_cpu_list(const std::string& text) {
  constexpr int kMost = 4096;
  std::set<int> out;
  std::istringstream parts(text);
  for (std::string part; std::getline(parts, part, ',');) {
    int lo = 0, hi = 0;
    const char *p = part.data(), *end = part.data() + part.size();
    while (p < end && std::isspace(static_cast<unsigned char>(*p)) != 0) ++p;
    auto r = std::from_chars(p, end, lo);
    if (r.ec != std::errc{} || lo < 0 || lo >= kMost) continue;
    hi = lo;
    if (r.ptr < end && *r.ptr == '-') {
      r = std::from_chars(r.ptr + 1, end, hi);
      if (r.ec != std::errc{}) continue;
    }
    for (int i = lo; i <= std::min(hi, kMost - 1); ++i) out.insert(i);
  }
  return {out.begin(), out.end()};
}

std::vector<DoctorCheck> run_doctor(const std::string& root) {
  const Tree tree(root);
  return {preemption(tree), rtprio(tree),      memlock(tree),     cores(tree),
          governor(tree),   idle_states(tree), interrupts(tree),  clock_source(tree),
          smt(tree),        throttling(tree),  fair_server(tree), virtualisation(tree)};
}

DoctorCheck::Level doctor_verdict(const std::vector<DoctorCheck>& checks) {
  Level worst = Level::kFine;
  for (const auto& c : checks) worst = std::max(worst, c.level);
  return worst;
}

}  // namespace teletact
