#include "tools/teletact/calibrate.hpp"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <stdexcept>

namespace teletact {

namespace {

double at(const std::vector<double>& sorted, double q) {
  const double x = q * static_cast<double>(sorted.size() - 1);
  const auto i = static_cast<std::size_t>(x);
  const std::size_t j = std::min(i + 1, sorted.size() - 1);
  return sorted[i] + (sorted[j] - sorted[i]) * (x - static_cast<double>(i));
}

void add_row(tasks::Calibration& c, const rt::TaskLog& log, const std::string& choice, int level) {
  std::vector<double> cpu_us;
  std::uint64_t work_min = ~0ULL, work_max = 0;
  // The first jobs run on cold caches and before the first image: not what a budget is for.
  const std::size_t skip = log.jobs.size() / 10;
  for (std::size_t i = skip; i < log.jobs.size(); ++i) {
    const auto& j = log.jobs[i];
    cpu_us.push_back(static_cast<double>(j.cpu_ns) * 1e-3);
    work_min = std::min(work_min, j.work);
    work_max = std::max(work_max, j.work);
  }
  if (cpu_us.size() < 10) return;
  std::sort(cpu_us.begin(), cpu_us.end());
  tasks::CalibrationRow row;
  row.name = log.spec.name;
  row.choice = choice;
  row.level = level;
  row.p50_us = at(cpu_us, 0.5);
  row.p99_us = at(cpu_us, 0.99);
  row.p999_us = at(cpu_us, 0.999);
  row.work_min = static_cast<double>(work_min);
  row.work_max = static_cast<double>(work_max);
  for (std::size_t i = 0; i < row.quantiles_us.size(); ++i) {
    row.quantiles_us[i] =
        at(cpu_us, static_cast<double>(i) / static_cast<double>(row.quantiles_us.size() - 1));
  }
  c.rows.push_back(row);
}

}  // namespace

tasks::Calibration calibrate(rt::NonRealtime& nrt, Scene& scene, double seconds, bool quiet) {
  tasks::Calibration c;
  c.host = tasks::host_id();
  std::size_t most = 1;  // levels of any task
  for (const auto& row : tasks::kTaskTable) {
    for (std::size_t i = 0; i < row.variants.size(); ++i) {
      if (!row.variants[i].name.empty()) most = std::max(most, i + 1);
    }
  }
  const tasks::Calibration declared;  // admission and costs of these runs are the declared ones
  const double voxel_m = scene.graph.fusion.tsdf.voxel_size_m;
  bool first = true;
  for (const auto& option : tasks::voxel_options(choice_limits(scene))) {
    if (!option.ruled_out.empty()) {
      if (!quiet)
        std::printf("calibrate: not %s: %s\n", option.name.c_str(), option.ruled_out.c_str());
      continue;
    }
    for (int level = 0; level < static_cast<int>(most); ++level) {
      if (!quiet) {
        std::printf("calibrate: %s, level %d of %zu ...\n", option.name.c_str(), level + 1, most);
        std::fflush(stdout);
      }
      DemoOptions o;
      o.seconds = seconds;
      o.virtual_clock = o.measure_cpu = o.quiet = true;
      o.force_level = level;
      o.force_choice = option.name;
      o.black_box_s = 0;
      o.cores = 8;  // never a reason to refuse
      const VirtualRun run = run_virtual(nrt, scene, o, declared);
      for (const auto* log : {&run.op.log, &run.robot.log}) {
        for (const auto& t : log->tasks) {
          const bool chooses = !t.spec.choice.empty();
          // What has no choice is the same in all of them: once is enough.
          if (t.spec.policy != rt::MissPolicy::kAbort && level < t.spec.levels() &&
              (first || chooses))
            add_row(c, t, t.spec.choice, level);
        }
      }
    }
    first = false;
  }
  scene.graph.fusion.tsdf.voxel_size_m = voxel_m;
  return c;
}

tasks::Calibration host_calibration(rt::NonRealtime& nrt, Scene& scene, const DemoOptions& options,
                                    std::string& text) {
  namespace fs = std::filesystem;
  if (!options.calibration.empty()) {
    auto c = tasks::load_calibration(options.calibration);
    if (!c) throw std::runtime_error(c.error());
    text = options.calibration + " (" + c.value().host + ")";
    return std::move(c).value();
  }
  const char* cache = std::getenv("XDG_CACHE_HOME");
  const char* home = std::getenv("HOME");
  const fs::path folder =
      (cache != nullptr ? fs::path(cache) : fs::path(home != nullptr ? home : "/tmp") / ".cache") /
      "teletact";
  const std::string file =
      (folder / ("calibration-" + fs::path(options.scene_path).stem().string() + ".toml")).string();
  if (fs::exists(file)) {
    auto c = tasks::load_calibration(file);
    // One of another host, or of a scene that leaves another choice, is no use.
    if (c && c.value().host == tasks::host_id() &&
        c.value().covers(tasks::make_specs(c.value(), choice_limits(scene)))) {
      text = file + " (" + c.value().host + ")";
      return std::move(c).value();
    }
  }
  std::printf("no calibration of this host yet: measuring what each task costs here (once)\n");
  tasks::Calibration c = calibrate(nrt, scene, 4.0, options.quiet);
  fs::create_directories(folder);
  tasks::save_calibration(file, c);
  text = file + ", measured just now (" + c.host + ")";
  return c;
}

tasks::Calibration reference_calibration() {
  auto c = tasks::load_calibration(find_config("limits", "reference_costs"));
  if (!c) throw std::runtime_error(c.error());
  return std::move(c).value();
}

}  // namespace teletact
