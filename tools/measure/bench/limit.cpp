#include "tools/measure/bench/limit.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <utility>

namespace teletact {

namespace {

bool holds(double value, const char* sense, double limit) {
  if (std::strcmp(sense, "<") == 0) return value < limit;
  return std::strcmp(sense, "<=") == 0 ? value <= limit : value >= limit;
}

const char* word(Limit::State state) {
  switch (state) {
    case Limit::State::kMet:
      return "met";
    case Limit::State::kMissed:
      return "MISSED";
    case Limit::State::kNotMeasured:
      break;
  }
  return "not measured";
}

}  // namespace

void Limits::add(std::string what, double value, const char* sense, double limit,
                 std::string why_not) {
  using State = Limit::State;
  const State state = !why_not.empty()             ? State::kNotMeasured
                      : holds(value, sense, limit) ? State::kMet
                                                   : State::kMissed;
  all_.push_back({std::move(what), sense, value, limit, state, std::move(why_not)});
}

int count(const std::vector<Limit>& limits, Limit::State state) {
  return static_cast<int>(std::count_if(limits.begin(), limits.end(),
                                        [&](const Limit& l) { return l.state == state; }));
}

int missed(const std::vector<Limit>& limits) { return count(limits, Limit::State::kMissed); }

void print(std::ostream& out, const std::vector<Limit>& limits) {
  if (limits.empty()) return;
  char line[256];
  out << "\nlimits\n";
  for (const Limit& l : limits) {
    char value[32] = "-";
    if (l.state != Limit::State::kNotMeasured || std::isfinite(l.value))
      std::snprintf(value, sizeof value, "%.5g", l.value);
    std::snprintf(line, sizeof line, "  %-52s %10s  %2s %-8.5g %s", l.what.c_str(), value, l.sense,
                  l.limit, word(l.state));
    out << line << (l.why.empty() ? "" : ": ") << l.why << "\n";
  }
  std::snprintf(line, sizeof line, "%d met, %d MISSED, %d not measured\n",
                count(limits, Limit::State::kMet), missed(limits),
                count(limits, Limit::State::kNotMeasured));
  out << line;
}

std::string disturbed(double other_load) {
  if (other_load <= kOtherLoadLimit) return {};
  char text[96];
  std::snprintf(text, sizeof text, "others used %.2f of a core, %.2f is allowed", other_load,
                kOtherLoadLimit);
  return text;
}

}  // namespace teletact
