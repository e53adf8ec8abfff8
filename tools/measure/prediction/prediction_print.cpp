// What bench prediction says: its table, limits, figures, page.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <limits>

#include "tools/measure/prediction/prediction_bench.hpp"

namespace teletact {

namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

// The largest value over all traces that have one, and where.
struct Worst {
  double value = kNaN;
  std::string trace;
  int over = 0, count = 0;  // above 1
};

Worst worst(const std::vector<TraceResult>& traces,
            const std::function<double(const TraceResult&)>& of) {
  Worst w;
  for (const TraceResult& t : traces) {
    const double v = of(t);
    if (std::isnan(v)) continue;
    ++w.count;
    w.over += v > 1 ? 1 : 0;
    if (!(v <= w.value)) w.value = v, w.trace = t.name;
  }
  return w;
}

std::string formatted(const char* format, double a, double b, double c) {
  char text[64];
  std::snprintf(text, sizeof text, format, a, b, c);
  return text;
}

double of_paper_method(const TraceResult& t) {
  return t.mean_cm("own") / (0.5 * t.mean_cm("paper"));
}

double of_aim(const TraceResult& t) {
  return t.mean_cm("own") / (1.15 * t.best_simple_cm() + 0.03);
}

std::vector<std::string> method_names(const std::vector<TraceResult>& traces) {
  std::vector<std::string> names;
  for (const TraceResult& t : traces)
    for (const MethodFigures& m : t.methods)
      if (std::find(names.begin(), names.end(), m.method) == names.end()) names.push_back(m.method);
  return names;
}

std::string cell_of(const TraceResult& t, const std::string& method) {
  for (const MethodFigures& m : t.methods)
    if (m.method == method) return formatted("%.2f/%.2f/%.1f", m.mean_cm, m.p95_cm, m.max_cm);
  return "-";
}

// Why `own` is above half of `paper`, a line a trace.
std::vector<std::string> half_of_paper(const std::vector<TraceResult>& traces) {
  std::vector<std::string> lines;
  for (const TraceResult& t : traces) {
    if (!(of_paper_method(t) > 1)) continue;
    const double half = 0.5 * t.mean_cm("paper"), oracle = t.mean_cm("oracle");
    lines.push_back(
        t.name + ": own " +
        formatted("%.3f, half of paper %.3f, oracle %.3f cm: ", t.mean_cm("own"), half, oracle) +
        (oracle > half ? "no choice among these methods reaches it"
                       : "only a choice that knows the truth reaches it"));
  }
  return lines;
}

double of_commands(const TraceResult& t) {
  return t.mean_cm("own_commands") / (0.75 * t.best_without_commands_cm() + 0.05);
}

// Where commands do not help enough: what slip alone costs.
std::vector<std::string> commands_above(const std::vector<TraceResult>& traces) {
  std::vector<std::string> lines;
  for (const TraceResult& t : traces)
    if (of_commands(t) > 1)
      lines.push_back(t.name + formatted(": with commands %.3f, limit %.3f, wheels known %.3f cm",
                                         t.mean_cm("own_commands"),
                                         0.75 * t.best_without_commands_cm() + 0.05,
                                         t.mean_cm("wheels_known")));
  return lines;
}

}  // namespace

std::vector<Limit> PredictionResult::limits() const {
  Limits out;
  const auto add = [&](const std::string& what, const Worst& w) {
    const std::string where = w.trace.empty() ? ""
                                              : ", " + w.trace + " (" + std::to_string(w.over) +
                                                    " of " + std::to_string(w.count) + " above)";
    out.add(what + where, w.value, "<=", 1);
  };
  add("own over half the published mean", worst(traces, [](const TraceResult& t) {
        return t.mean_cm("own") / (0.5 * t.published_cm());
      }));
  add("own over half of `paper`", worst(traces, of_paper_method));
  add("own over 1.25 x the best simple + 0.05 cm", worst(traces, [](const TraceResult& t) {
        return t.mean_cm("own") / (1.25 * t.best_simple_cm() + 0.05);
      }));
  add("commands over 0.75 x the best without + 0.05 cm", worst(traces, of_commands));
  add("own over none",
      worst(traces, [](const TraceResult& t) { return t.mean_cm("own") / t.mean_cm("none"); }));
  int changed = 0;
  for (const auto& [method, n] : look_ahead) changed += n;
  out.add("predictions changed by later rows, all methods", look_ahead.empty() ? kNaN : changed,
          "<=", 0);
  if (!no_logs.empty()) out.add("the three logs", kNaN, "<=", 1, no_logs);
  return out.all();
}

void PredictionResult::print(std::ostream& out) const {
  const auto names = method_names(traces);
  out << "error in the plane, cm: mean/p95/max\n";
  char text[64];
  std::snprintf(text, sizeof text, "%-22s", "trace");
  out << text;
  for (const std::string& n : names) {
    std::snprintf(text, sizeof text, " %17s", n.c_str());
    out << text;
  }
  out << "\n";
  for (const TraceResult& t : traces) {
    std::snprintf(text, sizeof text, "%-22s", t.name.c_str());
    out << text;
    for (const std::string& n : names) {
      std::snprintf(text, sizeof text, " %17s", cell_of(t, n).c_str());
      out << text;
    }
    out << "\n";
  }
  out << "\nthread CPU of a prediction with the rows before it, us:";
  for (const auto& [method, us] : cpu_us) out << " " << method << formatted(" %.1f", us, 0, 0);
  const Worst aim = worst(traces, of_aim);
  out << "\naim, own within 1.15 x the best simple + 0.03 cm: on " << aim.count - aim.over << " of "
      << aim.count << " traces\n";
  const auto lines = half_of_paper(traces);
  if (!lines.empty()) out << "\nown is above half of `paper` on\n";
  for (const std::string& l : lines) out << "  " << l << "\n";
  const auto above = commands_above(traces);
  if (!above.empty()) out << "\nown with commands is above its limit on\n";
  for (const std::string& l : above) out << "  " << l << "\n";
  teletact::print(out, limits());
}

std::vector<BenchMetric> PredictionResult::metrics() const {
  std::vector<BenchMetric> out;
  for (const TraceResult& t : traces) {
    for (const MethodFigures& m : t.methods) {
      const std::string name = "prediction." + t.name + "." + m.method;
      out.push_back({name + ".mean_cm", m.mean_cm, "cm"});
      out.push_back({name + ".p95_cm", m.p95_cm, "cm"});
      out.push_back({name + ".max_cm", m.max_cm, "cm"});
    }
  }
  return out;
}

std::string PredictionResult::page(const std::string& command) const {
  const auto names = method_names(traces);
  std::string out =
      "# Measured: methods of prediction\n\nCommand: `" + command +
      "`. Commit: not recorded. Machine: any, no figure is a time.\n"
      "Written by the command. Method and terms: [../prediction.md](../prediction.md).\n\n"
      "Error in the plane, cm: mean / p95 / max.\n\n| trace |";
  std::string rule = "|---|";
  for (const std::string& n : names) {
    out += " " + n + " |";
    rule += "---|";
  }
  out += "\n" + rule + "\n";
  for (const TraceResult& t : traces) {
    out += "| " + t.name + " |";
    for (const std::string& n : names) out += " " + cell_of(t, n) + " |";
    out += "\n";
  }
  out +=
      "\n## Limits\n\nA figure over traces is that of the worst one; 1 is the limit.\n\n"
      "| what | value | limit | |\n|---|---|---|---|\n";
  for (const Limit& l : limits()) {
    const bool met = l.state == Limit::State::kMet;
    const std::string state = l.state == Limit::State::kNotMeasured ? "not measured: " + l.why
                              : met                                 ? "met"
                                                                    : "**MISSED**";
    out += "| " + l.what + " |" + formatted(" %.3g |", l.value, 0, 0) + " " + l.sense +
           formatted(" %.3g | ", l.limit, 0, 0) + state + " |\n";
  }
  const Worst aim = worst(traces, of_aim);
  out += "\nAim, 1.15 x the best simple + 0.03 cm: met on " + std::to_string(aim.count - aim.over) +
         " of " + std::to_string(aim.count) + " traces.\n";
  const auto lines = half_of_paper(traces);
  if (!lines.empty()) out += "\n## Where `own` is above half of `paper`\n\n";
  for (const std::string& l : lines) out += "- " + l + "\n";
  const auto above = commands_above(traces);
  if (!above.empty()) out += "\n## Where `own` with commands is above its limit\n\n";
  for (const std::string& l : above) out += "- " + l + "\n";
  return out;
}

}  // namespace teletact
