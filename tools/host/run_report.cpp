// From the halves of a run to the report's data.
#include <algorithm>
#include <cmath>
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

// Over a cost map; of `robot` what is known until `end`.
ReportMap report_map(const perception::CostMap& c, const OperatorHalf& op, const RobotHalf& robot,
                     rt::Nanos until) {
  ReportMap map;
  const auto known = [until](rt::Time t, std::int64_t epoch_ns) {
    return rt::ns_of(t) - epoch_ns <= until.count();
  };
  if (c.seq != 0 && c.ground_found) {
    // The grid lies in W up to a turn about z in the scenes with a robot; its origin places it.
    // Only what was seen, with a margin.
    int x0 = c.width, y0 = c.height, x1 = 0, y1 = 0;
    for (int y = 0; y < c.height; ++y) {
      for (int x = 0; x < c.width; ++x) {
        if (c.cost[c.index(x, y)] == perception::CostMap::kUnknown) continue;
        x0 = std::min(x0, x);
        y0 = std::min(y0, y);
        x1 = std::max(x1, x);
        y1 = std::max(y1, y);
      }
    }
    constexpr int kMargin = 4;
    x0 = std::max(0, x0 - kMargin);
    y0 = std::max(0, y0 - kMargin);
    x1 = std::min(c.width - 1, x1 + kMargin);
    y1 = std::min(c.height - 1, y1 + kMargin);
    if (x1 > x0 && y1 > y0) {
      map.width = x1 - x0 + 1;
      map.height = y1 - y0 + 1;
      map.resolution_m = c.resolution;
      map.x0_m = c.X_WM.translation().x() + x0 * c.resolution;
      map.y0_m = c.X_WM.translation().y() + y0 * c.resolution;
      for (int y = y0; y <= y1; ++y) {
        for (int x = x0; x <= x1; ++x) map.cost.push_back(c.cost[c.index(x, y)]);
      }
      for (int i = 0; i < c.moving_count; ++i) {
        const auto& m = c.moving[static_cast<std::size_t>(i)];
        const int x = m.cell % c.width - x0, y = m.cell / c.width - y0;
        if (x < 0 || y < 0 || x >= map.width || y >= map.height) continue;
        map.moving.push_back({static_cast<std::size_t>(y) * static_cast<std::size_t>(map.width) +
                                  static_cast<std::size_t>(x),
                              1e-3 * m.age_ms});
      }
    }
  }
  const perception::Pose X_MW = c.X_WM.inverse();
  const auto to_map = [&](double x, double y) {
    // Into the grid's frame, shown with the grid's origin at its place in the world.
    const perception::Vec3 p = X_MW * perception::Vec3(x, y, 0);
    return std::pair{c.X_WM.translation().x() + p.x(), c.X_WM.translation().y() + p.y()};
  };
  for (const auto& path : op.view.paths) {
    if (!known(path.made, op.epoch_ns)) break;
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
  add_driven(map, robot, to_map, until);
  return map;
}

constexpr perception::Rgb kObjectColour{0x8e, 0x24, 0xaa};
constexpr perception::Rgb kMovingColour{123, 31, 162}, kBodyColour{120, 144, 156};

// Of a pixel of the view: its own colour, but that of an object's mark along its outline; tinted where something moves,
// or the robot's own body is, before what is shown.
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
  const perception::Pose X_VW = v.X_WV.inverse();
  const auto add = [&](plot::Overlay& o, const perception::Vec3& p_W) {
    const perception::Vec3 p = X_VW * p_W;
    if (p.z() < 0.05) return;
    const auto uv = v.intrinsics.project(p);
    if (uv.x() < 0 || uv.y() < 0 || uv.x() >= v.intrinsics.width || uv.y() >= v.intrinsics.height)
      return;
    o.x.push_back(uv.x());
    o.y.push_back(uv.y());
  };
  plot::Overlay proxy;
  proxy.label = "proxy while touching";
  proxy.colour = "#d81b60";
  for (std::size_t i = 0; i < op.view.haptic.size(); i += 20) {
    const auto& s = op.view.haptic[i];
    if (!s.in_contact) continue;
    add(proxy, perception::Vec3(static_cast<double>(s.p_WP[0]), static_cast<double>(s.p_WP[1]),
                                static_cast<double>(s.p_WP[2])));
  }
  proxy.kind = plot::Overlay::Kind::kDot;
  proxy.radius_px = 2;
  plot::Overlay marks, path, base, objects;
  marks.kind = plot::Overlay::Kind::kCross;
  marks.label = "mark";
  marks.colour = "#ff9800";
  path.kind = plot::Overlay::Kind::kPolyline;
  path.label = "path";
  path.colour = "#1e88e5";
  base.kind = plot::Overlay::Kind::kCircle;
  base.label = "robot";
  base.colour = "#43a047";
  objects.kind = plot::Overlay::Kind::kCircle;
  objects.label = "object";
  objects.colour = "#8e24aa";
  const auto& list = op.view.objects;
  for (std::int32_t i = 0; i < list.size; ++i) {
    const auto& e = list.entries[static_cast<std::size_t>(i)];
    if (e.summarised) add(objects, e.X_WO * e.centre_m);
  }
  for (const auto& p : op.view.paths) add(marks, p.marked_W);
  if (!op.view.paths.empty()) {
    const auto& p = op.view.paths.back();
    for (std::int32_t i = 0; i < p.size; ++i) {
      const auto& q = p.points[static_cast<std::size_t>(i)];
      add(path, perception::Vec3(q[0], q[1], 0));
    }
  }
  const auto& O = op.view.world.X_WO;
  const auto X_WB = perception::compose(
      {O[0], O[1], O[2]}, {op.view.robot.x_m, op.view.robot.y_m, op.view.robot.yaw_rad});
  add(base, perception::Vec3(X_WB.x, X_WB.y, 0));
  for (auto* o : {&proxy, &path, &objects, &marks, &base}) {
    if (!o->x.empty()) picture.overlays.push_back(*o);
  }
  char text[160];
  std::snprintf(text, sizeof text, "Eye at (%.2f, %.2f, %.2f) m in W; %zu blocks in the map.",
                v.X_WV.translation().x(), v.X_WV.translation().y(), v.X_WV.translation().z(),
                op.view.fusion.empty() ? std::size_t{0}
                                       : static_cast<std::size_t>(op.view.fusion.back().blocks));
  picture.caption = text;
  return picture;
}

// What libraries took from the heap within the steps; where the program counts.
void add_allocations(const ReportData& d, std::vector<ReportVerdict>& verdicts) {
  std::string firm;
  double hard = -1;
  char text[100];
  for (const ReportTask& t : d.tasks) {
    if (t.allocations_max < 0) continue;
    if (t.task_class == "hard") {
      hard = std::max(hard, t.allocations_max);
      continue;
    }
    std::snprintf(text, sizeof text, "%s %.0f a job, at most %.0f; ", t.name.c_str(),
                  t.allocations_p50, t.allocations_max);
    firm += text;
  }
  if (firm.empty() && hard < 0) return;
  std::snprintf(text, sizeof text, "hard tasks %s", hard > 0 ? "ALLOCATE" : "none");
  verdicts.push_back({hard > 0 ? ReportVerdict::State::kBad : ReportVerdict::State::kGood,
                      "allocations by libraries: " + firm + text});
}

// Each place that the hand chose, and what came of it.
void add_visits(const OperatorHalf& op, ReportData& d) {
  using State = ReportVerdict::State;
  const TouchedPlaces touched = touched_of(op);
  for (std::size_t i = 0; i < op.view.visits.size(); ++i) {
    const Touched& t = touched.visits[i];
    char text[80];
    std::snprintf(text, sizeof text, ": %.2f s in contact, largest force %.2f N", t.contact_s,
                  t.force_max_N);
    const Visit& v = op.view.visits[i];
    d.verdicts.push_back(
        {t.met() ? State::kGood : State::kNote, "touch" + text_of(v) +
                                                    (t.met()     ? std::string(text)
                                                     : v.pressed ? std::string(": nothing met")
                                                                 : std::string())});
  }
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

void add_verdicts(const RunInfo& info, const OperatorHalf& op, const RobotHalf& robot,
                  const Metrics& m, ReportData& d) {
  using State = ReportVerdict::State;
  for (const auto& p : info.problems) d.verdicts.push_back({State::kBad, p});
  if (!info.not_real_time.empty()) d.verdicts.push_back({State::kNote, info.not_real_time});
  for (const auto& n : info.notes) d.verdicts.push_back({State::kNote, n});
  if (!info.stopped_early.empty()) d.verdicts.push_back({State::kNote, info.stopped_early});
  const auto value = [&](const std::string& name) {
    for (const auto& r : m.rows()) {
      if (r.name == name) return r.value;
    }
    return 0.0;
  };
  char text[240];
  std::snprintf(
      text, sizeof text,
      "haptic: %.0f releases = %.0f completed + %.0f skipped + %.0f aborted; misses %.0f, own %.0f",
      value("haptic.releases"), value("haptic.completed"), value("haptic.skipped"),
      value("haptic.aborted"), value("haptic.miss_total"), value("haptic.miss_own"));
  const std::string untimed = not_measured(info, op, robot, m);
  d.verdicts.push_back({value("haptic.miss_own") == 0 ? State::kGood
                        : untimed.empty()             ? State::kBad
                                                      : State::kNote,
                        text});
  std::snprintf(text, sizeof text,
                "touch: %.0f contacts, largest force %.2f N, share of time in contact %.2f",
                value("haptic.contacts"), value("haptic.force_max_N"),
                value("haptic.contact_share"));
  d.verdicts.push_back({value("haptic.contacts") > 0 ? State::kGood : State::kNote,
                        text + (info.touch_method.empty() ? "" : "; method " + info.touch_method)});
  add_visits(op, d);
  std::snprintf(text, sizeof text, "fusion: %.0f of %.0f frames tracked",
                value("fusion.frames_tracked"), value("fusion.frames"));
  d.verdicts.push_back(
      {value("fusion.frames_tracked") == value("fusion.frames") ? State::kGood : State::kNote,
       text});
  if (op.view.objects.seq != 0) {
    const auto& list = op.view.objects;
    std::snprintf(text, sizeof text, "objects: %u named, %d held; answer to the newest mark: %s",
                  op.view.objects_named, list.size,
                  std::string(perception::text_of(list.answer)).c_str());
    d.verdicts.push_back({State::kNote, text});
    for (std::int32_t i = 0; i < list.size; ++i) {
      const auto& e = list.entries[static_cast<std::size_t>(i)];
      const perception::Vec3 c = e.X_WO * e.centre_m;
      std::snprintf(text, sizeof text,
                    "object %u: centre (%.3f, %.3f, %.3f) m, extent %.0f x %.0f x %.0f mm, colour "
                    "%u %u %u%s",
                    e.serial, c.x(), c.y(), c.z(), 1e3 * e.extent_m.x(), 1e3 * e.extent_m.y(),
                    1e3 * e.extent_m.z(), e.colour.r, e.colour.g, e.colour.b,
                    e.seen ? "" : ", not in view");
      d.verdicts.push_back({State::kNote, text});
    }
  }
  std::snprintf(text, sizeof text,
                "robot: %.0f marks, %.0f paths, %.2f m driven, goal error %.3f m, %.0f collisions",
                value("mark.count"), value("plan.paths"), value("robot.path_m"),
                value("robot.goal_error_m"), value("robot.collisions"));
  d.verdicts.push_back({value("robot.collisions") == 0 ? State::kGood : State::kBad, text});
  if (op.view.held_s > 0) {
    std::snprintf(text, sizeof text, "the robot was held for %.1f s with a mark to drive to: %s",
                  op.view.held_s,
                  held_text(op.view.held, op.view.held_ms, op.view.held_limit_ms).c_str());
    d.verdicts.push_back({State::kNote, text});
  }
  if (op.view.world.follows_camera) {
    std::snprintf(text, sizeof text,
                  "place of the robot: stated to %.0f mm at the worst, %.1f s stood for it",
                  1e3 * op.view.error_max_m, op.view.unsure_s);
    d.verdicts.push_back({op.view.unsure_s > 0 ? State::kNote : State::kGood, text});
  }
  add_allocations(d, d.verdicts);
  if (!info.virtual_clock) {
    std::snprintf(text, sizeof text,
                  "machine: %.2f %% of the haptic starts were late by the platform",
                  100 * value("platform.late_share"));
    d.verdicts.push_back(
        {untimed.empty() ? State::kGood : State::kNote,
         text + (untimed.empty() ? "" : "; timing NOT MEASURED in this run: " + untimed)});
    const State beyond = beyond_admission(info, op, robot).empty() ? State::kNote : State::kBad;
    for (const auto& o : ordinary_shares(info, op, robot)) {
      const bool within = o.share <= o.declared;
      std::snprintf(text, sizeof text, "ordinary thread %s: %.3f of a core, declared %.3f%s",
                    o.name.c_str(), o.share, o.declared,
                    within                   ? ""
                    : beyond == State::kNote ? "; the admitted cores can spare it"
                                             : "");
      d.verdicts.push_back({within ? State::kGood : beyond, text});
    }
    for (const auto* log : {&op.log, &robot.log}) {
      for (const auto& what : log->not_realtime)
        d.verdicts.push_back({State::kNote, "NOT REAL-TIME: " + what});
    }
    if (!info.give_rights.empty())
      d.verdicts.push_back({State::kNote, "to be real-time: " + info.give_rights});
  }
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
