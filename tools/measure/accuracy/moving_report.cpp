#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <map>
#include <stdexcept>

#include "rt/quantile.hpp"
#include "tools/measure/accuracy/moving_study.hpp"
#include "tools/report/svg.hpp"

namespace teletact {

namespace {

struct Judged {
  int runs = 0, failing = 0;
  double worst = std::numeric_limits<double>::quiet_NaN(), median = worst, sum = 0;
};

Judged judge(const MovingCheck& c, const std::vector<MovingRow>& rows) {
  Judged j;
  std::vector<double> all;
  for (const MovingRow& row : rows) {
    if (!c.applies(row)) continue;
    const double v = c.figure(row);
    if (std::isnan(v)) continue;
    all.push_back(v);
    j.failing += (c.at_least ? v < c.limit : v > c.limit) ? 1 : 0;
    j.sum += v;
  }
  j.runs = static_cast<int>(all.size());
  if (all.empty()) return j;
  std::sort(all.begin(), all.end());
  j.worst = c.at_least ? all.front() : all.back();
  j.median = rt::quantile_of_sorted(std::span(all), 0.5);
  return j;
}

std::string number(double v) {
  if (std::isnan(v)) return "-";
  char text[32];
  std::snprintf(text, sizeof text, std::abs(v) >= 100 ? "%.0f" : "%.3g", v);
  return text;
}

// Samples that fail something, of all, by what they are.
void print_failing(std::ostream& out, const std::vector<MovingRow>& rows) {
  std::map<std::string, std::pair<int, int>> by;  // failing, all
  std::map<int, std::pair<const MovingRow*, bool>> samples;
  for (const MovingRow& row : rows) {
    auto& s = samples.try_emplace(row.sample.index, &row, false).first->second;
    s.second |= !failed_checks(row).empty();
  }
  for (const auto& [index, s] : samples) {
    const MovingRow& row = *s.first;
    const int tenth = std::min(5, static_cast<int>(10 * row.share));
    const std::string share =
        "share ." + std::to_string(tenth) + "0 to ." + std::to_string(tenth + 1) + "0";
    for (const std::string& key :
         {std::string("mover ") + name_of(row.sample.kind), share,
          std::string(row.sample.from_rest ? "start after rest" : "start at the first frame"),
          std::string("camera ") + name_of(row.sample.carry),
          std::string("end ") + name_of(row.sample.end), std::string("all")}) {
      ++by[key].second;
      by[key].first += s.second ? 1 : 0;
    }
  }
  out << "\nsamples that miss something\n";
  for (const auto& [key, n] : by) {
    char line[100];
    std::snprintf(line, sizeof line, "  %-28s %3d of %3d\n", key.c_str(), n.first, n.second);
    out << line;
  }
}

plot::Figure figure_of(const char* title, const char* x_label) {
  plot::Figure f;
  f.title = title;
  f.x_label = x_label;
  f.y_label = "largest error of a frame, mm";
  f.log_y = true;
  f.height_px = 420;
  f.series = {{"claimed", {}, {}, "#0072b2", true, false},
              {"some frames unclaimed", {}, {}, "#e69f00", true, false},
              {"claimed and wrong", {}, {}, "#d55e00", true, false}};
  f.rules = {{20, false, "20 mm", "#b03a2e"}, {50, false, "50 mm", "#b03a2e"}};
  return f;
}

}  // namespace

int MovingStudy::missed() const {
  int missed = 0;
  for (const MovingCheck& c : moving_checks()) missed += judge(c, rows).failing > 0 ? 1 : 0;
  return missed;
}

void MovingStudy::print(std::ostream& out) const {
  char line[200];
  std::snprintf(line, sizeof line, "\n%-60s %5s %9s %9s %9s %8s\n", "", "runs", "median", "worst",
                "limit", "failing");
  out << line;
  for (const MovingCheck& c : moving_checks()) {
    const Judged j = judge(c, rows);
    const std::string limit = (c.at_least ? ">= " : "<= ") + number(c.limit);
    std::snprintf(line, sizeof line, "%-60s %5d %9s %9s %9s %8d %s\n", c.what.c_str(), j.runs,
                  number(j.median).c_str(), number(j.worst).c_str(), limit.c_str(), j.failing,
                  j.runs == 0      ? "-"
                  : j.failing == 0 ? "met"
                                   : "MISSED");
    out << line;
  }
  print_failing(out, rows);
}

std::vector<BenchMetric> MovingStudy::metrics() const {
  std::vector<BenchMetric> all;
  const auto add = [&](const std::string& name, double v, const char* unit) {
    if (std::isfinite(v)) all.push_back({"moving." + name, v, unit});
  };
  struct Band {
    const char* suffix;
    double from, to;
  };
  // Of the runs without odometry.
  for (const Band& band : {Band{"", 0, 1}, Band{".share30", 0, 0.30}, Band{".share60", 0.30, 1}}) {
    std::vector<double> ious;
    double ate = MovingRun::kNone, claimed = MovingRun::kNone, ghost = MovingRun::kNone, wrong = 0;
    for (const MovingRow& row : rows) {
      if (row.variant != MovingVariant::kAlone || row.share <= band.from || row.share > band.to) {
        continue;
      }
      ate = std::fmax(ate, row.above_plain_mm());
      claimed = std::fmin(claimed, row.run.claimed);
      ghost = std::fmax(ghost, row.run.ghost_cm3);
      wrong += row.run.wrong;
      if (!std::isnan(row.run.mask_iou)) ious.push_back(row.run.mask_iou);
    }
    add(std::string("ate_mm") + band.suffix, ate, "mm");
    add(std::string("wrong_claims") + band.suffix, wrong, "1");
    add(std::string("claimed_share") + band.suffix, claimed, "1");
    if (!ious.empty()) add(std::string("mask_iou") + band.suffix, rt::quantile(ious, 0.5), "1");
    add(std::string("ghost_cm3") + band.suffix, ghost, "cm3");
  }
  for (const MovingCheck& c : moving_checks()) {
    const Judged j = judge(c, rows);
    add("failing." + c.name, j.failing, "1");
    const bool counted = c.name.find("wrong_claims") != std::string::npos;
    const bool there = std::any_of(
        all.begin(), all.end(), [&](const BenchMetric& m) { return m.name == "moving." + c.name; });
    const bool mm = c.name.find("ate_mm") != std::string::npos;
    if (!there) add(c.name, counted ? j.sum : j.worst, mm ? "mm" : "1");
  }
  return all;
}

std::vector<std::string> MovingStudy::write_plots(const std::string& folder) const {
  const bool watch = rows.empty() || rows.front().setting.watch;
  plot::Figure share =
      figure_of(watch ? "a thing moves: share of the image"
                      : "a thing moves, without the watch for it: share of the image",
                "share of the valid pixels");
  plot::Figure slide = figure_of("a thing slides: speed", "mm a frame");
  plot::Figure turn = figure_of("a door or an arm turns: speed", "degrees a frame");
  slide.log_x = turn.log_x = true;
  for (const MovingRow& row : rows) {
    if (row.variant != MovingVariant::kAlone || !std::isfinite(row.run.worst_mm)) continue;
    const std::size_t s = row.run.wrong > 0 ? 2U : row.run.claimed < 0.98 ? 1U : 0U;
    const double error = std::max(0.1, row.run.worst_mm);
    const bool angular = row.sample.kind == MoverKind::kDoor || row.sample.kind == MoverKind::kArm;
    plot::Figure& speed = angular ? turn : slide;
    share.series[s].x.push_back(row.share), share.series[s].y.push_back(error);
    speed.series[s].x.push_back(row.sample.step), speed.series[s].y.push_back(error);
  }
  std::error_code ec;
  std::filesystem::create_directories(folder, ec);
  std::vector<std::string> files;
  const auto write = [&](const std::string& name, const plot::Figure& f) {
    const std::string path = folder + "/" + name + ".svg";
    std::ofstream out(path, std::ios::binary);
    out << plot::line_plot(f);
    if (!out.flush()) throw std::runtime_error(path + ": cannot write");
    files.push_back(path);
  };
  write("moving_share", share);
  write("moving_speed_slide", slide);
  write("moving_speed_turn", turn);
  return files;
}

}  // namespace teletact
