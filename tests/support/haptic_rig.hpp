// A rig for the haptic task: a solid given by its signed distance, sampled onto windows that follow
// the hand at 30 Hz as fusion's do, a hand path, and the record of every tick.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <ctime>
#include <functional>
#include <memory>
#include <numbers>
#include <string>
#include <vector>

#include "perception/patch/surface_patch.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/memory/section.hpp"
#include "tasks/haptic/haptic_task.hpp"
#include "tests/support/field_optimum.hpp"
#include "tools/haptic/pop_checker.hpp"

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
  std::function<bool(int x, int y, int z)> known;  // of those nodes, was it seen; empty: all were
  Pose X_WS = Pose::Identity();
  double voxel = 0.01, truncation = 0.05;
  int nodes = 28;
  bool still = false;  // the solid does not change with t: every node is computed once
  tasks::HapticConfig config;
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
  int contacts;
  double cpu_us;
  rt::Health health;
  double depth_m =
      0;  // of the proxy below the blended field's zero set, by the pop checker; NaN: free, unknown
};

inline double thread_us() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) * 1e6 + static_cast<double>(t.tv_nsec) * 1e-3;
}

class Rig {
 public:
  explicit Rig(Scene setup)
      : setup_(std::move(setup)), task_(startup_.token(), setup_.config, setup_.device, 1e-3) {
    for (auto& s : slots_) s = std::make_unique<SurfacePatch>();
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
          patch.distance[i] = static_cast<std::int16_t>(std::lround(v / setup_.truncation * 32767));
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
      const double before = thread_us();
      rt::Section section;
      row.health = task_.step(tick, in_, out_);
      row.cpu_us = thread_us() - before;
    }
    const Mat3 R_SW = setup_.X_WS.linear().transpose();
    row.t = t;
    row.h = p_SH;
    row.p = setup_.X_WS.inverse() * out_.state.p_WP;
    row.f = R_SW * out_.force.f_H_D;
    row.f_raw = R_SW * out_.telemetry.f_raw_D;
    row.telemetry = out_.telemetry;
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

// What is said of a run.
struct Figures {
  double j = 0, j_raw = 0, force_max = 0, guard_share = 0, contact_share = 0;
  double f_error_p95 = 0, p_error_p95 = 0, f_error_max = 0, p_error_max = 0;  // to the optimum
  double f_error_optimum = 0;  // p95 of the optimum behind the slew guard against itself
  double j_optimum = 0;        // |dF| a tick of the optimum behind the slew guard
  double longer_max = 0, shorter_max = 0;  // |p - h| against the optimum's, m
  double judged_share = 1;  // of the ticks in the surface: no unknown space since seen-free space
  double below_max = 0;     // deepest the proxy sits below the blended field's zero set, m
  double unused_max = 0, unused_optimum = 0;  // unused tangential force, N: ours, the optimum's
  double cpu_p50 = 0, cpu_p99 = 0, work_p50 = 0, work_max = 0;
};

inline double percentile(std::vector<double> v, double p) {
  if (v.empty()) return 0;
  std::sort(v.begin(), v.end());
  const double i = p * static_cast<double>(v.size() - 1);
  return v[static_cast<std::size_t>(std::llround(i))];
}

inline Figures figures(const std::vector<Row>& rows) {
  Figures out;
  std::vector<double> cpu, work;
  std::size_t contact = 0, guard = 0;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Row& r = rows[i];
    out.force_max = std::max(out.force_max, r.f.norm());
    if (i > 0) {
      out.j = std::max(out.j, (r.f - rows[i - 1].f).norm());
      out.j_raw = std::max(out.j_raw, (r.f_raw - rows[i - 1].f_raw).norm());
    }
    if (r.telemetry.in_contact) {
      ++contact;
      guard += r.telemetry.guard_use ? 1U : 0U;
      cpu.push_back(r.cpu_us);
      work.push_back(r.telemetry.work);
    }
  }
  out.contact_share = static_cast<double>(contact) / static_cast<double>(rows.size());
  out.guard_share = contact > 0 ? static_cast<double>(guard) / static_cast<double>(contact) : 0;
  out.cpu_p50 = percentile(cpu, 0.5);
  out.cpu_p99 = percentile(cpu, 0.99);
  out.work_p50 = percentile(work, 0.5);
  out.work_max = percentile(work, 1.0);
  return out;
}

// The field round a path, as the oracle reads it.
inline support::ReferenceField reference_field(const Rig& rig, const std::vector<Row>& rows) {
  const Scene& setup = rig.setup();
  Vec3 lo = Vec3::Constant(1e9), hi = Vec3::Constant(-1e9);
  for (const Row& r : rows) {
    for (const Vec3& x : {Vec3(setup.X_WS * r.h), Vec3(setup.X_WS * r.p)}) {
      lo = lo.cwiseMin(x);
      hi = hi.cwiseMax(x);
    }
  }
  const Eigen::Array3i first = (lo / setup.voxel).array().floor().cast<int>() - 6;
  const Eigen::Array3i count = (hi / setup.voxel).array().ceil().cast<int>() + 7 - first;
  // As a patch stores it.
  const auto unit = static_cast<double>(static_cast<float>(setup.truncation / 32767.0));
  const auto stored = [&](int x, int y, int z) {
    const double v = rig.node(x, y, z, 0) + setup.extra(x, y, z, 0);
    return unit *
           static_cast<double>(std::lround(std::clamp(v, -setup.truncation, setup.truncation) /
                                           setup.truncation * 32767));
  };
  return {stored, setup.voxel, first, count};
}

// Every node of the cell of p_W was seen.
inline bool in_known(const Scene& setup, const Vec3& p_W) {
  if (!setup.known) return true;
  const Eigen::Array3i i = (p_W / setup.voxel).array().floor().cast<int>();
  for (int c = 0; c < 8; ++c) {
    if (!setup.known(i.x() + (c >> 2), i.y() + ((c >> 1) & 1), i.z() + (c & 1))) return false;
  }
  return true;
}

// Force and position against the field optimum, every `stride` ticks. Only for solids that stand
// still. Unknown space holds no surface to be judged by (the oracle would meet a wall there): once either proxy
// has been in it, they are compared again when the hand has been in seen-free space.
struct Optimum {
  std::size_t row;
  Vec3 p, f;  // S
};
inline std::vector<Optimum> score(const Rig& rig, const std::vector<Row>& rows, Figures& out,
                                  std::size_t stride = 5) {
  const Scene& setup = rig.setup();
  const support::ReferenceField field = reference_field(rig, rows);
  const support::FieldOptimum optimum(field, setup.config.tip_radius_m, setup.voxel);
  std::vector<Optimum> path;
  std::vector<double> f_error, p_error, f_guarded_error;
  Vec3 p = setup.X_WS * rows.front().h, h_last = p, f_guarded = Vec3::Zero();
  bool comparable = true;
  std::size_t asked = 0, judged = 0;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Row& r = rows[i];
    const Vec3 p_mine = setup.X_WS * r.p;
    if (r.telemetry.in_contact && in_known(setup, p_mine)) {
      out.below_max = std::max(out.below_max, setup.config.tip_radius_m - field(p_mine));
    }
    if (i % stride != 0) continue;
    const Vec3 h = setup.X_WS * r.h;
    const bool inside = r.telemetry.in_contact || field(h) <= setup.config.tip_radius_m;
    asked += inside ? 1U : 0U;
    comparable = comparable && in_known(setup, p_mine) && in_known(setup, p);
    if (!comparable) {
      comparable =
          !r.telemetry.in_contact && in_known(setup, h) && field(h) > setup.config.tip_radius_m;
      p = h_last = h;
      f_guarded = Vec3::Zero();
      continue;
    }
    judged += inside ? 1U : 0U;
    p = optimum.follow(p, h_last, h);
    const double moved = (h - h_last).norm();
    h_last = h;
    if (!r.telemetry.in_contact && (p - h).norm() < 1e-4) continue;
    Vec3 f = setup.config.stiffness_N_per_m * (p - h);
    const double whole = f.norm();
    if (whole > 12) f *= 12 / whole;
    // The optimum behind the slew guard: where it jumps, no force may follow at once.
    const double most =
        std::max(0.3 * static_cast<double>(stride), 1.1 * setup.config.stiffness_N_per_m * moved);
    const Vec3 change = f - f_guarded;
    const Vec3 step = change * std::min(1.0, most / std::max(change.norm(), 1e-12));
    f_guarded += step;
    out.j_optimum = std::max(out.j_optimum, step.norm() / static_cast<double>(stride));
    f_guarded_error.push_back((f - f_guarded).norm());
    const double mine = (p_mine - h).norm(), best = (p - h).norm();
    out.longer_max = std::max(out.longer_max, mine - best);
    out.shorter_max = std::max(out.shorter_max, best - mine);
    out.unused_max =
        std::max(out.unused_max, optimum.unused(p_mine, h) * setup.config.stiffness_N_per_m * mine);
    out.unused_optimum = std::max(out.unused_optimum, optimum.unused(p, h) * whole);
    path.push_back({i, setup.X_WS.inverse() * p, setup.X_WS.linear().transpose() * f});
    f_error.push_back((setup.X_WS.linear() * r.f - f).norm());
    p_error.push_back((p_mine - p).norm());
  }
  out.judged_share = asked > 0 ? static_cast<double>(judged) / static_cast<double>(asked) : 1;
  out.f_error_p95 = percentile(f_error, 0.95);
  out.f_error_max = percentile(f_error, 1);
  out.f_error_optimum = percentile(f_guarded_error, 0.95);
  out.p_error_p95 = percentile(p_error, 0.95);
  out.p_error_max = percentile(p_error, 1);
  return path;
}

inline void print(const std::string& name, const Figures& f) {
  std::printf(
      "%-34s J %.3f raw %.3f N  Fmax %5.2f  F-err p95 %.3f max %.3f N  p-err p95 %.3f max %.3f mm "
      "(longer %.2f shorter %.2f)  "
      "unused %.2f/%.2f N  below %.3f mm  guard %.1f %%  contact %.0f %%  cpu %.1f/%.1f us  work "
      "%.0f/%.0f\n",
      name.c_str(), f.j, f.j_raw, f.force_max, f.f_error_p95, f.f_error_max, 1e3 * f.p_error_p95,
      1e3 * f.p_error_max, 1e3 * f.longer_max, 1e3 * f.shorter_max, f.unused_max, f.unused_optimum,
      1e3 * f.below_max, 100 * f.guard_share, 100 * f.contact_share, f.cpu_p50, f.cpu_p99,
      f.work_p50, f.work_max);
}

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
