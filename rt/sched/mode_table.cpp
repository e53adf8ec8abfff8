#include "rt/sched/mode_table.hpp"

#include <algorithm>
#include <cstdio>
#include <stdexcept>

#include "rt/sched/admission_levels.hpp"

namespace rt {
namespace {

// The level range as one level that is as dear as any of them.
void charge(TaskSpec& spec, int first, int last) {
  if (spec.variants.empty()) return;
  Variant dearest = spec.variants[static_cast<std::size_t>(first)];
  for (int l = first + 1; l <= last; ++l) {
    const Variant& v = spec.variants[static_cast<std::size_t>(l)];
    dearest.budget = std::max(dearest.budget, v.budget);
    dearest.until_last_fork = std::max(dearest.until_last_fork, v.until_last_fork);
    dearest.overlap = std::min(dearest.overlap, v.overlap);
  }
  if (last > first) dearest.name += " to " + spec.variants[static_cast<std::size_t>(last)].name;
  spec.variants = {dearest};
  spec.budget = dearest.budget;
}

// A pool worker does what its parent does.
std::size_t demand_row(const std::vector<TaskSpec>& tasks, std::size_t i) {
  for (std::size_t p = 0; tasks[i].is_worker() && p < tasks.size(); ++p) {
    if (tasks[p].name == tasks[i].parent && tasks[p].box == tasks[i].box) return p;
  }
  return i;
}

// Everything that runs in a or in b, where it is placed. Sentinels and watchdogs are there in every
// mode.
AdmissionRequest set_of(const AdmissionRequest& request, const Admission& admission,
                        const ModeSet& a, const ModeSet& b) {
  AdmissionRequest r = request;
  r.tasks.clear();
  const std::vector<TaskSpec> placed = pinned_as(admission, settled_as(admission, request.tasks));
  for (std::size_t i = 0; i < placed.size(); ++i) {
    const std::size_t row = demand_row(placed, i);
    const ModeDemand &x = a.demands[row], &y = b.demands[row];
    if (!x.runs && !y.runs) continue;
    const ModeDemand& one = x.runs ? x : y;
    const ModeDemand& other = y.runs ? y : x;
    r.tasks.push_back(placed[i]);
    charge(r.tasks.back(), std::min(one.first_level, other.first_level),
           std::max(one.last_level, other.last_level));
  }
  r.platform.clear();
  for (const AdmittedTask& p : admission.platform) {
    for (const PlatformTask& row : request.platform) {
      if (p.priority != row.priority || p.box != row.spec.box ||
          p.name.rfind(row.spec.name + "@", 0) != 0)
        continue;
      r.platform.push_back(row);
      r.platform.back().wakes = PlatformWakes::kItself;
      r.platform.back().spec.core = p.core;
      r.platform.back().spec.rate = {1'000'000'000, p.T.count()};
      break;
    }
  }
  r.degrade_order.clear();
  return r;
}

ModeVerdict judge(const AdmissionRequest& request, const Admission& admission,
                  const std::vector<ModeSet>& modes, std::size_t from, std::size_t to) {
  ModeVerdict v{from, to, false, {}, 0, Nanos::max()};
  const Admission a = admit(set_of(request, admission, modes[from], modes[to]));
  v.admitted = a.admitted;
  v.refusal = a.refusal;
  for (const AdmittedCore& c : a.cores) v.utilisation = std::max(v.utilisation, c.utilisation);
  for (const AdmittedTask& t : a.tasks) v.slack = std::min(v.slack, t.slack);
  return v;
}

void check(const AdmissionRequest& request, const std::vector<ModeSet>& modes) {
  if (modes.empty() || modes.size() > kMaxModes)
    throw std::invalid_argument("mode table: " + std::to_string(modes.size()) +
                                " modes (allowed: 1 to " + std::to_string(kMaxModes) + ")");
  for (const ModeSet& m : modes) {
    if (m.demands.size() != request.tasks.size())
      throw std::invalid_argument("mode '" + m.name + "': " + std::to_string(m.demands.size()) +
                                  " demands for " + std::to_string(request.tasks.size()) +
                                  " tasks");
  }
}

void check_levels(const std::vector<TaskSpec>& settled, const std::vector<ModeSet>& modes) {
  for (const ModeSet& m : modes) {
    for (std::size_t i = 0; i < settled.size(); ++i) {
      const ModeDemand& d = m.demands[demand_row(settled, i)];
      if (d.first_level < 0 || d.last_level < d.first_level || d.last_level >= settled[i].levels())
        throw std::invalid_argument("mode '" + m.name + "': levels of '" + settled[i].name +
                                    "' (allowed: 0 to " + std::to_string(settled[i].levels() - 1) +
                                    ")");
    }
  }
}

}  // namespace

ModeTable analyse_modes(const AdmissionRequest& request, const Admission& admission,
                        std::vector<ModeSet> modes) {
  check(request, modes);
  check_levels(settled_as(admission, request.tasks), modes);
  ModeTable table;
  table.modes = std::move(modes);
  const std::size_t n = table.modes.size();
  for (std::size_t from = 0; from < kMaxModes; ++from) {
    for (std::size_t to = 0; to < kMaxModes; ++to) table.gate.set(from, to, false);
  }
  for (std::size_t from = 0; from < n; ++from) {
    for (std::size_t to = 0; to < n; ++to)
      table.verdicts.push_back(judge(request, admission, table.modes, from, to));
  }
  const auto stays = [&](std::size_t m) { return table.verdict(m, m).admitted; };
  for (std::size_t from = 0; from < n; ++from) {
    for (std::size_t to = 0; to < n; ++to) {
      // Into a mode that one could not stay in there is no way; out of it there is, as far as it
      // fits.
      const bool fits = table.verdict(from, to).admitted && stays(to);
      table.gate.set(from, to, fits);
      if (fits || !table.modes[to].safe || !table.refusal.empty()) continue;
      if (!stays(from) && from != to) continue;  // never entered, so never left
      const ModeVerdict& why = stays(to) ? table.verdict(from, to) : table.verdict(to, to);
      table.refusal =
          (why.from == why.to ? "mode '"
                              : "the change from '" + table.modes[from].name + "' to '") +
          table.modes[to].name + "' could not be entered when it must be: " + why.refusal;
    }
  }
  return table;
}

AdmissionRequest largest_of(const AdmissionRequest& request, const Admission& admission,
                            const ModeTable& table) {
  ModeSet all;
  all.demands.assign(request.tasks.size(), ModeDemand{false, 0, 0});
  for (std::size_t m = 0; m < table.modes.size(); ++m) {
    if (!table.verdict(m, m).admitted) continue;
    for (std::size_t i = 0; i < all.demands.size(); ++i) {
      ModeDemand& sum = all.demands[i];
      const ModeDemand& d = table.modes[m].demands[i];
      if (!d.runs) continue;
      if (!sum.runs) {
        sum = d;
      } else {
        sum.first_level = std::min(sum.first_level, d.first_level);
        sum.last_level = std::max(sum.last_level, d.last_level);
      }
    }
  }
  return set_of(request, admission, all, all);
}

std::string mode_report(const ModeTable& table) {
  std::string text;
  const std::size_t n = table.modes.size();
  for (std::size_t m = 0; m < n; ++m) {
    const ModeVerdict& v = table.verdict(m, m);
    char line[160];
    std::snprintf(line, sizeof line, "  mode %-10s %s, fullest core %.3f, least slack ",
                  table.modes[m].name.c_str(), v.admitted ? "admitted" : "refused", v.utilisation);
    text += line + (v.slack == Nanos::min() ? std::string("none") : detail::milliseconds(v.slack)) +
            (v.admitted ? "" : ": " + v.refusal) + "\n";
  }
  for (const ModeVerdict& v : table.verdicts) {
    if (v.from == v.to || v.admitted || !table.verdict(v.to, v.to).admitted ||
        !table.verdict(v.from, v.from).admitted)
      continue;
    text += "  change " + table.modes[v.from].name + " -> " + table.modes[v.to].name +
            " refused: " + v.refusal + "\n";
  }
  return text;
}

}  // namespace rt
