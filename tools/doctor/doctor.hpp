// Is this box fit for real-time use? Reads /proc, /sys and /dev only; changes nothing.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace teletact {

struct DoctorCheck {
  // Ordered: the worst one is the verdict and the exit code.
  enum class Level : std::uint8_t { kFine = 0, kAdvice = 1, kUnfit = 2 };
  std::string id;  // doctor.<id> is its metric
  std::string title;
  Level level = Level::kFine;
  std::string state;  // what was found
  std::string why;    // why it matters
  std::string todo;   // what to do; empty when fine
};

// Where the tree is read from: "" is this machine, otherwise a folder with proc/, sys/ and dev/.
[[nodiscard]] std::vector<DoctorCheck> run_doctor(const std::string& root);
[[nodiscard]] DoctorCheck::Level doctor_verdict(const std::vector<DoctorCheck>& checks);

// "0-2,5" as numbers; ignores what does not belong. Bounded: no list names more than 4096 CPUs.
[[nodiscard]] std::vector<int> parse_cpu_list(const std::string& text);

}  // namespace teletact
