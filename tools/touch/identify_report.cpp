#include "tools/touch/identify_report.hpp"

#include <cstdio>

#include "tools/files/today.hpp"

namespace teletact {

namespace {

constexpr const char* kAxes[3] = {"x", "y", "z"};

}  // namespace

std::string identified_keys(const std::string& kind, const IdentifyResult& r) {
  const std::string section = kind == "twin" ? "device" : "device." + kind;
  char text[400];
  std::snprintf(text, sizeof text,
                "# Measured by ring-down (teletact identify); residual %.1f um.\n[%s]\n"
                "mass_kg = %.4g\ndamping_N_s_per_m = %.4g\ncoulomb_N = %.4g\ndelay_s = %.4g\n"
                "measured = \"%s\"\n",
                1e6 * r.mean.residual_m, section.c_str(), r.mean.mass_kg, r.mean.damping_N_s_per_m,
                r.mean.coulomb_N, r.delay_s, today().c_str());
  return text;
}

void print_identified(const Identified& found, bool fit_delay) {
  const auto& [result, stated, ticks, late] = found;
  std::printf("           mass kg  damping N s/m  friction N  bias N   residual um\n");
  for (std::size_t a = 0; a < 3; ++a) {
    const DeviceFit& f = result.axes[a];
    std::printf("%-10s %.4f   %.3f          %.4f      %+.4f  %.1f\n", kAxes[a], f.mass_kg,
                f.damping_N_s_per_m, f.coulomb_N, f.bias_N, 1e6 * f.residual_m);
  }
  std::printf("mean       %.4f   %.3f          %.4f\n", result.mean.mass_kg,
              result.mean.damping_N_s_per_m, result.mean.coulomb_N);
  std::printf("%-10s %.4f   %.3f          %.4f      (delay %.3f ms%s)\n",
              stated.measured ? "measured" : "assumed", stated.mass_kg, stated.damping_N_s_per_m,
              stated.coulomb_N, 1e3 * result.delay_s, fit_delay ? ", fitted" : ", as stated");
  if (late > 0) {
    std::printf(
        "late       %llu of %llu ticks by more than half a period: the fit takes them as on time; "
        "measure again where less else runs\n",
        static_cast<unsigned long long>(late), static_cast<unsigned long long>(ticks));
  }
}

Metrics identified_metrics(const Identified& found) {
  Metrics metrics("identify");
  for (std::size_t a = 0; a < 3; ++a) {
    const DeviceFit& f = found.result.axes[a];
    const std::string name = std::string("identify.") + kAxes[a];
    metrics.add(name + ".mass_kg", f.mass_kg, "kg");
    metrics.add(name + ".damping_N_s_per_m", f.damping_N_s_per_m, "N s/m");
    metrics.add(name + ".coulomb_N", f.coulomb_N, "N");
    metrics.add(name + ".residual_um", 1e6 * f.residual_m, "um");
  }
  metrics.add("identify.late_ticks", static_cast<double>(found.late), "1");
  metrics.add("identify.delay_ms", 1e3 * found.result.delay_s, "ms");
  return metrics;
}

}  // namespace teletact
