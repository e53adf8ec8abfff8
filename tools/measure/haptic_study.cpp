#include "tools/measure/haptic_study.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <functional>
#include <memory>
#include <numbers>

#include "rt/clock/box_time.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/quantile.hpp"
#include "tasks/haptic/haptic_task.hpp"
#include "tools/report/svg.hpp"
#include "tools/touch/field_window.hpp"
#include "tools/touch/view_cast.hpp"

namespace teletact {

using perception::Pose;
using perception::Vec3;

namespace {

constexpr double kStiffness = 1000, kLimit_N = 12, kSpeed = 0.1;

struct StudyScene {
  const char* name;
  double (*solid)(const Vec3& p);  // frame S
  Vec3 (*right)(
      const Vec3& h);  // where the proxy belongs for a hand on the path; h itself: no contact
  std::vector<Vec3> path;
  Vec3 eye;  // for the published method
};

struct StudyKnobs {
  std::string method = "constrained";
  int iterations = 0;
  double voxel_m = 0.01, rate_hz = 1000;
};

struct StudyTick {
  double t;
  Vec3 h, p, f, sent;  // S; f before the slew guard, sent behind it
  bool contact;
};

double corner_solid(const Vec3& p) {
  const double a = -p.x(), b = p.z();
  return a >= 0 || b >= 0 ? std::min(a, b) : -std::hypot(a, b);
}
Vec3 corner_right(const Vec3& h) { return {std::min(h.x(), 0.0), h.y(), std::max(h.z(), 0.0)}; }

double edge_solid(const Vec3& p) {
  return p.x() <= 0 || p.z() <= 0 ? std::max(p.x(), p.z()) : std::hypot(p.x(), p.z());
}
// The hand came from above: the top bears it until it is beyond the edge.
Vec3 edge_right(const Vec3& h) { return h.x() < 0 && h.z() < 0 ? Vec3(h.x(), h.y(), 0) : h; }

constexpr double kBall_m = 0.06;
double ball_solid(const Vec3& p) { return p.norm() - kBall_m; }
Vec3 ball_right(const Vec3& h) { return h.norm() < kBall_m ? Vec3(kBall_m * h.normalized()) : h; }

std::vector<StudyScene> scenes() {
  std::vector<Vec3> over_ball;
  for (int i = 0; i <= 60; ++i) {
    const double a = (-50 + 100.0 * i / 60) * std::numbers::pi / 180;
    const double r = kBall_m - (i == 0 || i == 60 ? -0.01 : 0.008);
    over_ball.push_back(
        {r * std::sin(a), 0.2 * r * std::cos(a), std::sqrt(0.96) * r * std::cos(a)});
  }
  return {{"corner",
           corner_solid,
           corner_right,
           {{-0.04, 0, 0.01}, {-0.04, 0, -0.008}, {0.008, 0, -0.008}, {0.008, 0, 0.04}},
           Vec3(-0.7, 0.1, 0.7)},
          {"edge",
           edge_solid,
           edge_right,
           {{-0.04, 0, 0.01}, {-0.04, 0, -0.008}, {0.02, 0, -0.008}},
           Vec3(0.3, 0.1, 0.9)},
          {"ball", ball_solid, ball_right, over_ball, Vec3(0, 0.2, 0.96)}};
}

// The solid sampled over a cube of 0.32 m; G is the grid's frame, X_GS where the solid stands in
// it.
struct Sampled {
  Pose X_GS = Pose::Identity();
  DenseField field;
  double voxel_m, truncation_m;
  Sampled(const StudyScene& scene, double voxel) : voxel_m(voxel) {
    truncation_m = std::max(0.05, 2.1 * voxel);
    X_GS.linear() = Eigen::AngleAxisd(17 * std::numbers::pi / 180, Vec3(1, 2, 3).normalized())
                        .toRotationMatrix();
    X_GS.translation() = Vec3(0.1637, 0.1621, 0.165);
    const int n = static_cast<int>(std::lround(0.32 / voxel)) + 1;
    field.size = {n, n, n};
    field.distance.reserve(static_cast<std::size_t>(n) * static_cast<std::size_t>(n) *
                           static_cast<std::size_t>(n));
    const Pose X_SG = X_GS.inverse();
    for (int x = 0; x < n; ++x) {
      for (int y = 0; y < n; ++y) {
        for (int z = 0; z < n; ++z) {
          field.distance.push_back(static_cast<float>(scene.solid(X_SG * (voxel * Vec3(x, y, z)))));
        }
      }
    }
  }
};

Vec3 along(const std::vector<Vec3>& path, double s) {
  for (std::size_t i = 1; i < path.size(); ++i) {
    const double length = (path[i] - path[i - 1]).norm();
    if (s <= length) return path[i - 1] + (s / length) * (path[i] - path[i - 1]);
    s -= length;
  }
  return path.back();
}

double length_of(const std::vector<Vec3>& path) {
  double s = 0;
  for (std::size_t i = 1; i < path.size(); ++i) s += (path[i] - path[i - 1]).norm();
  return s;
}

struct StudyRun {
  std::vector<StudyTick> ticks;
  std::vector<double> cpu_us;  // in contact
};

StudyRun run_scene(const StudyScene& scene, const StudyKnobs& knobs) {
  const Sampled sampled(scene, knobs.voxel_m);
  rt::Startup startup;
  tasks::HapticConfig config;
  config.method = knobs.method;
  config.credit_N_s_per_m = 2;
  config.iterations_max =
      knobs.iterations;  // the guard is on: the force before it is recorded beside
  drivers::DeviceProperties device;
  device.damping_N_s_per_m = 1e12;
  tasks::HapticTask task(startup.token(), config, device, 1 / knobs.rate_hz);
  tasks::SurfacePoints surface;
  if (knobs.method == "force_shading") {
    View view;
    view.eye = sampled.X_GS * scene.eye;
    view.look = sampled.X_GS * Vec3::Zero();
    (void)cast_view(sampled.field, sampled.voxel_m, view, surface);
  }
  std::array<std::unique_ptr<perception::SurfacePatch>, 8> windows;
  for (auto& w : windows) w = std::make_unique<perception::SurfacePatch>();
  std::size_t window = 0;
  std::uint64_t published = 0;
  tasks::HapticTask::In in;
  tasks::HapticTask::Out out;
  in.mode.seq = 1;
  in.mode.mode = tasks::Mode::kHold;
  in.stylus_ok = true;
  in.stylus.state = drivers::DeviceState::kForce;
  StudyRun run;
  const auto n = static_cast<std::int64_t>(length_of(scene.path) / kSpeed * knobs.rate_hz);
  for (std::int64_t k = 0; k < n; ++k) {
    const double t = static_cast<double>(k) / knobs.rate_hz;
    const Vec3 h = along(scene.path, kSpeed * t), h_G = sampled.X_GS * h;
    const rt::Time now = rt::time_from_ns(0) + rt::nanos_from_seconds(t);
    if (std::floor(t * 30 + 1e-9) >= static_cast<double>(published)) {
      window = (window + 1) % windows.size();
      windows[window]->seq = ++published;
      windows[window]->fused = windows[window]->exposure = now;
      fill_window(sampled.field, h_G, sampled.voxel_m, sampled.truncation_m, 24, *windows[window]);
    }
    in.patch_newest = task.wants_patch() ? windows[window].get() : nullptr;
    in.surface = k == 0 && surface.count > 0 ? &surface : nullptr;
    in.stylus.p_DH = h_G;
    rt::Tick tick;
    tick.k = static_cast<std::uint64_t>(k);
    tick.release = tick.start = now;
    tick.period = rt::nanos_from_seconds(1 / knobs.rate_hz);
    const std::int64_t before = rt::thread_cpu_ns();
    (void)task.step(tick, in, out);
    const double us = 1e-3 * static_cast<double>(rt::thread_cpu_ns() - before);
    const bool contact = out.telemetry.in_contact;
    if (contact) run.cpu_us.push_back(us);
    run.ticks.push_back({t, h, sampled.X_GS.inverse() * out.state.p_WP,
                         sampled.X_GS.linear().transpose() * out.telemetry.f_raw_D,
                         sampled.X_GS.linear().transpose() * out.force.f_H_D, contact});
  }
  return run;
}

std::vector<BenchMetric> judge(const StudyScene& scene, const StudyRun& run) {
  std::vector<double> force, sent, place;
  double jump = 0, sent_jump = 0;
  for (std::size_t i = 0; i < run.ticks.size(); ++i) {
    const StudyTick& tick = run.ticks[i];
    const Vec3 p = scene.right(tick.h);
    Vec3 f = kStiffness * (p - tick.h);
    if (f.norm() > kLimit_N) f *= kLimit_N / f.norm();
    if (tick.contact || f.norm() > 0) {
      force.push_back((tick.f - f).norm());
      sent.push_back((tick.sent - f).norm());
      place.push_back(1e3 * (tick.p - p).norm());
    }
    if (i > 0) {
      const double own = kStiffness * (tick.h - run.ticks[i - 1].h).norm();
      jump = std::max(jump, (tick.f - run.ticks[i - 1].f).norm() - own);
      sent_jump = std::max(sent_jump, (tick.sent - run.ticks[i - 1].sent).norm() - own);
    }
  }
  return {{"force_error_p95_N", rt::quantile_or_nan(force, 0.95), "N"},
          {"proxy_error_p95_mm", rt::quantile_or_nan(place, 0.95), "mm"},
          {"jump_N", std::max(jump, 1e-4), "N"},
          {"guarded_error_p95_N", rt::quantile_or_nan(sent, 0.95), "N"},
          {"guarded_jump_N", std::max(sent_jump, 1e-4), "N"},
          {"cpu_us", rt::quantile_or_nan(run.cpu_us, 0.5), "us"},
          {"cpu_p99_us", rt::quantile_or_nan(run.cpu_us, 0.99), "us"}};
}

struct StudySetting {
  std::string knob, setting, label;
  StudyKnobs knobs;
  bool is_default = false;
};

std::vector<StudySetting> settings() {
  std::vector<StudySetting> all;
  const auto add = [&](const char* knob, std::string setting, std::string label,
                       const StudyKnobs& k, bool usual = false) {
    all.push_back({knob, std::move(setting), std::move(label), k, usual});
  };
  add("default", "default", "constrained, 10 mm, 1 kHz", {}, true);
  for (const char* method : {"nearest", "nearest10", "force_shading"}) {
    StudyKnobs k;
    k.method = method;
    add("method", method, method, k);
  }
  for (const int n : {2, 5, 10, 30, 60}) {
    StudyKnobs k;
    k.iterations = n;
    add("iterations", "iterations_" + std::to_string(n), std::to_string(n) + " iterations", k);
  }
  for (const int mm : {5, 20}) {
    for (const char* method : {"constrained", "nearest10"}) {
      StudyKnobs k;
      k.method = method;
      k.voxel_m = 1e-3 * mm;
      const std::string size = std::to_string(mm) + "mm";
      add("voxel", std::string(method) + "_" + size, std::string(method) + ", " + size, k);
    }
  }
  for (const int rate : {2000, 4000}) {
    StudyKnobs k;
    k.rate_hz = rate;
    const std::string hz = std::to_string(rate);
    add("rate", "rate_" + hz, hz + " Hz", k);
  }
  // Every method with every number of steps it can take, every voxel size, every rate.
  struct Method {
    const char* name;
    std::vector<int> iterations;  // 0: its own
  };
  for (const Method& method : {Method{"constrained", {3, 10, 0}},
                               {"nearest", {0}},
                               {"nearest10", {0}},
                               {"force_shading", {0}}}) {
    for (const int n : method.iterations) {
      for (const int mm : {5, 10, 20}) {
        for (const int rate : {1000, 4000}) {
          StudyKnobs k;
          k.method = method.name;
          k.iterations = n;
          k.voxel_m = 1e-3 * mm;
          k.rate_hz = rate;
          const std::string steps = n > 0 ? std::to_string(n) : "all";
          const std::string size = std::to_string(mm), hz = std::to_string(rate);
          add("product", k.method + "_" + steps + "_" + size + "mm_" + hz + "hz",
              k.method + (n > 0 ? ", " + steps + " steps, " : ", ") + size + " mm, " + hz + " Hz",
              k);
        }
      }
    }
  }
  return all;
}

}  // namespace

Study study_haptic(std::ostream& progress) {
  Study study;
  study.name = "accuracy.haptic";
  for (const StudyScene& scene : scenes()) {
    const std::string data = scene.name;
    for (const StudySetting& s : settings()) {
      progress << data << ": " << s.label << "\n";
      StudyRow row;
      row.data = data;
      row.knob = s.knob, row.setting = s.setting, row.label = s.label;
      row.is_default = s.is_default;
      row.figures = judge(scene, run_scene(scene, s.knobs));
      study.rows.push_back(std::move(row));
    }
    study.plots.push_back({"accuracy_haptic_" + data, "force error, " + data, data,
                           "force_error_p95_N", "p95 of the force error, N", "cpu_us",
                           "CPU of a tick in contact, us"});
    study.plots.push_back({"accuracy_haptic_" + data + "_jump", "largest jump, " + data, data,
                           "jump_N", "largest raw step beyond the hand's motion, N", "cpu_us",
                           "CPU of a tick in contact, us"});
  }
  return study;
}

std::string corner_picture(const std::string& method) {
  const StudyScene scene = scenes().front();
  StudyKnobs knobs;
  knobs.method = method;
  const StudyRun run = run_scene(scene, knobs);
  plot::Figure f;
  f.title = "Concave corner, 10 mm voxels: " + method;
  f.x_label = "x, mm";
  f.y_label = "z, mm";
  // The same scale on both axes.
  f.width_px = 620, f.height_px = 560;
  plot::Series solid{"surface", {-50, 0, 0}, {0, 0, 45}, "#777777", false, false};
  plot::Series hand{"hand", {}, {}, "", false, false}, proxy{"proxy", {}, {}, "", false, false};
  plot::Series force{"force, 1 N = 1 mm", {}, {}, "#b03a2e", false, false};
  const double nan = std::nan("");
  double next = 0;
  for (const StudyTick& t : run.ticks) {
    hand.x.push_back(1e3 * t.h.x());
    hand.y.push_back(1e3 * t.h.z());
    proxy.x.push_back(t.contact ? 1e3 * t.p.x() : nan);
    proxy.y.push_back(t.contact ? 1e3 * t.p.z() : nan);
    if (!t.contact || kSpeed * t.t < next) continue;
    next = kSpeed * t.t + 0.005;
    for (const double s : {0.0, 1.0}) {
      force.x.push_back(1e3 * t.h.x() + s * t.f.x());
      force.y.push_back(1e3 * t.h.z() + s * t.f.z());
    }
    force.x.push_back(nan);
    force.y.push_back(nan);
  }
  f.series = {solid, hand, proxy, force};
  return plot::line_plot(f);
}

}  // namespace teletact
