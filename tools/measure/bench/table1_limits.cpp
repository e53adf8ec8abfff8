// What table1 is held against: met, missed, or not measured.
#include <algorithm>
#include <cstdio>

#include "tools/measure/bench/table1.hpp"

namespace teletact {

namespace {

using State = Limit::State;

constexpr Table1Paper kPaper[] = {
    {64, 16.4, 11.8}, {128, 20.3, 14.3}, {256, 22.2, 15.5}, {384, 31.9, 22.5}, {512, 38.8, 27.3}};

// At 512^3.
constexpr int kEdge = 512;
struct Target {
  const char* sequence;
  double p50_ms, p95_ms;
};
constexpr Target kTargets[] = {{"recording", 15, 22}, {"synthetic", 17, 24}};
constexpr double kObject_ms = 3.3;
constexpr double kMemory_MiB = 64;

class RowLimits {
 public:
  explicit RowLimits(const Table1Row& row)
      : name_(row.sequence + " " + std::to_string(row.edge) + "^3, "),
        disturbed_(disturbed(row.other_load)) {}
  // What others' load can not change.
  void figure(const char* what, double value, const char* sense, double limit) {
    limits_.add(name_ + what, value, sense, limit);
  }
  void time(const char* what, double ms, const char* sense, double limit_ms) {
    limits_.add(name_ + what, ms, sense, limit_ms, disturbed_);
  }
  [[nodiscard]] const std::vector<Limit>& all() const { return limits_.all(); }

 private:
  std::string name_, disturbed_;
  Limits limits_;
};

std::vector<Limit> limits_of(const Table1Row& row) {
  RowLimits l(row);
  l.figure("claimed share", static_cast<double>(row.claimed) / std::max(1, row.frames),
           ">=", Table1Row::kClaimedShare);
  l.figure("blocks refused", static_cast<double>(row.refused), "<=", 0);
  l.figure("memory, MiB", row.memory_MiB, "<=", kMemory_MiB);
  const bool object = row.touches > 0;  // without colour nothing is touched
  if (row.edge == kEdge) {
    for (const Target& t : kTargets) {
      if (row.sequence != t.sequence) continue;
      l.time("frame CPU p50, ms", row.frame.p50, "<=", t.p50_ms);
      l.time("frame CPU p95, ms", row.frame.p95, "<=", t.p95_ms);
    }
    if (object) {
      l.time("the object's stages p50, ms", row.object.p50, "<=", kObject_ms);
      l.time("with it less without, p50, ms", row.object_more.p50, "<=", kObject_ms);
    }
  }
  const Table1Paper* paper = table1_paper(row.edge);
  if (paper != nullptr && row.two.forks > 0) {
    const double wall_ms = object ? row.two.wall_with_object.p50 : row.two.wall.p50;
    l.time(object ? "wall of two threads with object, ms" : "wall of two threads, ms", wall_ms, "<",
           paper->fusion_ms);
  }
  return l.all();
}

bool counts(const Table1Row& row) { return !row.beside && !row.fixed_voxel; }

}  // namespace

const Table1Paper* table1_paper(int edge) {
  const auto* at = std::find_if(std::begin(kPaper), std::end(kPaper),
                                [&](const Table1Paper& p) { return p.edge == edge; });
  return at != std::end(kPaper) ? at : nullptr;
}

std::vector<Limit> Table1Result::limits() const {
  std::vector<Limit> all;
  for (const auto& row : rows) {
    if (!counts(row)) continue;
    const auto of_row = limits_of(row);
    all.insert(all.end(), of_row.begin(), of_row.end());
  }
  return all;
}

std::string Table1Result::not_run() const {
  std::string text;
  const auto lacks = [&](const std::string& what) { text += (text.empty() ? "" : ", ") + what; };
  for (const Target& t : kTargets) {
    for (const Table1Paper& p : kPaper) {
      const auto row = std::find_if(rows.begin(), rows.end(), [&](const Table1Row& r) {
        return counts(r) && r.sequence == t.sequence && r.edge == p.edge;
      });
      const std::string name = std::string(t.sequence) + " " + std::to_string(p.edge) + "^3";
      if (row == rows.end()) {
        lacks(name);
        continue;
      }
      if (row->two.forks <= 0) lacks(name + " with two threads");
      if (p.edge == kEdge && row->touches == 0) lacks(name + " with an object");
    }
  }
  return text;
}

void Table1Result::print_limits(std::ostream& out) const {
  teletact::print(out, limits());
  if (const std::string lacking = not_run(); !lacking.empty())
    out << "not run: " << lacking << "\n";
  if (count(State::kNotMeasured) == 0) return;
  double worst = 0;
  for (const auto& row : rows)
    if (counts(row)) worst = std::max(worst, row.other_load);
  char line[256];
  std::snprintf(line, sizeof line,
                "others used up to %.2f of a core, %.2f is allowed: no verdict on the times of "
                "those rows; measure again while nothing else runs\n",
                worst, kOtherLoadLimit);
  out << line;
}

}  // namespace teletact
