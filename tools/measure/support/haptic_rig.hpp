// A rig for the haptic task: a solid given by its signed distance, sampled onto windows that follow
// the hand at 30 Hz as fusion's do, a hand path, and the record of every tick.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <numbers>
#include <string>
#include <vector>

#include "perception/patch/surface_patch.hpp"
#include "rt/clock/box_time.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/memory/section.hpp"
#include "tasks/haptic/haptic_task.hpp"
#include "tools/measure/support/haptic_witness.hpp"
#include "tools/measure/support/pop_checker.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace rig {

using perception::Mat3;
using perception::Pose;
using perception::SurfacePatch;
using perception::Vec3;
using tasks::HapticTask;

// Local frame S of a solid; X_WS puts it onto the grid. t = seconds of the run.
using Solid = std::function<double(const Vec3& p_S, double t)>;
using Hand = std::function<Vec3(double t)>;  // p_SH

struct Scene {
  Solid solid;
  // NaN-free: what of the space was seen at all.
  std::function<bool(const Vec3& p_S)> seen = [](const Vec3&) { return true; };
  // Added per node and frame, e.g. noise; frame counts publications.
  std::function<double(int x, int y, int z, int frame)> extra = [](int, int, int, int) {
    return 0.0;
  };
  // A field that is made elsewhere instead: its windows, and its nodes as the oracle reads them.
  std::function<void(const Vec3& centre_W, int nodes, double t, SurfacePatch& out)> window;
  std::function<double(int x, int y, int z)> sampled;
  std::function<bool(double t)> moves;  // does what is touched move, by the mask; empty: never
  std::function<bool(int x, int y, int z)> known;  // of those nodes, was it seen; empty: all were
  // The surface itself, where the samples are fused from images of it: it is what the run is judged
  // by. Empty: the samples are.
  std::function<double(const Vec3& p_S)> truth;
  Pose X_WS = Pose::Identity();
  double voxel = 0.01, truncation = 0.05;
  int nodes = 28;
  bool still = false;  // the solid does not change with t: every node is computed once
  // Method force_shading: makes the ray cast of the nodes (as published, NaN = unknown); false: as
  // before.
  using Node = std::function<double(int x, int y, int z)>;
  std::function<bool(const Node& node, tasks::SurfacePoints& out)> cast;
  bool layer = true;  // false: no slew guard, no fade-in, no passivity controller
  tasks::HapticConfig config = [] {
    tasks::HapticConfig c;
    c.credit_N_s_per_m = 2;  // of an ordinary device
    return c;
  }();
  drivers::DeviceProperties device = [] {
    drivers::DeviceProperties d;
    d.damping_N_s_per_m = 20;
    return d;
  }();
};

struct Row {
  double t;
  Vec3 h, p, f, f_raw;  // S
  tasks::HapticTelemetry telemetry;
  double off_m = 0;  // in contact: proxy off the blended field's surface; NaN where that is unknown
  // In this step, where the guard is linked (tools/measure/support/rt_guard.hpp).
  std::uint64_t allocations = 0, locks = 0;
  bool controlled = false;  // the passivity controller is on
  int contacts;
  double cpu_us;
  rt::Health health;
  double depth_m =
      0;  // of the proxy below the blended field's zero set, by the pop checker; NaN: free, unknown
};

// std::lround of what fits an int, without a call: a fifth of a run's time was spent in it.
inline int rounded(double x) {
  const int i = static_cast<int>(x);
  const double rest = x - i;
  return i + (rest >= 0.5 ? 1 : 0) - (rest <= -0.5 ? 1 : 0);
}

inline double thread_us() { return 1e-3 * static_cast<double>(rt::thread_cpu_ns()); }

class Rig {
 public:
  explicit Rig(Scene setup)
      : setup_(layered(std::move(setup))),
        task_(startup_.token(), setup_.config, setup_.device, 1e-3) {
    for (auto& s : slots_) s = std::make_unique<SurfacePatch>();
    if (setup_.cast) {
      for (auto& s : surfaces_) s = std::make_unique<tasks::SurfacePoints>();
    }
    in_.mode.seq = 1;
    in_.mode.mode = tasks::Mode::kHold;
    in_.stylus_ok = true;
    in_.stylus.state = drivers::DeviceState::kForce;
  }

  // Distance at a node of the world grid, clamped, NaN where unseen; without `extra`.
  [[nodiscard]] double node(int x, int y, int z, double t) const {
    if (!setup_.still) return node_now(x, y, z, t);
    constexpr int kHalf = kCacheEdge / 2;
    if (std::abs(x) >= kHalf || std::abs(y) >= kHalf || std::abs(z) >= kHalf)
      return node_now(x, y, z, t);
    if (cache_.empty())
      cache_.assign(static_cast<std::size_t>(kCacheEdge) * kCacheEdge * kCacheEdge, kNotYet);
    float& c = cache_[static_cast<std::size_t>(((x + kHalf) * kCacheEdge + y + kHalf) * kCacheEdge +
                                               z + kHalf)];
    if (c == kNotYet) c = static_cast<float>(node_now(x, y, z, t));
    return static_cast<double>(c);
  }
  [[nodiscard]] double node_now(int x, int y, int z, double t) const {
    if (setup_.sampled) return setup_.sampled(x, y, z);
    const Vec3 p_S = setup_.X_WS.inverse() * (setup_.voxel * Vec3(x, y, z));
    if (!setup_.seen(p_S)) return std::numeric_limits<double>::quiet_NaN();
    return std::clamp(setup_.solid(p_S, t), -setup_.truncation, setup_.truncation);
  }

  void fill(SurfacePatch& patch, const Vec3& centre_W, double t, int frame) const {
    patch.seq = static_cast<std::uint64_t>(frame) + 1;
    patch.fused = rt::time_from_ns(0) + rt::nanos_from_seconds(t);
    if (setup_.window) {
      setup_.window(centre_W, setup_.nodes, t, patch);
      return;
    }
    patch.touched_moves = setup_.moves && setup_.moves(t);
    patch.voxel_size = setup_.voxel;
    patch.metres_per_unit = static_cast<float>(setup_.truncation / 32767.0);
    patch.nodes = setup_.nodes;
    for (int a = 0; a < 3; ++a) {
      patch.origin_node[static_cast<std::size_t>(a)] =
          static_cast<int>(std::lround(centre_W[a] / setup_.voxel)) - setup_.nodes / 2;
    }
    for (int x = 0; x < patch.nodes; ++x) {
      for (int y = 0; y < patch.nodes; ++y) {
        for (int z = 0; z < patch.nodes; ++z) {
          const int gx = patch.origin_node[0] + x, gy = patch.origin_node[1] + y,
                    gz = patch.origin_node[2] + z;
          const std::size_t i = patch.index(x, y, z);
          double v = node(gx, gy, gz, t);
          if (std::isnan(v)) {
            patch.material[i] = 0;
            patch.distance[i] = 0;
            patch.set_free(i, false);
            continue;
          }
          v = std::clamp(v + setup_.extra(gx, gy, gz, frame), -setup_.truncation,
                         setup_.truncation);
          patch.distance[i] = static_cast<std::int16_t>(rounded(v / setup_.truncation * 32767));
          patch.material[i] = 1;
          patch.set_free(i, v > 0);
        }
      }
    }
  }

  // Runs `hand` from `from` to `to` seconds, one row a millisecond.
  std::vector<Row> run(const Hand& hand, double from, double to) {
    std::vector<Row> rows;
    const auto n = static_cast<std::int64_t>(std::llround((to - from) * 1000));
    rows.reserve(static_cast<std::size_t>(n));
    for (std::int64_t i = 0; i < n; ++i)
      rows.push_back(tick(hand(from + 1e-3 * static_cast<double>(i))));
    return rows;
  }

  Row tick(const Vec3& p_SH) {
    const double t = 1e-3 * static_cast<double>(k_);
    const Vec3 p_DH = setup_.X_WS * p_SH;
    const Vec3 h_W = task_.to_world(p_DH);
    const auto frame = static_cast<int>(std::floor(t * 30 + 1e-9));
    if (frame > frame_ && publish_) {
      frame_ = frame;
      due_ = true;
      due_W_ = h_W;
      due_s_ = t;
    }
    // The newest waits until the task takes it: what it still blends is not written over.
    if (due_ && task_.wants_patch()) {
      due_ = false;
      current_ = (current_ + 1) % slots_.size();
      fill(*slots_[current_], due_W_, due_s_, frame_);
      if (setup_.cast) cast();
    }
    rt::Tick tick;
    tick.k = k_;
    tick.release = rt::time_from_ns(static_cast<std::int64_t>(k_) * 1000000);
    tick.start = tick.release;
    tick.period = rt::Nanos{1000000};
    ++k_;
    in_.patch_newest = nullptr;
    if (task_.wants_patch() && frame_ >= 0) in_.patch_newest = slots_[current_].get();
    in_.stylus.seq = k_;
    in_.stylus.taken = tick.release;
    in_.stylus.p_DH = p_DH;
    pops_.offer(in_.patch_newest);
    Row row;
    {
      const rt_guard::Counts counted = rt_guard::counts();
      {
        const double before = thread_us();
        rt::Section section;
        row.health = task_.step(tick, in_, out_);
        row.cpu_us = thread_us() - before;
      }
      const rt_guard::Counts now = rt_guard::counts();
      row.allocations = now.allocations + now.frees - counted.allocations - counted.frees;
      row.locks = now.locks + now.waits - counted.locks - counted.waits;
    }
    const Mat3 R_SW = setup_.X_WS.linear().transpose();
    row.t = t;
    row.h = p_SH;
    row.p = setup_.X_WS.inverse() * out_.state.p_WP;
    row.f = R_SW * out_.force.f_H_D;
    row.f_raw = R_SW * out_.telemetry.f_raw_D;
    row.telemetry = out_.telemetry;
    row.controlled = setup_.config.passivity_controller;
    if (row.telemetry.in_contact) row.off_m = off_surface();
    if (Witness::current() != nullptr) Witness::current()->take(row);
    row.contacts = out_.state.contacts;
    pops_.judge(row.telemetry.in_contact, out_.state.p_WP, task_.to_world(p_DH),
                row.telemetry.blend);
    row.depth_m = pops_.depth_m();
    return row;
  }

  HapticTask::In& in() { return in_; }
  HapticTask::Out& out() { return out_; }
  HapticTask& task() { return task_; }
  [[nodiscard]] const teletact::PopChecker& pops() const { return pops_; }
  const Scene& setup() const { return setup_; }
  [[nodiscard]] rt::Time now() const {  // of the next tick
    return rt::time_from_ns(static_cast<std::int64_t>(k_) * 1000000);
  }
  void publish(bool on) { publish_ = on; }

 private:
  static Scene layered(Scene s) {
    if (s.layer) return s;
    s.config.guard = false;
    s.config.fade_in_s = 0;
    s.config.passivity_controller = false;
    return s;
  }
  // The ray cast of the field that was just published, at most one of those the task still reads
  // kept.
  void cast() {
    const auto published = [this](int x, int y, int z) {
      return std::clamp(node(x, y, z, due_s_) + setup_.extra(x, y, z, frame_), -setup_.truncation,
                        setup_.truncation);
    };
    const std::size_t other = 1 - surface_;
    if (!setup_.cast(published, *surfaces_[other])) return;
    surface_ = other;
    in_.surface = surfaces_[surface_].get();
  }
  // On a copy: the task's own keeps the cells it last used.
  [[nodiscard]] double off_surface() const {
    const tasks::Field field = task_.field();
    const tasks::FieldSample s = field.sample(out_.state.p_WP);
    if (!s.known) return std::numeric_limits<double>::quiet_NaN();
    return std::abs(s.value - setup_.config.tip_radius_m * std::max(1.0, s.gradient.norm()));
  }

  rt::Startup startup_;
  Scene setup_;
  HapticTask task_;
  teletact::PopChecker pops_;
  HapticTask::In in_;
  HapticTask::Out out_;
  static constexpr int kCacheEdge = 80;
  static constexpr float kNotYet = -1e9F;
  mutable std::vector<float> cache_;
  std::array<std::unique_ptr<SurfacePatch>, 4> slots_;
  std::size_t current_ = 0;
  std::array<std::unique_ptr<tasks::SurfacePoints>, 2> surfaces_;
  std::size_t surface_ = 0;
  int frame_ = -1;
  bool due_ = false;  // the newest window is not filled yet: where and when it was published
  Vec3 due_W_ = Vec3::Zero();
  double due_s_ = 0;
  bool publish_ = true;
  std::uint64_t k_ = 0;
};

// Piecewise linear path at constant speed.
class Path {
 public:
  Path(std::vector<Vec3> points, double speed) : points_(std::move(points)), speed_(speed) {}
  [[nodiscard]] double duration() const {
    double s = 0;
    for (std::size_t i = 1; i < points_.size(); ++i) s += (points_[i] - points_[i - 1]).norm();
    return s / speed_;
  }
  Vec3 operator()(double t) const {
    double s = t * speed_;
    for (std::size_t i = 1; i < points_.size(); ++i) {
      const double length = (points_[i] - points_[i - 1]).norm();
      if (s <= length && length > 0)
        return points_[i - 1] + (s / length) * (points_[i] - points_[i - 1]);
      s -= length;
    }
    return points_.back();
  }

 private:
  std::vector<Vec3> points_;
  double speed_;
};

// The placements every case is run at: three rotations about a skew axis and three offsets of the
// grid.
struct Placement {
  std::string name;
  Pose X_WS = Pose::Identity();
};
[[nodiscard]] inline Placement placement(std::string name, double degrees, const Vec3& offset_m) {
  Placement out{std::move(name), Pose::Identity()};
  const Vec3 skew = Vec3(1, 2, 3).normalized();
  out.X_WS.linear() = Eigen::AngleAxisd(degrees * std::numbers::pi / 180, skew).toRotationMatrix();
  out.X_WS.translation() = offset_m;
  return out;
}
inline std::vector<Placement> placements() {
  std::vector<Placement> out;
  const Vec3 offsets[3] = {{0, 0, 0}, {0.0037, 0.0021, 0.005}, {0.0081, 0.0049, 0.0023}};
  for (const int degrees : {0, 17, 45}) {
    for (int k = 0; k < 3; ++k) {
      out.push_back(
          placement(std::to_string(degrees) + "deg/" + std::to_string(k), degrees, offsets[k]));
    }
  }
  return out;
}

}  // namespace rig
