// From the halves of a run to the report's data.
#include <algorithm>
#include <cstdio>

#include "perception/motion/motion_mask.hpp"
#include "tasks/contract/table.hpp"
#include "tools/files/build_info.hpp"
#include "tools/host/run_results.hpp"
#include "tools/host/task_times.hpp"

namespace teletact {

namespace {

// The robot's way by its odometry and in truth, until then; `to_map` takes it into the map's frame.
template <class ToMap>
void add_driven(ReportMap& map, const RobotHalf& robot, const ToMap& to_map, rt::Nanos until) {
  // False: not known until then, nor is what comes after it.
  const auto add = [&](ReportMap::Line& line, rt::Time stamp, double x_m, double y_m) {
    if (rt::ns_of(stamp) - robot.epoch_ns > until.count()) return false;
    const auto [x, y] = to_map(x_m, y_m);
    line.x_m.push_back(x);
    line.y_m.push_back(y);
    return true;
  };
  const auto add_odometry = [&](const tasks::RobotSample& s) {
    return add(map.driven, s.stamp, static_cast<double>(s.x_m), static_cast<double>(s.y_m));
  };
  const auto add_truth = [&](const TruthSample& t) {
    return add(map.truth, t.stamp, t.x_m, t.y_m);
  };
  for (const auto& s : robot.view.robot_past.kept) (void)add_odometry(s);
  for (std::size_t i = 0; i < robot.view.robot.size(); i += 5) {
    if (!add_odometry(robot.view.robot[i])) break;
  }
  map.driven.label = "odometry";
  map.truth.label = "true path";
  for (const auto& t : robot.view.truth_past.kept) (void)add_truth(t);
  for (const auto& t : robot.view.truth) {
    if (!add_truth(t)) break;
  }
}

struct CellRange {
  int x0 = 0, y0 = 0, x1 = 0, y1 = 0;  // the last ones are of it
};
// What of the map was seen, with a margin.
CellRange seen_cells(const perception::CostMap& c) {
  constexpr int kMargin = 4;
  CellRange r{c.width, c.height, 0, 0};
  for (int y = 0; y < c.height; ++y) {
    for (int x = 0; x < c.width; ++x) {
      if (c.cost[c.index(x, y)] == perception::CostMap::kUnknown) continue;
      r = {std::min(r.x0, x), std::min(r.y0, y), std::max(r.x1, x), std::max(r.y1, y)};
    }
  }
  return {std::max(0, r.x0 - kMargin), std::max(0, r.y0 - kMargin),
          std::min(c.width - 1, r.x1 + kMargin), std::min(c.height - 1, r.y1 + kMargin)};
}

// The grid lies in W up to a turn about z in the scenes with a robot; its origin places it.
void add_grid(const perception::CostMap& c, ReportMap& map) {
  if (c.seq == 0 || !c.ground_found) return;
  const CellRange r = seen_cells(c);
  if (r.x1 <= r.x0 || r.y1 <= r.y0) return;
  map.width = r.x1 - r.x0 + 1;
  map.height = r.y1 - r.y0 + 1;
  map.resolution_m = c.resolution;
  map.x0_m = c.X_WM.translation().x() + r.x0 * c.resolution;
  map.y0_m = c.X_WM.translation().y() + r.y0 * c.resolution;
  for (int y = r.y0; y <= r.y1; ++y) {
    for (int x = r.x0; x <= r.x1; ++x) map.cost.push_back(c.cost[c.index(x, y)]);
  }
  for (int i = 0; i < c.moving_count; ++i) {
    const auto& m = c.moving[static_cast<std::size_t>(i)];
    const int x = m.cell % c.width - r.x0, y = m.cell / c.width - r.y0;
    if (x < 0 || y < 0 || x >= map.width || y >= map.height) continue;
    map.moving.push_back({static_cast<std::size_t>(y) * static_cast<std::size_t>(map.width) +
                              static_cast<std::size_t>(x),
                          1e-3 * m.age_ms});
  }
}

template <class ToMap>
void add_planned(ReportMap& map, const OperatorHalf& op, const ToMap& to_map, rt::Nanos until) {
  for (const auto& path : op.view.paths) {
    if (rt::ns_of(path.made) - op.epoch_ns > until.count()) break;
    auto& line = map.planned.emplace_back();
    line.label = "path " + std::to_string(path.seq);
    for (std::int32_t i = 0; i < path.size; ++i) {
      const auto& p = path.points[static_cast<std::size_t>(i)];
      const auto [x, y] = to_map(p[0], p[1]);
      line.x_m.push_back(x);
      line.y_m.push_back(y);
    }
    const auto [mx, my] = to_map(path.marked_W.x(), path.marked_W.y());
    map.mark_x_m.push_back(mx);
    map.mark_y_m.push_back(my);
    if (!line.x_m.empty()) {
      map.goal_x_m.push_back(line.x_m.back());
      map.goal_y_m.push_back(line.y_m.back());
    }
  }
}

// Over a cost map; of `robot` what is known until `until`.
ReportMap report_map(const perception::CostMap& c, const OperatorHalf& op, const RobotHalf& robot,
                     rt::Nanos until) {
  ReportMap map;
  add_grid(c, map);
  const perception::Pose X_MW = c.X_WM.inverse();
  const auto to_map = [&](double x, double y) {
    // Into the grid's frame, shown with the grid's origin at its place in the world.
    const perception::Vec3 p = X_MW * perception::Vec3(x, y, 0);
    return std::pair{c.X_WM.translation().x() + p.x(), c.X_WM.translation().y() + p.y()};
  };
  add_planned(map, op, to_map, until);
  add_driven(map, robot, to_map, until);
  return map;
}

constexpr perception::Rgb kObjectColour{0x8e, 0x24, 0xaa};
constexpr perception::Rgb kMovingColour{123, 31, 162}, kBodyColour{120, 144, 156};

// Of a pixel of the view: its own colour, but that of an object's mark along its outline; tinted
// where something moves, or the robot's own body is, before what is shown.
perception::Rgb pixel_colour(const tasks::SceneView& v, std::size_t i) {
  const auto width = static_cast<std::size_t>(v.intrinsics.width);
  const auto pixels = width * static_cast<std::size_t>(v.intrinsics.height);
  const std::uint8_t id = v.object[i];
  const bool rim = id != 0 && ((i % width > 0 && v.object[i - 1] != id) ||
                               (i % width + 1 < width && v.object[i + 1] != id) ||
                               (i >= width && v.object[i - width] != id) ||
                               (i + width < pixels && v.object[i + width] != id));
  if (rim) return kObjectColour;
  const auto tinted = [&](const perception::Rgb& by) {
    const perception::Rgb& c = v.colour[i];
    const auto mix = [](int a, int b) { return static_cast<std::uint8_t>((2 * a + 3 * b) / 5); };
    return perception::Rgb{mix(c.r, by.r), mix(c.g, by.g), mix(c.b, by.b)};
  };
  if (v.masked && v.what[i] == static_cast<std::uint8_t>(perception::PixelOf::kMoving))
    return tinted(kMovingColour);
  if (v.masked && v.what[i] == static_cast<std::uint8_t>(perception::PixelOf::kBody))
    return tinted(kBodyColour);
  return v.colour[i];
}

plot::Overlay overlay(plot::Overlay::Kind kind, const char* label, const char* colour) {
  plot::Overlay o;
  o.kind = kind;
  o.label = label;
  o.colour = colour;
  return o;
}

// What lies over a view: points of W where the camera saw them.
class ViewOverlays {
 public:
  ViewOverlays(const tasks::SceneView& v, const OperatorView& seen) : v_(v), seen_(seen) {}
  [[nodiscard]] std::vector<plot::Overlay> all() const {
    std::vector<plot::Overlay> out{touched(), path(), objects(), marks(), base()};
    std::erase_if(out, [](const plot::Overlay& o) { return o.x.empty(); });
    return out;
  }

 private:
  using Kind = plot::Overlay::Kind;
  void add(plot::Overlay& o, const perception::Vec3& p_W) const {
    constexpr double kNearest_m = 0.05;
    const perception::Vec3 p = X_VW_ * p_W;
    if (p.z() < kNearest_m) return;
    const auto uv = v_.intrinsics.project(p);
    if (uv.x() < 0 || uv.y() < 0 || uv.x() >= v_.intrinsics.width || uv.y() >= v_.intrinsics.height)
      return;
    o.x.push_back(uv.x());
    o.y.push_back(uv.y());
  }
  [[nodiscard]] plot::Overlay touched() const {
    auto o = overlay(Kind::kDot, "proxy while touching", "#d81b60");
    o.radius_px = 2;
    for (std::size_t i = 0; i < seen_.haptic.size(); i += 20) {
      const auto& s = seen_.haptic[i];
      if (!s.in_contact) continue;
      add(o, perception::Vec3(static_cast<double>(s.p_WP[0]), static_cast<double>(s.p_WP[1]),
                              static_cast<double>(s.p_WP[2])));
    }
    return o;
  }
  [[nodiscard]] plot::Overlay path() const {
    auto o = overlay(Kind::kPolyline, "path", "#1e88e5");
    if (seen_.paths.empty()) return o;
    const auto& p = seen_.paths.back();
    for (std::int32_t i = 0; i < p.size; ++i) {
      const auto& q = p.points[static_cast<std::size_t>(i)];
      add(o, perception::Vec3(q[0], q[1], 0));
    }
    return o;
  }
  [[nodiscard]] plot::Overlay objects() const {
    auto o = overlay(Kind::kCircle, "object", "#8e24aa");
    for (std::int32_t i = 0; i < seen_.objects.size; ++i) {
      const auto& e = seen_.objects.entries[static_cast<std::size_t>(i)];
      if (e.summarised) add(o, e.X_WO * e.centre_m);
    }
    return o;
  }
  [[nodiscard]] plot::Overlay marks() const {
    auto o = overlay(Kind::kCross, "mark", "#ff9800");
    for (const auto& p : seen_.paths) add(o, p.marked_W);
    return o;
  }
  [[nodiscard]] plot::Overlay base() const {
    auto o = overlay(Kind::kCircle, "robot", "#43a047");
    const auto& O = seen_.world.X_WO;
    const auto X_WB = perception::compose({O[0], O[1], O[2]},
                                          {seen_.robot.x_m, seen_.robot.y_m, seen_.robot.yaw_rad});
    add(o, perception::Vec3(X_WB.x, X_WB.y, 0));
    return o;
  }
  const tasks::SceneView& v_;
  const OperatorView& seen_;
  perception::Pose X_VW_ = v_.X_WV.inverse();
};

ReportPicture report_picture(const OperatorHalf& op, const tasks::SceneView& v,
                             const std::string& title) {
  ReportPicture picture;
  picture.title = title;
  picture.image.width = v.intrinsics.width;
  picture.image.height = v.intrinsics.height;
  const auto pixels =
      static_cast<std::size_t>(v.intrinsics.width) * static_cast<std::size_t>(v.intrinsics.height);
  for (std::size_t i = 0; i < pixels; ++i) {
    const perception::Rgb c = pixel_colour(v, i);
    picture.image.pixels.insert(picture.image.pixels.end(), {c.r, c.g, c.b});
  }
  picture.overlays = ViewOverlays(v, op.view).all();
  char text[160];
  std::snprintf(text, sizeof text, "Eye at (%.2f, %.2f, %.2f) m in W; %zu blocks in the map.",
                v.X_WV.translation().x(), v.X_WV.translation().y(), v.X_WV.translation().z(),
                op.view.fusion.empty() ? std::size_t{0}
                                       : static_cast<std::size_t>(op.view.fusion.back().blocks));
  picture.caption = text;
  return picture;
}

void add_told(const OperatorHalf& op, const RobotHalf& robot, ReportData& d) {
  for (const auto* log : {&op.log, &robot.log}) {
    for (const auto& told : log->told)
      d.verdicts.push_back({ReportVerdict::State::kNote, "job records: " + told});
  }
}

// Of a long run every n-th of the older ticks.
ReportSeries touch_series(const OperatorHalf& op) {
  ReportSeries out;
  for (const auto* samples : {&op.view.haptic_thin.kept, &op.view.haptic}) {
    for (const auto& s : *samples) {
      out.t_s.push_back(static_cast<double>(rt::ns_of(s.stamp) - op.epoch_ns) * 1e-9);
      out.force_N.push_back(static_cast<double>(s.force_N));
      out.penetration_mm.push_back(1e3 * static_cast<double>(s.penetration_m));
    }
  }
  return out;
}

}  // namespace

ReportData make_report(const RunInfo& info, const OperatorHalf& op, const RobotHalf& robot,
                       const Metrics& metrics) {
  ReportData d;
  d.title = info.paced           ? "teletact demo, not real-time"
            : info.virtual_clock ? "teletact demo, virtual clock"
                                 : "teletact demo";
  d.version = kVersion;
  d.command = info.command;
  d.started = info.started;
  d.host = info.host;
  d.seeds = info.seeds;
  d.config_toml = info.config_toml;
  d.calibration = info.calibration_text;
  d.admission = info.admission.tasks.empty()
                    ? ""
                    : rt::report_table(info.admission) + rt::mode_report(info.modes);
  d.choices = info.admission.choices;
  d.steps = info.admission.steps;
  for (std::size_t m = 0; m < info.modes.modes.size(); ++m) {
    const auto& v = info.modes.verdict(m, m);
    d.modes.push_back({info.modes.modes[m].name, v.refusal, v.utilisation,
                       static_cast<double>(v.slack.count()) * 1e-6});
  }
  d.effects = info.effects;
  d.files = info.files;
  d.metrics = metrics;
  for (const auto& t : op.log.tasks)
    d.tasks.push_back(report_task(op.log, t, op.totals, info.virtual_clock));
  for (const auto& t : robot.log.tasks)
    d.tasks.push_back(report_task(robot.log, t, robot.totals, info.virtual_clock));
  d.touch = touch_series(op);
  d.map = report_map(*op.view.map, op, robot, rt::Nanos::max());
  if (const auto& m = *op.view.moving_map; m.moving_count > 0) {
    const rt::Nanos at{rt::ns_of(m.fused) - op.epoch_ns};
    d.moving_map = report_map(m, op, robot, at);
    d.moving_map_at_s = 1e-9 * static_cast<double>(at.count());
  }
  if (op.view.view->seq != 0)
    d.pictures.push_back(report_picture(op, *op.view.view,
                                        "The fused scene, as the camera's eye sees it at the end"));
  if (const auto& v = *op.view.moving_view; v.seq != 0) {
    char title[100];
    std::snprintf(title, sizeof title, "What moves (tinted) before the fused scene, at %.1f s",
                  1e-9 * static_cast<double>(rt::ns_of(v.fused) - op.epoch_ns));
    d.pictures.push_back(report_picture(op, v, title));
  }
  for (auto& t : d.tasks) {
    for (const auto& a : info.admission.tasks) {
      if (a.name != t.name) continue;
      t.analysis_response_us = static_cast<double>(a.R.count()) * 1e-3;
      if (!a.choice.empty()) t.level = a.choice + ", " + t.level;
    }
  }
  add_verdicts(info, op, robot, metrics, d);
  add_told(op, robot, d);
  return d;
}

}  // namespace teletact
