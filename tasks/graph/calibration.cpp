#include "tasks/graph/calibration.hpp"

#include <sys/utsname.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <stdexcept>
#include <thread>
#include <utility>

#include "tasks/graph/host_request.hpp"

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
  s.number("still_p50_us", still_p50_us, -1, 1e7, "median where nobody moves; below 0: not told");
  s.number("still_p999_us", still_p999_us, -1, 1e7, "99.9 % quantile where nobody moves");
  s.number("moving_p50_us", moving_p50_us, -1, 1e7, "median where somebody moves");
  s.number("moving_p999_us", moving_p999_us, -1, 1e7, "99.9 % quantile where somebody moves");
  s.number("tracked_share", tracked_share, -1, 1,
           "of the stored images not lost; below 0: not measured");
  s.number("claimed_share", claimed_share, -1, 1, "of the stored images; below 0: not measured");
  s.number("off_mm", off_mm, -1, 1e6, "largest error of a claimed pose; below 0: not measured");
  s.numbers("quantiles_us", quantiles_us, 0, 1e7, "quantiles i/32 of the CPU of a job");
}

namespace {

const TaskRow* table_row(std::string_view name) noexcept {
  for (const TaskRow& row : kTaskTable) {
    if (row.name == name || (row.id == TaskId::kFusion && name == kWorkerRow)) return &row;
  }
  return nullptr;
}

std::size_t level_count(const TaskRow& row) noexcept {
  std::size_t n = 0;
  while (n < row.variants.size() && !row.variants[n].name.empty()) ++n;
  return n;
}

std::string figure(double x) {
  char text[32];
  std::snprintf(text, sizeof text, "%.9g", x);
  return text;
}

// One line that names key, value and what is allowed; empty: nothing is wrong.
std::string refuse(const std::string& key, const std::string& value, const std::string& allowed) {
  return "key '" + key + "' = " + value + ": allowed " + allowed;
}

// `place`: "task[3]."
std::string wrong_with(const CalibrationRow& r, const std::string& place) {
  const TaskRow* row = table_row(r.name);
  if (row == nullptr) {
    std::string names;
    for (const TaskRow& t : kTaskTable) names += (names.empty() ? "" : ", ") + std::string(t.name);
    return refuse(place + "name", "'" + r.name + "'", names);
  }
  const std::size_t levels = level_count(*row);
  if (r.level < 0 || static_cast<std::size_t>(r.level) >= levels)
    return refuse(place + "level", std::to_string(r.level),
                  "0.." + std::to_string(levels - 1) + " for " + r.name);
  if ((row->id == TaskId::kFusion) == r.choice.empty())
    return refuse(
        place + "choice", "'" + r.choice + "'",
        r.choice.empty() ? "a voxel such as '20 mm' for " + r.name : "none for " + r.name);
  const auto rises = [&](const char* key, double value, const char* below, double least) {
    return value >= least ? std::string()
                          : refuse(place + key, figure(value),
                                   "from " + std::string(below) + " (" + figure(least) + ")");
  };
  for (const auto& wrong :
       {rises("p99_us", r.p99_us, "p50_us", r.p50_us),
        rises("p999_us", r.p999_us, "p99_us", r.p99_us),
        rises("still_p999_us", r.still_p999_us, "still_p50_us", r.still_p50_us),
        rises("moving_p999_us", r.moving_p999_us, "moving_p50_us", r.moving_p50_us),
        rises("work_max", r.work_max, "work_min", r.work_min)}) {
    if (!wrong.empty()) return wrong;
  }
  for (std::size_t i = 1; i < r.quantiles_us.size(); ++i) {
    const std::string key = "quantiles_us[" + std::to_string(i) + "]";
    if (auto wrong = rises(key.c_str(), r.quantiles_us[i], "the one before", r.quantiles_us[i - 1]);
        !wrong.empty())
      return wrong;
  }
  return {};
}

std::string wrong_with(const Calibration& c) {
  if (c.host.empty()) return refuse("host", "''", "the name of the machine that measured it");
  for (std::size_t i = 0; i < c.rows.size(); ++i) {
    const auto& r = c.rows[i];
    const std::string place = "task[" + std::to_string(i) + "].";
    if (std::string wrong = wrong_with(r, place); !wrong.empty()) return wrong;
    if (c.find(r.name, r.choice, r.level) != &r)
      return refuse(place + "level", std::to_string(r.level),
                    "once for " + r.name + (r.choice.empty() ? "" : " " + r.choice));
  }
  return {};
}

rt::Result<Calibration> checked(Calibration&& c, const std::string& path) {
  if (const std::string wrong = wrong_with(c); !wrong.empty())
    return rt::Error{path + ": " + wrong};
  return std::move(c);
}

}  // namespace

rt::Nanos CalibrationRow::budget() const noexcept {
  const TaskRow* row = table_row(name);
  if (row != nullptr && row->policy == rt::MissPolicy::kAbort &&
      static_cast<std::size_t>(level) < level_count(*row))
    return rt::Nanos{1000 * row->variants[static_cast<std::size_t>(level)].budget_us};
  return rt::Nanos{
      static_cast<std::int64_t>(1000.0 * std::max(1.2 * worst_us(), worst_us() + 10.0))};
}

void Calibration::describe(config::Section& s) {
  s.text("host", host, {}, "machine that measured it");
  s.text("build", build, {}, "program that measured it");
  s.text("config", config, {}, "hash of the configuration");
  s.text("recording", recording, {}, "folder of recorded images");
  s.text("pictures", pictures, {}, "codecs of pictures that it was measured with");
  s.number("camera_twin_share", camera_twin_share, -1, 64,
           "of a core, what the camera's twin took; below 0: not measured");
  s.number("link_share", link_share, -1, 64,
           "of a core, what both ends of the link took; below 0: not measured");
  s.flag("ray_cast", ray_cast, "measured with haptic.method = \"force_shading\"");
  s.list(
      "task", [this](config::Section& item) { rows.emplace_back().describe(item); }, "one variant");
}

std::string Calibration::does_not_track(const CalibrationRow& row) const {
  double best = 0;
  for (const auto& r : rows) {
    if (r.name == row.name) best = std::max(best, r.claimed_share);
  }
  const double most_mm = recording.empty() ? kMostOff_mm : kMostOffReference_mm;
  char text[120] = "";
  if (row.tracked_share >= 0 && row.tracked_share < kLeastTrackedShare)
    std::snprintf(text, sizeof text,
                  "it is lost on %.1f %% of the stored images, %.0f %% are allowed",
                  100 * (1 - row.tracked_share), 100 * (1 - kLeastTrackedShare));
  else if (row.claimed_share >= 0 && row.claimed_share < best - kMostClaimsLess)
    std::snprintf(text, sizeof text, "it claims %.1f %% of the stored images, another one %.1f %%",
                  100 * row.claimed_share, 100 * best);
  else if (row.off_mm > most_mm)
    std::snprintf(text, sizeof text, "it claims a pose %.0f mm off, %.0f mm are allowed",
                  row.off_mm, most_mm);
  return text;
}

const CalibrationRow* Calibration::find(std::string_view name, std::string_view choice,
                                        int level) const noexcept {
  for (const auto& r : rows) {
    if (r.name == name && r.choice == choice && r.level == level) return &r;
  }
  return nullptr;
}

std::string Calibration::lacks(const CalibrationOrigin& wanted,
                               const std::vector<rt::TaskSpec>& specs) const {
  const auto differs = [](const char* what, const std::string& here, const std::string& there) {
    return std::string("another ") + what + " (" + (there.empty() ? "none" : there) + ", now " +
           (here.empty() ? "none" : here) + ")";
  };
  if (host != wanted.host) return differs("host", wanted.host, host);
  if (build != wanted.build) return differs("build", wanted.build, build);
  if (recording != wanted.recording) return differs("recording", wanted.recording, recording);
  if (config != wanted.config) return differs("configuration", wanted.config, config);
  const auto missing = [&](const rt::TaskSpec& s, const std::string& choice,
                           std::size_t n) -> std::string {
    for (std::size_t level = 0; level < n; ++level) {
      if (find(s.name, choice, static_cast<int>(level)) == nullptr)
        return "no row of " + s.name + (choice.empty() ? "" : " " + choice) + ", level " +
               std::to_string(level);
    }
    return {};
  };
  for (const auto& s : specs) {
    if (s.choices.empty()) {
      auto text = missing(s, s.choice, static_cast<std::size_t>(s.levels()));
      if (!text.empty()) return text;
    }
    for (const auto& c : s.choices) {
      if (!c.ruled_out.empty()) continue;
      if (auto text = missing(s, c.name, c.variants.size()); !text.empty()) return text;
    }
  }
  return {};
}

Calibration with_ray_cast(Calibration c, std::int64_t job_us) {
  if (job_us == 0 || c.ray_cast) return c;
  const auto cast_us = static_cast<double>(job_us);
  for (CalibrationRow& r : c.rows) {
    double more_us = 0;
    if (r.name == kTaskTable[index_of(TaskId::kHaptic)].name) more_us = kReduction_us;
    if (r.name == kWorkerRow) more_us = kWorkerShare * cast_us;
    if (r.name == kTaskTable[index_of(TaskId::kFusion)].name) {
      const bool shared = c.find(kWorkerRow, r.choice, r.level) != nullptr;
      more_us = (shared ? kOwnShare : 1.0) * cast_us;
    }
    for (double* us : {&r.p50_us, &r.p99_us, &r.p999_us}) *us += more_us;
    for (double& us : r.quantiles_us) us += more_us;
    for (double* us : {&r.still_p50_us, &r.still_p999_us, &r.moving_p50_us, &r.moving_p999_us})
      *us += *us < 0 ? 0 : more_us;
  }
  c.ray_cast = true;
  return c;
}

Calibration with_pictures(Calibration c, const std::string& dialect, std::int64_t encode_us) {
  if (encode_us == 0 || !c.pictures.empty()) return c;
  const auto more_us = static_cast<double>(encode_us);
  for (CalibrationRow& r : c.rows) {
    if (r.name != kTaskTable[index_of(TaskId::kCapture)].name) continue;
    for (double* us : {&r.p50_us, &r.p99_us, &r.p999_us}) *us += more_us;
    for (double& us : r.quantiles_us) us += more_us;
  }
  c.pictures = dialect;
  return c;
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
  return checked(std::move(c), path);
}

rt::Result<Calibration> read_calibration(const std::string& text, const std::string& name) {
  Calibration c;
  config::Section root;
  c.describe(root);
  if (auto ok = config::load_text(text, name, root); !ok) return rt::Error{ok.error()};
  return checked(std::move(c), name);
}

namespace {

// As a TOML basic string.
std::string quoted(const std::string& text) {
  std::string out = "\"";
  for (const char ch : text) {
    char code[8];
    if (static_cast<unsigned char>(ch) < 0x20 || ch == 0x7f) {
      std::snprintf(code, sizeof code, "\\u%04x", static_cast<unsigned>(ch));
      out += code;
      continue;
    }
    if (ch == '"' || ch == '\\') out += '\\';
    out += ch;
  }
  return out + "\"";
}

}  // namespace

void save_calibration(const std::string& path, const Calibration& calibration) {
  const std::string temporary = path + ".tmp";
  {
    std::ofstream out(temporary);
    out << "# CPU of each task variant on the same stored input, measured by `teletact "
           "calibrate`.\n"
           "# budget = max(1.2 p99.9, p99.9 + 10 us); planning keeps its declared budget, which "
           "its\n"
           "# abort enforces: its rows are what it takes when it is left to end.\n"
        << "host = " << quoted(calibration.host) << "\n";
    if (!calibration.build.empty()) out << "build = " << quoted(calibration.build) << "\n";
    if (!calibration.config.empty()) out << "config = " << quoted(calibration.config) << "\n";
    if (!calibration.recording.empty())
      out << "recording = " << quoted(calibration.recording) << "\n";
    if (calibration.ray_cast) out << "ray_cast = true\n";
    if (!calibration.pictures.empty()) out << "pictures = \"" << calibration.pictures << "\"\n";
    char line[256];
    for (const auto& [key, share] : {std::pair{"camera_twin_share", calibration.camera_twin_share},
                                     std::pair{"link_share", calibration.link_share}}) {
      if (share < 0) continue;
      std::snprintf(line, sizeof line, "%s = %.4f\n", key, share);
      out << line;
    }
    for (const auto& r : calibration.rows) {
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
      for (const auto& [key, value] :
           {std::pair{"still_p50_us", r.still_p50_us}, std::pair{"still_p999_us", r.still_p999_us},
            std::pair{"moving_p50_us", r.moving_p50_us},
            std::pair{"moving_p999_us", r.moving_p999_us},
            std::pair{"tracked_share", r.tracked_share},
            std::pair{"claimed_share", r.claimed_share}, std::pair{"off_mm", r.off_mm}}) {
        if (value < 0) continue;
        std::snprintf(line, sizeof line, "%s = %.4f\n", key, value);
        out << line;
      }
    }
    if (!out.flush()) {
      std::remove(temporary.c_str());
      throw std::runtime_error(path + ": can not be written");
    }
  }
  if (std::rename(temporary.c_str(), path.c_str()) != 0) {
    std::remove(temporary.c_str());
    throw std::runtime_error(path + ": can not be written");
  }
}

namespace {

std::vector<rt::Variant> make_variants(const Calibration& calibration, const TaskRow& row,
                                       const std::string& choice,
                                       const std::array<std::int64_t, 4>& declared_us) {
  std::vector<rt::Variant> variants;
  for (std::size_t level = 0; level < level_count(row); ++level) {
    const auto* measured = calibration.find(row.name, choice, static_cast<int>(level));
    // Overload must not lead to where nothing is tracked.
    if (level > 0 && measured != nullptr && !calibration.does_not_track(*measured).empty()) break;
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
        const auto* best = calibration.find(row.name, o.name, 0);
        auto declared_us = o.budgets_us;
        for (auto& us : declared_us) us += limits.ray_cast_us;
        s.choices.push_back({o.name, make_variants(calibration, row, o.name, declared_us),
                             o.ruled_out.empty() && best != nullptr
                                 ? calibration.does_not_track(*best)
                                 : o.ruled_out});
      }
    } else {
      std::array<std::int64_t, 4> declared_us{};
      for (std::size_t i = 0; i < declared_us.size(); ++i)
        declared_us[i] = row.variants[i].budget_us;
      if (row.id == TaskId::kHaptic && limits.ray_cast_us > 0) declared_us[0] += kReduction_us;
      if (row.id == TaskId::kCapture) {
        for (auto& us : declared_us) us += us > 0 ? limits.encode_us : 0;
      }
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
        double share = 0.3 + 0.5 * static_cast<double>(i) / 32.0;
        if (row != nullptr && spec.policy == rt::MissPolicy::kAbort)
          share = std::min(1000 * row->quantiles_us[i] / budget, 1 / 1.2);
        else if (row != nullptr && row->p999_us > 0)
          share = std::min(row->quantiles_us[i] / row->worst_us(), 1.0) / 1.2;
        q.value_ns.push_back(static_cast<std::int64_t>(share * budget));
      }
    }
  }
  return tables;
}

}  // namespace tasks
