#include "tasks/graph/calibration.hpp"

#include <sys/utsname.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <stdexcept>
#include <thread>

namespace tasks {

void CalibrationRow::describe(config::Section& s) {
  s.text("name", name, {}, "task");
  s.text("choice", choice, {}, "static choice it was measured with; none: the task has none");
  s.integer("level", level, 0, 15, "variant");
  s.number("p50_us", p50_us, 0, 1e7, "median CPU of a job");
  s.number("p99_us", p99_us, 0, 1e7, "99 % quantile");
  s.number("p999_us", p999_us, 0, 1e7, "99.9 % quantile");
  s.number("work_min", work_min, 0, 1e18, "least work count seen");
  s.number("work_max", work_max, 0, 1e18, "largest work count seen");
  s.numbers("quantiles_us", quantiles_us, 0, 1e7, "quantiles i/32 of the CPU of a job");
}

rt::Nanos CalibrationRow::budget() const noexcept {
  return rt::Nanos{static_cast<std::int64_t>(1000.0 * std::max(1.2 * p999_us, p999_us + 10.0))};
}

void Calibration::describe(config::Section& s) {
  s.text("host", host, {}, "machine that measured it");
  s.list(
      "task", [this](config::Section& item) { rows.emplace_back().describe(item); }, "one variant");
}

const CalibrationRow* Calibration::find(std::string_view name, std::string_view choice,
                                        int level) const noexcept {
  for (const auto& r : rows) {
    if (r.name == name && r.choice == choice && r.level == level) return &r;
  }
  return nullptr;
}

bool Calibration::covers(const std::vector<rt::TaskSpec>& specs) const noexcept {
  const auto all_levels = [&](const rt::TaskSpec& s, const std::string& choice, std::size_t n) {
    for (std::size_t level = 0; level < n; ++level) {
      if (find(s.name, choice, static_cast<int>(level)) == nullptr) return false;
    }
    return true;
  };
  for (const auto& s : specs) {
    if (s.policy == rt::MissPolicy::kAbort) continue;
    if (s.choices.empty() && !all_levels(s, s.choice, static_cast<std::size_t>(s.levels())))
      return false;
    for (const auto& c : s.choices) {
      if (c.ruled_out.empty() && !all_levels(s, c.name, c.variants.size())) return false;
    }
  }
  return true;
}

std::string host_id() {
  utsname u{};
  uname(&u);
  std::string model = "unknown CPU";
  std::ifstream cpuinfo("/proc/cpuinfo");
  for (std::string line; std::getline(cpuinfo, line);) {
    if (line.rfind("model name", 0) == 0) {
      model = line.substr(line.find(':') + 2);
      break;
    }
  }
  return model + ", " + std::to_string(std::thread::hardware_concurrency()) + " CPUs, " +
         u.sysname + " " + u.release + " " + u.machine;
}

rt::Result<Calibration> load_calibration(const std::string& path) {
  Calibration c;
  config::Section root;
  c.describe(root);
  if (auto ok = config::load_file(path, root); !ok) return rt::Error{ok.error()};
  return c;
}

void save_calibration(const std::string& path, const Calibration& calibration) {
  const std::string temporary = path + ".tmp";
  {
    std::ofstream out(temporary);
    out << "# CPU of each task variant, measured by `teletact calibrate`.\nhost = \""
        << calibration.host << "\"\n";
    for (const auto& r : calibration.rows) {
      char line[256];
      out << "\n[[task]]\nname = \"" << r.name << "\"\n";
      if (!r.choice.empty()) out << "choice = \"" << r.choice << "\"\n";
      std::snprintf(line, sizeof line,
                    "level = %d\np50_us = %.3f\np99_us = %.3f\np999_us = %.3f\n"
                    "work_min = %.0f\nwork_max = %.0f\nquantiles_us = [",
                    r.level, r.p50_us, r.p99_us, r.p999_us, r.work_min, r.work_max);
      out << line;
      for (std::size_t i = 0; i < CalibrationRow::kQuantiles; ++i) {
        std::snprintf(line, sizeof line, "%s%.3f", i == 0 ? "" : ", ", r.quantiles_us[i]);
        out << line;
      }
      out << "]\n";
    }
    if (!out.flush()) throw std::runtime_error(temporary + ": can not be written");
  }
  if (std::rename(temporary.c_str(), path.c_str()) != 0)
    throw std::runtime_error(path + ": can not be written");
}

namespace {

std::vector<rt::Variant> make_variants(const Calibration& calibration, const TaskRow& row,
                                       const std::string& choice,
                                       const std::array<std::int64_t, 4>& declared_us) {
  std::vector<rt::Variant> variants;
  for (std::size_t level = 0; level < row.variants.size() && !row.variants[level].name.empty();
       ++level) {
    const auto* measured = calibration.find(row.name, choice, static_cast<int>(level));
    variants.emplace_back(
        std::string(row.variants[level].name),
        measured != nullptr ? measured->budget() : rt::Nanos{1000 * declared_us[level]});
  }
  return variants;
}

}  // namespace

std::vector<rt::TaskSpec> make_specs(const Calibration& calibration, const ChoiceLimits& limits) {
  std::vector<rt::TaskSpec> specs;
  for (const TaskRow& row : kTaskTable) {
    rt::TaskSpec s;
    s.name = row.name;
    s.box = row.box;
    s.task_class = row.task_class;
    s.rate = rt::Rate{row.rate_hz, 1};
    s.policy = row.policy;
    s.consecutive_miss_limit = row.miss_limit;
    if (row.id == TaskId::kFusion) {
      for (const VoxelOption& o : voxel_options(limits)) {
        s.choices.push_back(
            {o.name, make_variants(calibration, row, o.name, o.budgets_us), o.ruled_out});
      }
    } else {
      std::array<std::int64_t, 4> declared_us{};
      for (std::size_t i = 0; i < declared_us.size(); ++i)
        declared_us[i] = row.variants[i].budget_us;
      s.variants = make_variants(calibration, row, {}, declared_us);
      s.budget = s.variants.front().budget;
    }
    specs.push_back(std::move(s));
  }
  return specs;
}

std::vector<std::vector<rt::CostQuantiles>> make_costs(const Calibration& calibration,
                                                       const std::vector<rt::TaskSpec>& settled) {
  std::vector<std::vector<rt::CostQuantiles>> tables;
  for (const auto& spec : settled) {
    auto& levels = tables.emplace_back();
    for (int level = 0; level < spec.levels(); ++level) {
      auto& q = levels.emplace_back();
      const auto budget = static_cast<double>(spec.budget_of(level).count());
      const auto* row = calibration.find(spec, level);
      for (std::size_t i = 0; i < CalibrationRow::kQuantiles; ++i) {
        const double share = row != nullptr && row->p999_us > 0
                                 ? std::min(row->quantiles_us[i] / row->p999_us, 1.0) / 1.2
                                 : 0.3 + 0.5 * static_cast<double>(i) / 32.0;
        q.value_ns.push_back(static_cast<std::int64_t>(share * budget));
      }
    }
  }
  return tables;
}

}  // namespace tasks
