// How fast a core runs and how soon it wakes.
#include <cstdlib>
#include <map>

#include "tools/doctor/doctor_tree.hpp"

namespace teletact::doctor {

using Level = DoctorCheck::Level;

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

}  // namespace teletact::doctor
