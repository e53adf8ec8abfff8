// Admission over static choices: which combination is tried when.
#include <algorithm>
#include <numeric>

#include "rt/sched/admission_levels.hpp"

namespace rt {
namespace {

using Picks = std::vector<std::size_t>;  // choice of each task; 0 for a task without

// Row whose choices count for task i: its parent's for a worker.
std::size_t chooser(const AdmissionRequest& r, std::size_t i) {
  if (!r.tasks[i].is_worker()) return i;
  for (std::size_t p = 0; p < r.tasks.size(); ++p) {
    if (r.tasks[p].name == r.tasks[i].parent && r.tasks[p].box == r.tasks[i].box) return p;
  }
  return i;
}

// Every combination that nothing rules out, best first.
std::vector<Picks> combinations(const AdmissionRequest& r) {
  std::vector<Picks> all{Picks(r.tasks.size(), 0)};
  for (std::size_t i = 0; i < r.tasks.size(); ++i) {
    const TaskSpec& spec = r.tasks[i];
    if (spec.choices.empty() || spec.is_worker()) continue;
    std::vector<Picks> longer;
    for (const Picks& picks : all) {
      for (std::size_t c = 0; c < spec.choices.size(); ++c) {
        if (!spec.choices[c].ruled_out.empty()) continue;
        longer.push_back(picks);
        longer.back()[i] = c;
      }
    }
    all = std::move(longer);
  }
  const auto steps = [](const Picks& p) {
    return std::accumulate(p.begin(), p.end(), std::size_t{0});
  };
  std::stable_sort(all.begin(), all.end(),
                   [&](const Picks& a, const Picks& b) { return steps(a) < steps(b); });
  return all;
}

std::string named(const AdmissionRequest& r, const Picks& picks) {
  std::string text;
  for (std::size_t i = 0; i < r.tasks.size(); ++i) {
    const TaskSpec& spec = r.tasks[i];
    if (spec.choices.empty() || spec.is_worker()) continue;
    text += (text.empty() ? "" : ", ") + spec.name + " " + spec.choices[picks[i]].name;
  }
  return text;
}

// One line a task with choices: what it runs, what was passed over and why.
std::vector<std::string> reasons(const AdmissionRequest& r, const Picks& taken, bool admitted,
                                 const std::vector<std::string>& refused) {
  std::vector<std::string> lines;
  for (std::size_t i = 0; i < r.tasks.size(); ++i) {
    const TaskSpec& spec = r.tasks[i];
    if (spec.choices.empty() || spec.is_worker()) continue;
    std::string line = spec.name + ": " + spec.choices[taken[i]].name;
    if (spec.choices.size() == 1)
      line += ", the only choice";
    else if (!admitted)
      line += ", the floor, does not fit";
    else if (taken[i] == 0)
      line += ", the best choice, fits";
    else
      line += ", the best of its choices that fits";
    for (const StaticChoice& c : spec.choices) {
      if (!c.ruled_out.empty()) line += "; " + c.name + " is ruled out: " + c.ruled_out;
    }
    lines.push_back(std::move(line));
  }
  lines.insert(lines.end(), refused.begin(), refused.end());
  return lines;
}

std::string all_ruled_out(const AdmissionRequest& r) {
  for (const TaskSpec& spec : r.tasks) {
    if (spec.choices.empty()) continue;
    std::string why;
    bool any = false;
    for (const StaticChoice& c : spec.choices) {
      any = any || c.ruled_out.empty();
      why += (why.empty() ? "" : "; ") + c.name + ": " + c.ruled_out;
    }
    if (!any) return std::string("task '").append(spec.name) + "' has no choice left: " + why;
  }
  return {};
}

}  // namespace

namespace detail {

TaskSpec settled(const TaskSpec& spec, std::size_t choice) {
  if (spec.choices.empty()) return spec;
  TaskSpec s = spec;
  s.variants = spec.choices[choice].variants;
  s.budget = s.variants.front().budget;
  s.choice = spec.choices[choice].name;
  s.choices.clear();
  return s;
}

}  // namespace detail

Admission admit(const AdmissionRequest& request) {
  Admission refused;
  refused.refusal = problem_of(request);
  if (refused.refusal.empty()) refused.refusal = all_ruled_out(request);
  if (!refused.refusal.empty()) return refused;
  std::vector<std::string> tried;
  const std::vector<Picks> all = combinations(request);
  for (std::size_t n = 0; n < all.size(); ++n) {
    AdmissionRequest one = request;
    for (std::size_t i = 0; i < one.tasks.size(); ++i)
      one.tasks[i] = detail::settled(request.tasks[i], all[n][chooser(request, i)]);
    Admission a = detail::admit_levels(one);
    const bool last = n + 1 == all.size();
    if (a.admitted || last) {
      a.choices = reasons(request, all[n], a.admitted, tried);
      if (!a.admitted && !a.choices.empty())
        a.refusal += " (at the floor of the static choices: " + named(request, all[n]) + ")";
      return a;
    }
    tried.push_back("not with " + named(request, all[n]) + ": " + a.refusal);
  }
  return refused;
}

std::vector<TaskSpec> settled_as(const Admission& admission, std::span<const TaskSpec> tasks) {
  std::vector<TaskSpec> out(tasks.begin(), tasks.end());
  for (std::size_t i = 0; i < out.size() && i < admission.tasks.size(); ++i) {
    for (std::size_t c = 0; c < tasks[i].choices.size(); ++c) {
      if (tasks[i].choices[c].name == admission.tasks[i].choice)
        out[i] = detail::settled(tasks[i], c);
    }
  }
  return out;
}

}  // namespace rt
