// What the doctor's checks read and how they say it.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "tools/doctor/doctor.hpp"

namespace teletact::doctor {

// The tree under test. Everything unreadable is "not there": a doctor must not fall ill itself.
class Tree {
 public:
  explicit Tree(std::string root) : root_(std::move(root)) {}

  [[nodiscard]] std::string at(const std::string& path) const { return root_ + path; }
  [[nodiscard]] std::optional<std::string> text(const std::string& path) const;
  [[nodiscard]] std::optional<long long> number(const std::string& path) const;
  // Names in a folder that begin with `prefix` followed by a digit, in order of the number.
  [[nodiscard]] std::vector<std::string> numbered(const std::string& folder,
                                                  const std::string& prefix) const;
  // All names in a folder, sorted; at most 4096.
  [[nodiscard]] std::vector<std::string> names(const std::string& folder) const;
  [[nodiscard]] bool is_there(const std::string& path) const;
  [[nodiscard]] bool writable(const std::string& path) const;

 private:
  std::string root_;
};

[[nodiscard]] std::string list_text(const std::vector<int>& cpus);  // "0-2,5", or "none"
[[nodiscard]] std::string one_line(std::string text, std::size_t limit = 120);
// The value of `key=` on the kernel's command line.
[[nodiscard]] std::string boot_value(const Tree& tree, const std::string& key);
[[nodiscard]] std::vector<int> isolated_cpus(const Tree& tree);

// What this process may ask for, as /proc tells.
struct Limits {
  std::optional<double> rtprio, memlock;  // infinity: unlimited
  bool cap_nice = false, cap_lock = false, cap_raw = false;
  // What file capabilities could give it: true where /proc does not say.
  bool bounding_nice = true, bounding_lock = true, no_new_privileges = false;
};
[[nodiscard]] Limits limits_of(const Tree& tree);
// CPU time that the control groups above this process leave it, in cores; empty: no quota.
[[nodiscard]] std::optional<double> quota_cores(const Tree& tree);

// The checks. Kernel:
[[nodiscard]] DoctorCheck preemption(const Tree& tree);
[[nodiscard]] DoctorCheck clock_source(const Tree& tree);
[[nodiscard]] DoctorCheck throttling(const Tree& tree);
[[nodiscard]] DoctorCheck fair_server(const Tree& tree);
[[nodiscard]] DoctorCheck virtualisation(const Tree& tree);
// Rights of this user:
[[nodiscard]] DoctorCheck rtprio(const Tree& tree);
[[nodiscard]] DoctorCheck memlock(const Tree& tree);
// Cores and what runs on them:
[[nodiscard]] DoctorCheck cores(const Tree& tree);
[[nodiscard]] DoctorCheck quota(const Tree& tree);
[[nodiscard]] DoctorCheck interrupts(const Tree& tree);
[[nodiscard]] DoctorCheck smt(const Tree& tree);
// Their power states:
[[nodiscard]] DoctorCheck governor(const Tree& tree);
[[nodiscard]] DoctorCheck idle_states(const Tree& tree);
// A robot's devices:
[[nodiscard]] DoctorCheck can_bus(const Tree& tree);
[[nodiscard]] DoctorCheck gpio_chips(const Tree& tree);

}  // namespace teletact::doctor
