#include "tools/measure/accuracy/choice_study.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>

#include "perception/segmentation/region_merge.hpp"
#include "rt/random.hpp"
#include "tools/measure/bench/table2/table2.hpp"
#include "tools/measure/bench/table2/touches.hpp"

namespace teletact {

namespace {

constexpr double kReach = 0.7;        // powers of two about the default
constexpr double kMostUnseen = 0.01;  // of the score

struct Draw {
  rt::Random& random;
  template <class T>
  void operator()(T& value) const {
    const double factor = std::exp2(random.uniform(-kReach, kReach));
    const double v = static_cast<double>(value) * factor;
    value = static_cast<T>(std::is_integral_v<T> ? std::max(1.0, std::round(v)) : v);
  }
};

perception::WholeImageConfig drawn_whole(rt::Random& random) {
  perception::WholeImageConfig c;
  const Draw draw{random};
  draw(c.superpixels.spacing_px), draw(c.superpixels.compactness), draw(c.smooth_px);
  draw(c.light_weight), draw(c.contrast_weight), draw(c.region_saturation), draw(c.spread);
  draw(c.size_power), draw(c.stop), draw(c.same), draw(c.crumb), draw(c.min_share);
  return c;
}

perception::TouchConfig drawn_touch(rt::Random& random) {
  perception::TouchConfig c;
  const Draw draw{random};
  perception::ObjectGraphConfig& g = c.graph;
  draw(c.patches.superpixels.spacing_px), draw(g.step_m), draw(g.step_per_m2);
  draw(g.smooth_deg), draw(g.crease_deg), draw(g.step_weight), draw(g.concave_weight);
  draw(g.colour_weight), draw(g.colour_scale), draw(g.same_colour), draw(g.same_colour_step);
  draw(g.stop), draw(g.area_cm2), draw(g.step_area_cm2), draw(g.support_m);
  draw(g.support_per_m2), draw(g.rim_m), draw(g.bottom_share), draw(g.rim_share);
  g.same_colour = std::min(g.same_colour, 1.0F);
  g.same_colour_step = std::min(g.same_colour_step, 1.0F);
  g.bottom_share = std::min(g.bottom_share, 1.0F);
  return c;
}

double score_of(const perception::SegmentationScores& s) {
  return s.pri - s.gce - s.voi_bits / 10 - s.bde_px / 100;
}

}  // namespace

std::size_t ChoiceRow::best(std::size_t half) const {
  std::size_t best = 0;
  for (std::size_t n = 1; n < scores.size(); ++n)
    if (scores[n][half] > scores[best][half]) best = n;
  return best;
}

int ChoiceRow::better(std::size_t half) const {
  return static_cast<int>(std::count_if(scores.begin(), scores.end(),
                                        [&](const auto& s) { return s[half] > scores[0][half]; }));
}

double ChoiceRow::unseen_gain(std::size_t half) const {
  return scores[best(1 - half)][half] - scores[0][half];
}

Choice study_choice(std::ostream& progress, const ChoiceOptions& options) {
  Choice out;
  rt::Random random(options.seed);
  const bool whole = std::filesystem::is_directory(options.data + "/segmentations");
  for (int n = 0; n <= options.settings; ++n) {
    char text[40];
    std::snprintf(text, sizeof text, "setting %d of %d\n", n, options.settings);
    progress << text;
    if (whole) {
      if (n == 0) out.rows.push_back({"table2", "PRI - GCE - VOI / 10 - BDE / 100", {}});
      const Table2Result r =
          bench_table2(progress, options.data, true,
                       n == 0 ? perception::WholeImageConfig{} : drawn_whole(random));
      out.rows[0].scores.push_back({score_of(r.odd.mean), score_of(r.even.mean)});
      continue;
    }
    const TouchResult r =
        bench_touches(progress, options.data, options.seed,
                      n == 0 ? perception::TouchConfig{} : drawn_touch(random), true);
    for (std::size_t i = 0; i < r.rows.size(); ++i) {
      if (n == 0) out.rows.push_back({r.rows[i].name(), "mean IoU of a touch", {}});
      out.rows[i].scores.push_back(r.rows[i].iou_half);
    }
  }
  return out;
}

std::vector<Limit> Choice::limits() const {
  Limits all;
  for (const ChoiceRow& r : rows)
    for (const std::size_t half : {std::size_t{0}, std::size_t{1}})
      all.add(r.data + (half == 0 ? ", 1st, 3rd, ...: " : ", 2nd, 4th, ...: ") +
                  "chosen on the other half, less the default",
              r.unseen_gain(half), "<=", kMostUnseen,
              std::isfinite(r.scores[0][half]) ? "" : "no object in this half");
  return all.all();
}

std::vector<BenchMetric> Choice::metrics() const {
  std::vector<BenchMetric> m;
  for (const ChoiceRow& r : rows)
    for (const std::size_t half : {std::size_t{0}, std::size_t{1}}) {
      const std::string head = "choice." + r.data + (half == 0 ? ".odd." : ".even.");
      m.push_back({head + "default", r.scores[0][half], "1"});
      m.push_back({head + "chosen_here", r.scores[r.best(half)][half], "1"});
      m.push_back({head + "chosen_there", r.scores[r.best(1 - half)][half], "1"});
      m.push_back({head + "better_settings", static_cast<double>(r.better(half)), "1"});
    }
  return m;
}

void Choice::print(std::ostream& out) const {
  char line[200];
  for (const ChoiceRow& r : rows) {
    std::snprintf(line, sizeof line, "%s, %s, %zu settings\n%-22s %10s %14s %15s %10s\n",
                  r.data.c_str(), r.score.c_str(), r.scores.size() - 1, "", "default",
                  "chosen on it", "on the other", "better");
    out << line;
    for (const std::size_t half : {std::size_t{0}, std::size_t{1}}) {
      std::snprintf(line, sizeof line, "%-22s %10.4f %14.4f %15.4f %10d\n",
                    half == 0 ? "1st, 3rd, ... image" : "2nd, 4th, ... image", r.scores[0][half],
                    r.scores[r.best(half)][half], r.scores[r.best(1 - half)][half], r.better(half));
      out << line;
    }
    out << '\n';
  }
  teletact::print(out, limits());
}

}  // namespace teletact
