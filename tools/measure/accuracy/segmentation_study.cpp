#include "tools/measure/accuracy/segmentation_study.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "perception/segmentation/touch_segmenter.hpp"
#include "tools/measure/bench/table2/touches.hpp"

namespace teletact {

using perception::TouchConfig;

namespace {

struct Setting {
  std::string knob, setting, label;
  TouchConfig config;
  bool is_default = false;
};

// One knob after the other; its default value is the setting "default".
template <class T, class Set>
void vary(std::vector<Setting>& all, const char* knob, const char* word, T usual,
          std::initializer_list<T> values, Set set) {
  for (const T v : values) {
    if (v == usual) continue;
    Setting s;
    char text[32];
    std::snprintf(text, sizeof text, "%g", static_cast<double>(v));
    s.knob = knob;
    s.label = std::string(word) + " " + text;
    s.setting = s.label;
    std::replace_if(
        s.setting.begin(), s.setting.end(), [](char c) { return c == ' ' || c == '.'; }, '_');
    set(s.config, v);
    all.push_back(std::move(s));
  }
}

std::vector<Setting> settings() {
  std::vector<Setting> all;
  const TouchConfig d;
  all.push_back({"default", "default", "default", d, true});
  const auto& sp = d.patches.superpixels;
  vary(all, "superpixel size", "size", sp.spacing_px, {4, 5, 8, 10, 14, 20},
       [](TouchConfig& c, int v) { c.patches.superpixels.spacing_px = v; });
  vary(all, "superpixel rounds", "rounds", sp.iterations, {1, 2, 8},
       [](TouchConfig& c, int v) { c.patches.superpixels.iterations = v; });
  vary(all, "draws of the support", "draws", d.graph.support_draws, {15, 40, 400},
       [](TouchConfig& c, int v) { c.graph.support_draws = v; });
  vary(all, "where joining ends", "stop", d.graph.stop, {0.25F, 0.35F, 0.55F, 0.7F},
       [](TouchConfig& c, float v) { c.graph.stop = v; });
  vary(all, "band of the outline", "band", d.outline.inside_px, {1, 2, 5, 8},
       [](TouchConfig& c, int v) { c.outline.inside_px = c.outline.outside_px = v; });
  return all;
}

}  // namespace

Study study_segmentation(std::ostream& progress, const SegmentationStudyOptions& options) {
  Study study;
  study.name = "accuracy.segmentation";
  const auto all = settings();
  progress << "warming up\n";  // else the first setting pays for cold pages and files
  static_cast<void>(bench_touches(progress, options.data, options.seed, all.front().config, true));
  for (const Setting& s : all) {
    progress << s.label << "\n";
    for (const TouchRow& r :
         bench_touches(progress, options.data, options.seed, s.config, true).rows) {
      StudyRow row;
      row.data = r.name();
      row.knob = s.knob, row.setting = s.setting, row.label = s.label;
      row.is_default = s.is_default;
      row.figures = {{"iou_error", 1 - r.iou_default, "1"},
                     {"iou_low_error", 1 - r.iou_low, "1"},
                     {"first_ms", r.first_ms, "ms"},
                     {"first_p95_ms", r.first_p95_ms, "ms"}};
      if (s.is_default) {
        study.plots.push_back({"accuracy_segmentation_" + row.data, "one touch, " + row.data,
                               row.data, "iou_error", "1 - mean IoU", "first_ms",
                               "CPU of an answer, ms"});
      }
      study.rows.push_back(std::move(row));
    }
  }
  return study;
}

}  // namespace teletact
