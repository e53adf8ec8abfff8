// The figures of the boundary bench: by name, as text, drawn.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <tuple>

#include "tools/measure/haptic/boundary.hpp"
#include "tools/report/svg.hpp"

namespace teletact {

namespace {

std::string delay_text(const LoopSetting& s) {
  char text[32];
  std::snprintf(text, sizeof text, "%g", s.delay_s * s.rate_hz);
  return text;
}

}  // namespace

std::vector<Limit> BoundaryResult::limits() const {
  const auto all_figures = metrics();
  const auto figure = [&](const char* name) {
    for (const BenchMetric& m : all_figures) {
      if (m.name == name) return m.value;
    }
    return std::nan("");
  };
  const std::string none = "nothing of it was run";
  const bool plain =
      std::any_of(rows.begin(), rows.end(), [](const BoundaryRow& row) { return row.plain(); });
  Limits all;
  for (const auto& [name, sense, limit] : {std::tuple{"haptic.boundary.ratio_min", ">=", 0.8},
                                           {"haptic.boundary.ratio_max", "<=", 1.2}}) {
    all.add(std::string("K max over b/(T/2+t_d), ") + (*sense == '>' ? "least" : "largest"),
            figure(name), sense, limit, plain ? "" : none);
  }
  all.add("least E + booked + credit, controller on, mJ", figure("haptic.passivity.energy_min_mJ"),
          ">=", -1, passivity.empty() && materials.empty() ? none : "");
  for (const char* change : {"border", "flicker", "friction", "amplitude", "period"}) {
    all.add(std::string("raw step beyond the hand's, ") + change + ", N",
            figure(("haptic.materials." + std::string(change) + "_N").c_str()), "<=", 0.15,
            materials.empty() ? none : "");
  }
  all.add("ten loops over bumps, mJ", figure("haptic.texture.loops_mJ"), "<=", 0.2,
          textures.empty() ? none : "");
  return all.all();
}

std::vector<BenchMetric> BoundaryResult::metrics() const {
  double low = std::numeric_limits<double>::infinity(), high = 0, energy = low, off = low, pc = 0;
  for (const BoundaryRow& row : rows) {
    if (!row.plain()) continue;
    low = std::min(low, row.ratio());
    high = std::max(high, row.ratio());
  }
  for (const PassivityRow& row : passivity) {
    energy = std::min(energy, row.energy_min_J);
    off = std::min(off, row.energy_min_off_J);
    pc = std::max(pc, row.controller_max_N);
  }
  double border = 0, flicker = 0, friction = 0, amplitude = 0, period = 0;
  for (const auto& [rate, m] : materials) {
    border = std::max(border, m.border_N);
    flicker = std::max(flicker, m.flicker_N);
    friction = std::max(friction, m.friction_N);
    amplitude = std::max(amplitude, m.amplitude_N);
    period = std::max(period, m.period_N);
    energy = std::min(energy, m.energy_min_J);
  }
  double loop = 0, normal = 0;
  for (const TextureRow& row : textures) {
    loop = std::max(loop, row.height_J);
    normal = std::max(normal, row.normal_J);
  }
  return {{"haptic.boundary.ratio_min", low, "1"},
          {"haptic.boundary.ratio_max", high, "1"},
          {"haptic.passivity.energy_min_mJ", 1e3 * energy, "mJ"},
          {"haptic.energy_min_mJ", 1e3 * energy, "mJ"},
          {"haptic.passivity.energy_min_off_mJ", 1e3 * off, "mJ"},
          {"haptic.passivity.controller_max_N", pc, "N"},
          {"haptic.materials.border_N", border, "N"},
          {"haptic.materials.flicker_N", flicker, "N"},
          {"haptic.materials.friction_N", friction, "N"},
          {"haptic.materials.amplitude_N", amplitude, "N"},
          {"haptic.materials.period_N", period, "N"},
          {"haptic.texture.loops_mJ", 1e3 * loop, "mJ"},
          {"haptic.bump_normal.loops_mJ", 1e3 * normal, "mJ"}};
}

void BoundaryResult::print(std::ostream& out) const {
  char line[320];
  out << "  rate   b      t_d    c     hand   K max      b/(T/2+t_d)  ratio\n"
         "  Hz     N s/m  ticks  N            N/m        N/m\n";
  for (const BoundaryRow& row : rows) {
    const LoopSetting& s = row.setting;
    std::snprintf(line, sizeof line, "  %-6.0f %-6.2f %-6s %-5.2f %-6s %-10.0f %-12.0f %.3f\n",
                  s.rate_hz, s.damping, delay_text(s).c_str(), s.coulomb_N, s.hand ? "yes" : "no",
                  row.stiffness_max, s.bound(), row.ratio());
    out << line;
  }
  out << "\npassivity, K as a share of b/(T/2+t_d); lowest E + booked + credit\n"
         "  rate   b      t_d    share  off, mJ     on, mJ      controller N  speed at end mm/s\n";
  for (const PassivityRow& row : passivity) {
    const LoopSetting& s = row.setting;
    std::snprintf(line, sizeof line, "  %-6.0f %-6.2f %-6s %-6.2f %-11.3f %-11.3f %-13.2f %.2f\n",
                  s.rate_hz, s.damping, delay_text(s).c_str(), row.stiffness / s.bound(),
                  1e3 * row.energy_min_off_J, 1e3 * row.energy_min_J, row.controller_max_N,
                  1e3 * row.speed_m_per_s);
    out << line;
  }
  for (const auto& [rate, m] : materials) {
    std::snprintf(
        line, sizeof line,
        "\n%.0f Hz: raw step beyond the hand's motion: border 1.0/0.4 %.3f N, label that "
        "flips %.3f N, with it friction %.3f N, bumps' height %.3f N, period %.3f N; lowest "
        "E + booked %.3f mJ\n",
        rate, m.border_N, m.flicker_N, m.friction_N, m.amplitude_N, m.period_N,
        1e3 * m.energy_min_J);
    out << line;
  }
  for (const TextureRow& row : textures) {
    std::snprintf(line, sizeof line,
                  "bumps of 0.3 mm in 2 mm at %.1f N/mm, ten loops over 1 to 2 mm of depth: %.3f "
                  "mJ, as a perturbed "
                  "normal %.3f mJ\n",
                  1e-3 * row.stiffness, 1e3 * row.height_J, 1e3 * row.normal_J);
    out << line;
  }
  teletact::print(out, limits());
}

std::string BoundaryResult::drawing() const {
  plot::Figure f;
  f.title = "Largest stable stiffness over b / (T/2 + t_d)";
  f.x_label = "b / (T/2 + t_d), N/m";
  f.y_label = "largest K, N/m";
  f.log_x = f.log_y = true;
  f.height_px = 460;
  double lo = std::numeric_limits<double>::infinity(), hi = 0;
  const auto series_of = [&](const std::string& name) -> plot::Series& {
    for (plot::Series& s : f.series) {
      if (s.name == name) return s;
    }
    f.series.push_back({name, {}, {}, "", true, false});
    return f.series.back();
  };
  for (const BoundaryRow& row : rows) {
    const LoopSetting& s = row.setting;
    char name[64];
    if (s.hand) {
      std::snprintf(name, sizeof name, "%.0f Hz, held by a hand", s.rate_hz);
    } else if (s.coulomb_N > 0) {
      std::snprintf(name, sizeof name, "%.0f Hz, c = %.1f N", s.rate_hz, s.coulomb_N);
    } else {
      std::snprintf(name, sizeof name, "%.0f Hz", s.rate_hz);
    }
    plot::Series& to = series_of(name);
    to.x.push_back(s.bound());
    to.y.push_back(row.stiffness_max);
    lo = std::min(lo, s.bound());
    hi = std::max(hi, s.bound());
  }
  f.series.push_back({"K = b / (T/2 + t_d)", {lo, hi}, {lo, hi}, "#333333", false, false});
  f.series.push_back({"20 % above and below",
                      {lo, hi, std::nan(""), lo, hi},
                      {0.8 * lo, 0.8 * hi, std::nan(""), 1.2 * lo, 1.2 * hi},
                      "#999999",
                      false,
                      false});
  return plot::line_plot(f);
}

}  // namespace teletact
