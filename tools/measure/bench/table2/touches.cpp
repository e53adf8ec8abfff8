#include "tools/measure/bench/table2/touches.hpp"
#include "rt/clock/box_time.hpp"
#include "rt/quantile.hpp"
#include "tools/measure/bench/other_load.hpp"

#include <algorithm>
#include <cstdio>
#include <map>
#include <memory>

#include "perception/segmentation/measures.hpp"
#include "perception/segmentation/region_grow.hpp"
#include "rt/random.hpp"
#include "tools/measure/bench/table2/followed.hpp"
#include "tools/measure/bench/table2/labelled_frames.hpp"

namespace teletact {
namespace {

using perception::Image;

constexpr int kTouches = 10;

double cpu_ms() { return 1e-6 * static_cast<double>(rt::thread_cpu_ns()); }

// Pixels at least 3 from the mask's edge; all of them where it is thinner.
std::vector<int> touchable(const Image<std::uint16_t>& label, std::uint16_t object) {
  const int n = label.width() * label.height();
  std::vector<std::uint8_t> other(static_cast<std::size_t>(n));
  for (int i = 0; i < n; ++i) other[static_cast<std::size_t>(i)] = label.data()[i] != object;
  const auto d2 = perception::squared_distance(other, label.width(), label.height());
  std::vector<int> all, inner;
  for (int i = 0; i < n; ++i) {
    if (other[static_cast<std::size_t>(i)]) continue;
    all.push_back(i);
    if (d2[static_cast<std::size_t>(i)] >= 9) inner.push_back(i);
  }
  return inner.empty() ? all : inner;
}

class Judge {
 public:
  Judge(const FrameKind& kind, int w, int h, const perception::TouchConfig& config,
        bool touches_only)
      : kind_(kind),
        touches_only_(touches_only),
        touch_(w, h, config),
        lab_(w, h),
        points_(w, h),
        grower_(w, h),
        fused_(kind.k, kind.mm_per_unit) {}

  void frame(const LabelledFrame& f, rt::Random& random, TouchRow& row) {
    std::map<std::uint16_t, std::vector<int>> objects;
    for (int i = 0; i < f.label.width() * f.label.height(); ++i) {
      const std::uint16_t l = f.label.data()[i];
      if (l != 0 && l != kUnlabelled) objects[l];
    }
    touch_.set_frame(f.rgb.view(), f.depth.view(), kind_.k, kind_.mm_per_unit);
    if (!touches_only_) {
      lab_.set(f.rgb.view());
      points_.set(f.depth.view(), kind_.k, kind_.mm_per_unit);
    }
    for (auto& [object, pixels] : objects) {
      pixels = touchable(f.label, object);
      double good = 0, paper = 0;
      for (int k = 0; k < kTouches; ++k) {
        const int i = pixels[static_cast<std::size_t>(
            random.integer(0, static_cast<std::int64_t>(pixels.size()) - 1))];
        good += one_touch(f, object, i, k) / kTouches;
        if (!touches_only_) paper += one_paper(f, object, i) / kTouches;
      }
      good_.push_back(good);
      half_[static_cast<std::size_t>(row.frames % 2)].push_back(good);
      paper_.push_back(paper);
      row.touches += kTouches;
    }
    if (!touches_only_) {
      follow(f, objects);
      follow_in_map(f, objects, random);
    }
    ++row.frames;
  }
  void finish(TouchRow& row) const {
    row.objects = static_cast<int>(good_.size());
    for (std::size_t i = 0; i < good_.size(); ++i) {
      row.iou_default += good_[i] / static_cast<double>(good_.size());
      row.iou_paper += paper_[i] / static_cast<double>(good_.size());
    }
    for (const double x : followed_) row.iou_follow += x / static_cast<double>(followed_.size());
    for (std::size_t h = 0; h < 2; ++h) {
      double sum = 0;
      for (const double x : half_[h]) sum += x;
      row.iou_half[h] = sum / static_cast<double>(half_[h].size());  // none: NaN
    }
    row.iou_low = rt::quantile(good_, 0.1);
    row.first_ms = rt::quantile(first_, 0.5);
    row.first_p95_ms = rt::quantile(first_, 0.95);
    row.touch_ms = rt::quantile(touch_ms_, 0.5);
    row.touch_p95_ms = rt::quantile(touch_ms_, 0.95);
    row.follow_ms = rt::quantile(follow_ms_, 0.5);
    for (const double x : further_ms_)
      row.further_ms += x / static_cast<double>(further_ms_.size());
    for (const double x : fused_iou_) row.iou_fused += x / static_cast<double>(fused_iou_.size());
  }

 private:
  double one_touch(const LabelledFrame& f, std::uint16_t object, int i, int k) {
    const int w = f.label.width();
    const double t0 = cpu_ms();
    // The first touch of an object pays for the frame too; the others only repeat the question.
    if (k == 0) touch_.set_frame(f.rgb.view(), f.depth.view(), kind_.k, kind_.mm_per_unit);
    touch_.touch(i % w, i / w);
    if (k == 0) first_.push_back(cpu_ms() - t0);
    return iou(f.label, object, [&](int u, int v) { return touch_.in(u, v); });
  }
  double one_paper(const LabelledFrame& f, std::uint16_t object, int i) {
    const int w = f.label.width(), n = grower_.grow(lab_, &points_, i, {});
    mask_.assign(static_cast<std::size_t>(w * f.label.height()), 0);
    for (int k = 0; k < n; ++k) {
      mask_[static_cast<std::size_t>(grower_.members()[static_cast<std::size_t>(k)])] = 1;
    }
    return iou(f.label, object,
               [&](int u, int v) { return mask_[static_cast<std::size_t>(v * w + u)] != 0; });
  }
  // Each object as if its true mask were its projection from the map: work in its window only.
  void follow(const LabelledFrame& f, const std::map<std::uint16_t, std::vector<int>>& objects) {
    const int w = f.label.width(), h = f.label.height();
    for (const auto& [object, pixels] : objects) {
      mask_.assign(static_cast<std::size_t>(w * h), 0);
      for (int i = 0; i < w * h; ++i)
        mask_[static_cast<std::size_t>(i)] = f.label.data()[i] == object;
      const bool found = touch_.follow(f.rgb.view(), f.depth.view(), kind_.k, kind_.mm_per_unit,
                                       {mask_.data(), w, h, w});
      followed_.push_back(
          found ? iou(f.label, object, [&](int u, int v) { return touch_.in(u, v); }) : 0);
    }
  }

  // One touch an object, then all of them followed together.
  void follow_in_map(const LabelledFrame& f,
                     const std::map<std::uint16_t, std::vector<int>>& objects, rt::Random& random) {
    std::vector<FollowedObjects::Touch> touches;
    for (const auto& [object, pixels] : objects) {
      const int i = pixels[static_cast<std::size_t>(
          random.integer(0, static_cast<std::int64_t>(pixels.size()) - 1))];
      touches.push_back({object, i % f.label.width(), i / f.label.width()});
    }
    const FollowedRun run = fused_.run(f.rgb.view(), f.depth.view(), f.label, touches);
    touch_ms_.insert(touch_ms_.end(), run.touch_ms.begin(), run.touch_ms.end());
    follow_ms_.insert(follow_ms_.end(), run.one_ms.begin(), run.one_ms.end());
    fused_iou_.insert(fused_iou_.end(), run.iou.begin(), run.iou.end());
    if (run.objects > 1)
      further_ms_.push_back((run.all_mean_ms - run.one_mean_ms) / (run.objects - 1));
  }

  FrameKind kind_;
  bool touches_only_;
  perception::TouchSegmenter touch_;
  perception::LabImage lab_;
  perception::PointImage points_;
  perception::RegionGrower grower_;
  std::vector<std::uint8_t> mask_;
  FollowedObjects fused_;
  std::array<std::vector<double>, 2> half_;  // good_, by odd and even frame
  std::vector<double> good_, paper_, followed_, first_;
  std::vector<double> touch_ms_, follow_ms_, further_ms_, fused_iou_;
};

TouchRow run_folder(const LabelledFolder& folder, std::uint64_t seed,
                    const perception::TouchConfig& config, bool touches_only,
                    std::ostream& progress) {
  TouchRow row;
  row.folder = folder.name;
  std::unique_ptr<Judge> judge;
  rt::Random random(seed);
  for (const std::string& name : folder.frames) {
    progress << "\r" << row.folder << "/" << name << "   " << std::flush;
    const LabelledFrame f = load_frame(folder, name);
    if (!judge)
      judge = std::make_unique<Judge>(folder.kind, folder.kind.k.width, folder.kind.k.height,
                                      config, touches_only);
    judge->frame(f, random, row);
  }
  judge->finish(row);
  return row;
}

}  // namespace

TouchResult bench_touches(std::ostream& progress, const std::string& folder, std::uint64_t seed,
                          const perception::TouchConfig& config, bool touches_only) {
  const OtherLoad others;
  TouchResult result;
  result.seed = seed;
  for (const LabelledFolder& f : labelled_folders(progress, folder))
    result.rows.push_back(run_folder(f, seed, config, touches_only, progress));
  progress << "\r                                        \r";
  result.other_load = others.cores();
  return result;
}

std::string TouchRow::name() const { return metric_name(folder); }

std::vector<Limit> TouchResult::limits() const {
  Limits all;
  const std::string busy = disturbed(other_load);
  for (const TouchRow& r : rows) {
    const std::string name = r.name();
    if (name == "mosd") all.add("mosd, mean IoU", r.iou_default, ">=", 0.85);
    if (name == "tabletop") all.add("tabletop, mean IoU", r.iou_default, ">=", 0.80);
    const auto time = [&](const char* what, double ms, double limit_ms, const char* none) {
      all.add(name + what, ms, "<=", limit_ms, ms == 0 ? none : busy);
    };
    time(", answer to a touch, ms", r.touch_ms, 12, "no touch was followed");
    time(", a frame with one object, ms", r.follow_ms, 3.3, "no object was followed");
    time(", each further object, ms", r.further_ms, 0.5, "no image with two objects");
  }
  return all.all();
}

std::vector<BenchMetric> TouchResult::metrics() const {
  std::vector<BenchMetric> m{{"segmentation.seed", static_cast<double>(seed), "1"}};
  double cpu = 0;
  for (const TouchRow& r : rows) {
    const std::string head = "segmentation." + r.name() + ".";
    m.push_back({head + "iou_mean", r.iou_default, "1"});
    m.push_back({head + "iou_paper_mean", r.iou_paper, "1"});
    m.push_back({head + "first_ms", r.first_ms, "ms"});
    m.push_back({head + "touch_ms", r.touch_ms, "ms"});
    m.push_back({head + "touch_p95_ms", r.touch_p95_ms, "ms"});
    m.push_back({head + "follow_ms", r.follow_ms, "ms"});
    m.push_back({head + "further_ms", r.further_ms, "ms"});
    m.push_back({head + "iou_fused", r.iou_fused, "1"});
    cpu = std::max(cpu, r.first_ms);
  }
  m.push_back({"segmentation.cpu_ms", cpu, "ms"});
  return m;
}

void TouchResult::print(std::ostream& out) const {
  out << "one touch, " << kTouches << " touches an object, seed " << seed
      << "; ms: thread CPU, medians\n\n";
  char line[240];
  std::snprintf(line, sizeof line, "%-12s %7s %8s %9s %9s %9s %9s %9s %9s\n", "", "frames",
                "objects", "IoU", "IoU p10", "IoU paper", "whole ms", "p95", "followed");
  out << line;
  for (const TouchRow& r : rows) {
    std::snprintf(line, sizeof line, "%-12s %7d %8d %9.4f %9.4f %9.4f %9.2f %9.2f %9.4f\n",
                  r.folder.c_str(), r.frames, r.objects, r.iou_default, r.iou_low, r.iou_paper,
                  r.first_ms, r.first_p95_ms, r.iou_follow);
    out << line;
  }
  out << "\nas fusion does it: the answer to a touch, a frame with one object, each further "
         "object\n";
  std::snprintf(line, sizeof line, "%-12s %9s %9s %9s %10s %10s\n", "", "touch ms", "p95",
                "follow ms", "further ms", "IoU fused");
  out << line;
  for (const TouchRow& r : rows) {
    std::snprintf(line, sizeof line, "%-12s %9.2f %9.2f %9.2f %10.2f %10.4f\n", r.folder.c_str(),
                  r.touch_ms, r.touch_p95_ms, r.follow_ms, r.further_ms, r.iou_fused);
    out << line;
  }
  teletact::print(out, limits());
}

}  // namespace teletact
