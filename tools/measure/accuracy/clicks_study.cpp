#include "tools/measure/accuracy/clicks_study.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

#include "perception/segmentation/click_segmenter.hpp"
#include "perception/segmentation/measures.hpp"
#include "rt/clock/box_time.hpp"
#include "rt/quantile.hpp"
#include "tools/measure/accuracy/clutter_scene.hpp"

namespace teletact {

using perception::Click;
using perception::ClickConfig;

namespace {

constexpr int kClicks = 5;

struct Setting {
  std::string knob, setting, label;
  ClickConfig config;
};

template <class T, class Set>
void vary(std::vector<Setting>& all, const char* knob, const char* word, T usual,
          std::initializer_list<T> values, Set set) {
  for (const T v : values) {
    if (v == usual) continue;
    char text[32];
    std::snprintf(text, sizeof text, "%g", static_cast<double>(v));
    Setting s{knob, "", std::string(word) + " " + text, {}};
    s.setting = s.label;
    std::replace_if(
        s.setting.begin(), s.setting.end(), [](char c) { return c == ' ' || c == '.'; }, '_');
    set(s.config, v);
    all.push_back(std::move(s));
  }
}

std::vector<Setting> settings(bool knobs) {
  std::vector<Setting> all{{"default", "default", "default", {}}};
  if (!knobs) return all;
  const ClickConfig d;
  vary(all, "reach", "reach", d.correction.reach_px, {4, 6, 12, 16},
       [](ClickConfig& c, int v) { c.correction.reach_px = v; });
  vary(all, "other answers", "answers", d.correction.answer_weight, {0.0F, 0.05F, 0.1F, 0.4F, 0.8F},
       [](ClickConfig& c, float v) { c.correction.answer_weight = v; });
  vary(all, "the parted answer", "parted", d.correction.parted_weight, {0.0F, 0.1F, 0.6F, 1.0F},
       [](ClickConfig& c, float v) { c.correction.parted_weight = v; });
  vary(all, "shift", "shift", d.correction.shift_px, {0.0F, 0.6F, 1.2F},
       [](ClickConfig& c, float v) { c.correction.shift_px = v; });
  vary(all, "direction", "direction", d.correction.direction_px, {0.0F, 0.6F, 1.2F},
       [](ClickConfig& c, float v) { c.correction.direction_px = v; });
  vary(all, "beside a click", "local", d.correction.local_px, {0.5F, 1.0F, 4.0F},
       [](ClickConfig& c, float v) { c.correction.local_px = v; });
  vary(all, "how far beside", "beside", d.correction.local_reach_px, {5.0F, 20.0F, 40.0F},
       [](ClickConfig& c, float v) { c.correction.local_reach_px = v; });
  vary(all, "slack", "slack", d.correction.slack_px, {0.1F, 1.0F},
       [](ClickConfig& c, float v) { c.correction.slack_px = v; });
  vary(all, "smoothing", "smooth", d.correction.smooth_rounds, {0, 3},
       [](ClickConfig& c, int v) { c.correction.smooth_rounds = v; });
  vary(all, "deep", "deep", d.deep_px, {4.0F, 10.0F},
       [](ClickConfig& c, float v) { c.deep_px = v; });
  vary(all, "reach of taking away", "away", d.parted_reach, {2.0F, 8.0F},
       [](ClickConfig& c, float v) { c.parted_reach = v; });
  vary(all, "way over colours", "colours", d.split.colour_px, {0.0F, 60.0F},
       [](ClickConfig& c, float v) { c.split.colour_px = v; });
  vary(all, "way over valleys", "valleys", d.split.valley_px, {0.0F, 60.0F},
       [](ClickConfig& c, float v) { c.split.valley_px = v; });
  vary(all, "way over steps", "steps", d.split.step_px, {0.0F, 120.0F},
       [](ClickConfig& c, float v) { c.split.step_px = v; });
  return all;
}

// Of one folder or of the clutter, over its settings.
struct Tally {
  std::array<std::array<double, 2>, kClicks> iou{};  // sums by click, by odd and even frame
  std::array<double, 2> objects{};
  std::vector<double> ms;  // of an answer to the last click
  [[nodiscard]] double error(int click, std::size_t half) const {
    return 1 - iou[static_cast<std::size_t>(click - 1)][half] / objects[half];
  }
  [[nodiscard]] double error(int click) const {
    const auto& sum = iou[static_cast<std::size_t>(click - 1)];
    return 1 - (sum[0] + sum[1]) / (objects[0] + objects[1]);
  }
};

void judge(const LabelledFrame& frame, perception::ClickSegmenter& segmenter, std::size_t half,
           Tally& tally) {
  for (const std::uint16_t object : objects_of(frame)) {
    std::vector<Click> clicks;
    const perception::Image<std::uint8_t> nothing(frame.label.width(), frame.label.height(), 0);
    perception::ImageView<const std::uint8_t> mask = nothing.view();
    for (std::size_t n = 0; n < kClicks; ++n) {
      const Click next = next_click(frame.label, object, mask);
      if (next.u >= 0) {
        clicks.push_back(next);
        const auto t0 = rt::thread_cpu_ns();
        static_cast<void>(segmenter.segment(clicks));
        if (n + 1 == kClicks)
          tally.ms.push_back(1e-6 * static_cast<double>(rt::thread_cpu_ns() - t0));
        mask = segmenter.mask();
      }
      tally.iou[n][half] +=
          iou(frame.label, object, [&](int u, int v) { return mask.at(u, v) != 0; });
    }
    tally.objects[half] += 1;
  }
}

class Judged {
 public:
  Judged(std::string name, const std::vector<Setting>& settings)
      : name_(std::move(name)), settings_(settings), tallies_(settings.size()) {}

  void frame(const LabelledFrame& f, const perception::Intrinsics& k, float mm_per_unit) {
    for (std::size_t i = 0; i < settings_.size(); ++i) {
      perception::ClickSegmenter segmenter(f.rgb.width(), f.rgb.height(), settings_[i].config);
      segmenter.set_frame(f.rgb.view(), f.depth.view(), k, mm_per_unit);
      judge(f, segmenter, frames_ % 2, tallies_[i]);
    }
    ++frames_;
  }
  void add_to(Study& study) const {
    study.plots.push_back({"accuracy_clicks_" + name_, "three clicks, " + name_, name_, "error_3",
                           "1 - mean IoU", "click_ms", "CPU of an answer, ms"});
    for (std::size_t i = 0; i < settings_.size(); ++i) {
      const Tally& t = tallies_[i];
      StudyRow row;
      row.data = name_;
      row.knob = settings_[i].knob, row.setting = settings_[i].setting;
      row.label = settings_[i].label;
      row.is_default = i == 0;
      for (const int n : {1, 2, 3, 5})
        row.figures.push_back({"error_" + std::to_string(n), t.error(n), "1"});
      for (const int n : {3, 5}) {
        row.figures.push_back({"error_" + std::to_string(n) + "_odd", t.error(n, 0), "1"});
        row.figures.push_back({"error_" + std::to_string(n) + "_even", t.error(n, 1), "1"});
      }
      row.figures.push_back({"click_ms", rt::quantile(t.ms, 0.5), "ms"});
      study.rows.push_back(std::move(row));
    }
  }

 private:
  std::string name_;
  const std::vector<Setting>& settings_;
  std::vector<Tally> tallies_;
  std::size_t frames_ = 0;
};

// The largest 4-connected part of what is nonzero, parts of unlike values being apart.
std::vector<int> largest_part(std::vector<std::uint8_t>& error, int w, int h) {
  std::vector<int> best, part;
  for (int first = 0; first < w * h; ++first) {
    const std::uint8_t kind = error[static_cast<std::size_t>(first)];
    if (kind == 0) continue;
    part.assign(1, first);
    error[static_cast<std::size_t>(first)] = 0;
    for (std::size_t k = 0; k < part.size(); ++k) {
      const int i = part[k], x = i % w, y = i / w;
      for (const int j : {x > 0 ? i - 1 : -1, x + 1 < w ? i + 1 : -1, y > 0 ? i - w : -1,
                          y + 1 < h ? i + w : -1}) {
        if (j < 0 || error[static_cast<std::size_t>(j)] != kind) continue;
        error[static_cast<std::size_t>(j)] = 0;
        part.push_back(j);
      }
    }
    if (part.size() > best.size()) best = part;
  }
  return best;
}

}  // namespace

Click next_click(const perception::Image<std::uint16_t>& label, std::uint16_t object,
                 perception::ImageView<const std::uint8_t> mask) {
  const int w = label.width(), h = label.height();
  std::vector<std::uint8_t> error(static_cast<std::size_t>(w * h), 0);
  for (int i = 0; i < w * h; ++i) {
    const std::uint16_t l = label.data()[i];
    const bool in = mask.at(i % w, i / w) != 0;
    if (l != kUnlabelled && in != (l == object)) error[static_cast<std::size_t>(i)] = in ? 2 : 1;
  }
  const std::vector<int> part = largest_part(error, w, h);
  if (part.empty()) return {-1, -1, true};
  // Beyond the image's rim nothing is of the part.
  std::vector<std::uint8_t> outside(static_cast<std::size_t>((w + 2) * (h + 2)), 1);
  const auto place = [&](int i) {
    return static_cast<std::size_t>((i / w + 1) * (w + 2) + i % w + 1);
  };
  for (const int i : part) outside[place(i)] = 0;
  const auto d2 = perception::squared_distance(outside, w + 2, h + 2);
  const int middle = *std::max_element(part.begin(), part.end(), [&](int a, int b) {
    return d2[place(a)] != d2[place(b)] ? d2[place(a)] < d2[place(b)] : a > b;
  });
  return {middle % w, middle / w, label.data()[middle] == object};
}

Study study_clicks(std::ostream& progress, const ClicksStudyOptions& options) {
  Study study;
  study.name = "accuracy.clicks";
  const auto all = settings(options.knobs);
  if (!options.data.empty()) {
    for (const LabelledFolder& folder : labelled_folders(progress, options.data)) {
      Judged judged(metric_name(folder.name), all);
      for (const std::string& name : folder.frames) {
        progress << folder.name << "/" << name << "\n" << std::flush;
        judged.frame(load_frame(folder, name), folder.kind.k, folder.kind.mm_per_unit);
      }
      judged.add_to(study);
    }
  }
  if (options.clutter > 0) {
    Judged judged("clutter", all);
    for (int n = 0; n < options.clutter; ++n) {
      progress << "clutter, seed " << options.seed + static_cast<std::uint64_t>(n) << "\n"
               << std::flush;
      const ClutterScene scene = clutter_scene(options.seed + static_cast<std::uint64_t>(n));
      judged.frame(scene.frame, scene.k, 1);
    }
    judged.add_to(study);
  }
  return study;
}

}  // namespace teletact
