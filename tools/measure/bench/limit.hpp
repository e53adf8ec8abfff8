// What a bench is held against: of each figure with a limit it prints met, MISSED or not measured,
// and the program ends with 1 when one is missed. What could not be measured (no peer installed, no
// right, too much else on the machine) misses nothing and says why.
#pragma once

#include <ostream>
#include <string>
#include <vector>

namespace teletact {

struct Limit {
  enum class State { kMet, kMissed, kNotMeasured };
  std::string what;
  const char* sense = "<=";  // "<=", "<" or ">="
  double value = 0, limit = 0;
  State state = State::kMissed;
  std::string why = {};  // it was not measured
};

class Limits {
 public:
  // A value that is no number is missed: what should have been measured was not there. `why_not`:
  // not measured, for this reason.
  void add(std::string what, double value, const char* sense, double limit,
           std::string why_not = {});
  [[nodiscard]] const std::vector<Limit>& all() const { return all_; }

 private:
  std::vector<Limit> all_;
};

[[nodiscard]] int count(const std::vector<Limit>& limits, Limit::State state);
[[nodiscard]] int missed(const std::vector<Limit>& limits);
// A line each, and one with the three counts.
void print(std::ostream& out, const std::vector<Limit>& limits);

// Above it, in cores, others' work makes times longer that are of one thread's CPU only: they count
// as not measured.
inline constexpr double kOtherLoadLimit = 0.05;
// Why times of a run beside others count for nothing; empty: they count.
[[nodiscard]] std::string disturbed(double other_load);

}  // namespace teletact
