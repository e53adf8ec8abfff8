// Accuracy against cost. A study runs a method over data at named settings of its parameters and
// keeps figures of error and cost for each. The same rows become a table, metrics and plots.
//
//   row      one setting on one data set: "room", "voxel_20mm", its figures
//   default  the setting that the product runs with; marked in table and plot
//   front    the settings that no other beats in both error and cost (Pareto)
#pragma once

#include <cstddef>
#include <ostream>
#include <span>
#include <string>
#include <vector>

#include "tools/files/bench_metric.hpp"

namespace teletact {

struct StudyRow {
  std::string data, knob,
      setting;        // of a-z, 0-9, _: part of metric names; knob: the one that differs
  std::string label;  // what a reader calls the setting
  bool is_default = false;
  std::vector<BenchMetric> figures;  // short names: "ate_mm"; NaN: not measured

  [[nodiscard]] double figure(const std::string& name) const;  // NaN: none of that name
};

struct StudyPlot {
  std::string file;  // name without ending
  std::string title, data;
  std::string error, error_label;  // figure on the y axis
  std::string cost, cost_label;    // on the x axis
};

struct Study {
  std::string name;  // first word of its metrics
  std::vector<StudyRow> rows;
  std::vector<StudyPlot> plots;

  // name.data.setting.figure; figures that were not measured are left out.
  [[nodiscard]] std::vector<BenchMetric> metrics() const;
  // A block a data set; the default is marked with *, settings on the front of its first plot with
  // +.
  void print(std::ostream& out) const;
  // Throws std::runtime_error when a folder or file can not be written. Returns the files.
  std::vector<std::string> write_plots(const std::string& folder) const;
};

[[nodiscard]] std::string study_svg(const Study& study, const StudyPlot& plot);

// Indices of the points that no other one beats: none is at most as large in both and smaller in
// one. By rising cost. Points that are not finite are on no front.
[[nodiscard]] std::vector<std::size_t> pareto_front(std::span<const double> cost,
                                                    std::span<const double> error);

}  // namespace teletact
