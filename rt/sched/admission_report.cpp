// The admission's decision as text for people.
#include <cmath>
#include <cstdarg>
#include <cstdio>

#include "rt/sched/admission.hpp"

namespace rt {
namespace {

__attribute__((format(printf, 1, 2))) std::string line(const char* pattern, ...) {
  std::array<char, 512> text{};
  va_list args;
  va_start(args, pattern);
  std::vsnprintf(text.data(), text.size(), pattern, args);
  va_end(args);
  return text.data();
}

std::string ms(Nanos d) {
  if (d == kUnbounded) return "unbounded";
  if (d == Nanos::min()) return "-";
  return line("%.3f", static_cast<double>(d.count()) * 1e-6);
}

std::string factor(double f) { return std::isinf(f) ? "-" : line("%.4f", f); }

std::string task_line(const AdmittedTask& t) {
  const std::string where = t.core < 0 ? "-" : line("%d", t.cpu);
  std::string how = t.choice;
  if (!t.variant.empty()) how += (how.empty() ? "" : ", ") + t.variant;
  if (!t.parent.empty()) how += ", worker of " + t.parent + ", J " + ms(t.J) + " ms";
  if (t.join_wait.count() > 0) how += ", waits " + ms(t.join_wait) + " ms for its workers";
  return line("  %-18s %-8s %4s %5d %10s %10s %10s %10s %10s %6.3f  ", t.name.c_str(),
              t.box == Box::kRobot ? "robot" : "operator", where.c_str(), t.priority,
              ms(t.C).c_str(), ms(t.T).c_str(), ms(t.D).c_str(), ms(t.R).c_str(),
              ms(t.slack).c_str(), t.utilisation) +
         how + "\n";
}

}  // namespace

std::string report_table(const Admission& a) {
  std::string text = a.admitted ? "admitted\n" : "refused: " + a.refusal + "\n";
  if (a.cores.empty()) return text;
  for (const std::string& choice : a.choices) text += "choice  " + choice + "\n";
  if (a.admitted && a.steps.empty()) text += "every task runs its full variant\n";
  for (std::size_t i = 0; i < a.steps.size(); ++i) {
    text += line("step %zu  ", i + 1) + a.steps[i] + "\n";
  }
  text += line("  %-18s %-8s %4s %5s %10s %10s %10s %10s %10s %6s  %s\n", "task", "box", "cpu",
               "prio", "C ms", "T ms", "D ms", "R ms", "slack ms", "U", "variant");
  for (const AdmittedTask& t : a.platform) text += task_line(t);
  for (const AdmittedTask& t : a.tasks) text += task_line(t);
  text += line("  %-6s %10s %12s %8s %12s %12s %8s\n", "cpu", "real-time", "best effort", "limit",
               "Liu-Layland", "hyperbolic", "growth");
  for (const AdmittedCore& c : a.cores) {
    text +=
        line("  %-6d %10.3f %12.3f %8.2f %12.3f %12.3f %8s\n", c.cpu, c.utilisation, c.best_effort,
             a.core_limit, c.liu_layland, c.hyperbolic, factor(c.growth).c_str());
  }
  if (a.floating_best_effort > 0) {
    text += line("  best effort on any core: %.3f\n", a.floating_best_effort);
  }
  text += line("spare below the limit on all cores: %.3f\n", a.spare);
  text += "all budgets may grow by a factor of " + factor(a.growth) + "\n";
  return text;
}

}  // namespace rt
