#include "tools/measure/accuracy/study.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <limits>
#include <numeric>
#include <stdexcept>

#include "tools/report/svg.hpp"

namespace teletact {

namespace {

struct Points {
  std::vector<const StudyRow*> rows;
  std::vector<double> cost, error;
};

Points points_of(const Study& study, const StudyPlot& plot) {
  Points p;
  for (const StudyRow& row : study.rows) {
    const double cost = row.figure(plot.cost), error = row.figure(plot.error);
    if (row.data != plot.data || !std::isfinite(cost) || !std::isfinite(error)) continue;
    p.rows.push_back(&row);
    p.cost.push_back(cost);
    p.error.push_back(error);
  }
  return p;
}

// Data sets in the order in which they first come.
std::vector<std::string> data_sets(const Study& study) {
  std::vector<std::string> all;
  for (const StudyRow& row : study.rows) {
    if (std::find(all.begin(), all.end(), row.data) == all.end()) all.push_back(row.data);
  }
  return all;
}

const StudyPlot* plot_of(const Study& study, const std::string& data) {
  const auto it = std::find_if(study.plots.begin(), study.plots.end(),
                               [&](const StudyPlot& p) { return p.data == data; });
  return it == study.plots.end() ? nullptr : &*it;
}

std::string cell(double v) {
  if (!std::isfinite(v)) return "-";
  char text[32];
  std::snprintf(text, sizeof text, std::abs(v) >= 100 ? "%.0f" : "%.3g", v);
  return text;
}

}  // namespace

double StudyRow::figure(const std::string& name) const {
  for (const BenchMetric& m : figures) {
    if (m.name == name) return m.value;
  }
  return std::numeric_limits<double>::quiet_NaN();
}

std::vector<std::size_t> pareto_front(std::span<const double> cost, std::span<const double> error) {
  std::vector<std::size_t> order(std::min(cost.size(), error.size()));
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::erase_if(order,
                [&](std::size_t i) { return !std::isfinite(cost[i]) || !std::isfinite(error[i]); });
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return cost[a] != cost[b] ? cost[a] < cost[b] : error[a] < error[b];
  });
  std::vector<std::size_t> front;
  for (const std::size_t i : order) {
    // Points that are equal in both beat neither one the other.
    const bool twin =
        !front.empty() && cost[front.back()] == cost[i] && error[front.back()] == error[i];
    if (front.empty() || error[i] < error[front.back()] || twin) front.push_back(i);
  }
  return front;
}

std::vector<BenchMetric> Study::metrics() const {
  std::vector<BenchMetric> all;
  for (const StudyRow& row : rows) {
    for (const BenchMetric& m : row.figures) {
      if (!std::isfinite(m.value)) continue;
      all.push_back({name + "." + row.data + "." + row.setting + "." + m.name, m.value, m.unit});
    }
  }
  return all;
}

void Study::print(std::ostream& out) const {
  for (const std::string& data : data_sets(*this)) {
    std::vector<std::string> head;  // figures that some row of the data set has
    for (const StudyRow& row : rows) {
      for (const BenchMetric& m : row.figures) {
        if (row.data != data || !std::isfinite(m.value)) continue;
        if (std::find(head.begin(), head.end(), m.name) == head.end()) head.push_back(m.name);
      }
    }
    std::vector<const StudyRow*> front;
    if (const StudyPlot* plot = plot_of(*this, data)) {
      const Points p = points_of(*this, *plot);
      for (const std::size_t i : pareto_front(p.cost, p.error)) front.push_back(p.rows[i]);
      out << "\n"
          << data << " (* default, + no setting has less " << plot->error << " for less "
          << plot->cost << ")\n";
    } else {
      out << "\n" << data << "\n";
    }
    std::vector<std::size_t> wide;
    out << "  " << std::string(24, ' ');
    for (const std::string& h : head) {
      wide.push_back(std::max<std::size_t>(h.size(), 7));
      out << "  " << std::string(wide.back() - h.size(), ' ') << h;
    }
    out << "\n";
    for (const StudyRow& row : rows) {
      if (row.data != data) continue;
      const bool on = std::find(front.begin(), front.end(), &row) != front.end();
      std::string label = row.label;
      label.resize(std::max<std::size_t>(label.size(), 24), ' ');
      out << (row.is_default ? '*' : ' ') << (on ? '+' : ' ') << label;
      for (std::size_t i = 0; i < head.size(); ++i) {
        const std::string text = cell(row.figure(head[i]));
        out << "  " << std::string(wide[i] - std::min(wide[i], text.size()), ' ') << text;
      }
      out << "\n";
    }
  }
}

std::string study_svg(const Study& study, const StudyPlot& plot) {
  const Points p = points_of(study, plot);
  plot::Figure figure;
  figure.title = plot.title;
  figure.x_label = plot.cost_label;
  figure.y_label = plot.error_label;
  figure.log_x = figure.log_y = true;
  figure.height_px = 420;
  plot::Series front{"Pareto front", {}, {}, "#999999", false, false};
  for (const std::size_t i : pareto_front(p.cost, p.error)) {
    front.x.push_back(p.cost[i]);
    front.y.push_back(p.error[i]);
  }
  figure.series.push_back(std::move(front));
  std::vector<std::string> knobs;
  for (std::size_t i = 0; i < p.rows.size(); ++i) {
    const StudyRow& row = *p.rows[i];
    figure.marks.push_back({p.cost[i], p.error[i], row.label, row.is_default});
    if (row.is_default) continue;
    auto it = std::find(knobs.begin(), knobs.end(), row.knob);
    if (it == knobs.end()) {
      knobs.push_back(row.knob);
      figure.series.push_back({row.knob, {}, {}, "", true, false});
      it = knobs.end() - 1;
    }
    plot::Series& s = figure.series[1 + static_cast<std::size_t>(it - knobs.begin())];
    s.x.push_back(p.cost[i]);
    s.y.push_back(p.error[i]);
  }
  return plot::line_plot(figure);
}

std::vector<std::string> Study::write_plots(const std::string& folder) const {
  std::error_code ec;
  std::filesystem::create_directories(folder, ec);
  if (ec) throw std::runtime_error(folder + ": cannot create: " + ec.message());
  std::vector<std::string> files;
  for (const StudyPlot& plot : plots) {
    const std::string path = folder + "/" + plot.file + ".svg";
    std::ofstream out(path, std::ios::binary);
    out << study_svg(*this, plot);
    if (!out.flush()) throw std::runtime_error(path + ": cannot write");
    files.push_back(path);
  }
  return files;
}

}  // namespace teletact
