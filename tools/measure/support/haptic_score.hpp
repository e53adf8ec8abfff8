// The figures of a run of the rig: steps, guard, force and position against the field optimum.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <string>
#include <vector>

#include "rt/quantile.hpp"
#include "tools/measure/support/field_optimum.hpp"
#include "tools/measure/support/haptic_rig.hpp"

namespace rig {

// What is said of a run.
struct Figures {
  double j = 0, j_raw = 0, force_max = 0, guard_share = 0, contact_share = 0;
  double f_error_p95 = 0, p_error_p95 = 0, f_error_max = 0, p_error_max = 0;  // to the optimum
  // The same to the optimum on the samples, where the optimum above is on the surface that they
  // were fused from.
  double f_error_samples_p95 = 0, p_error_samples_p95 = 0;
  // The field optimum is the path-constrained minimiser on the samples; the guarded optimum is its
  // force behind the slew guard: what may be sent of it.
  double f_error_guarded_optimum = 0;  // p95 of guarded against field optimum
  // |dF| a tick of the guarded optimum; of a slower guard that keeps the limit of J and of the force error, if that one does.
  double j_guarded_optimum = 0;
  double longer_max = 0, shorter_max = 0;  // |p - h| against the optimum's, m
  double judged_share = 1;  // of the ticks in the surface: no unknown space since seen-free space
  double below_max = 0;     // deepest the proxy sits below the blended field's zero set, m
  double unused_max = 0, unused_optimum = 0;  // unused tangential force, N: ours, the optimum's
  double cpu_p50 = 0, cpu_p99 = 0, work_p50 = 0, work_max = 0;
  double behind_max_s =
      0;  // longest time the force sent is more than 0.1 N off the one before the guard
  double off_p95 = 0;  // proxy off the surface of the blended field, m
};

inline Figures figures(const std::vector<Row>& rows) {
  Figures out;
  std::vector<double> cpu, work, off;
  std::size_t contact = 0, guard = 0, behind = 0, longest = 0;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Row& r = rows[i];
    out.force_max = std::max(out.force_max, r.f.norm());
    if (i > 0) {
      out.j = std::max(out.j, (r.f - rows[i - 1].f).norm());
      out.j_raw = std::max(out.j_raw, (r.f_raw - rows[i - 1].f_raw).norm());
    }
    behind = (r.f - r.f_raw).norm() > 0.1 ? behind + 1 : 0;
    longest = std::max(longest, behind);
    if (r.telemetry.in_contact && !std::isnan(r.off_m)) off.push_back(r.off_m);
    if (r.telemetry.in_contact) {
      ++contact;
      guard += r.telemetry.guard_use ? 1U : 0U;
      cpu.push_back(r.cpu_us);
      work.push_back(r.telemetry.work);
    }
  }
  out.contact_share = static_cast<double>(contact) / static_cast<double>(rows.size());
  out.guard_share = contact > 0 ? static_cast<double>(guard) / static_cast<double>(contact) : 0;
  out.behind_max_s = 1e-3 * static_cast<double>(longest);
  out.off_p95 = rt::quantile(off, 0.95);
  out.cpu_p50 = rt::quantile(cpu, 0.5);
  out.cpu_p99 = rt::quantile(cpu, 0.99);
  out.work_p50 = rt::quantile(work, 0.5);
  out.work_max = rt::quantile(work, 1.0);
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

// What the optimum is sought on: the samples, or the surface that they were fused from.
inline support::ReferenceField judging_field(const Rig& rig, const std::vector<Row>& rows) {
  const Scene& setup = rig.setup();
  if (!setup.truth) return reference_field(rig, rows);
  const Pose X_SW = setup.X_WS.inverse();
  return support::ReferenceField(
      [X_SW, truth = setup.truth](const Vec3& p_W) { return truth(X_SW * p_W); });
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

// A force behind a guard of so many N a tick, and at least 1.1 times what the hand's way changes.
class SlewFollower {
 public:
  SlewFollower(double rate_N, double stiffness_N_per_m, std::size_t stride)
      : ticks_(static_cast<double>(stride)), rate_N_(rate_N), stiffness_(stiffness_N_per_m) {}
  void reset() { f_ = Vec3::Zero(); }
  void follow(const Vec3& f, double moved_m) {
    const double most = std::max(rate_N_ * ticks_, 1.1 * stiffness_ * moved_m);
    const Vec3 change = f - f_;
    const Vec3 step = change * std::min(1.0, most / std::max(change.norm(), 1e-12));
    f_ += step;
    j_ = std::max(j_, step.norm() / ticks_);
  }
  [[nodiscard]] const Vec3& force() const { return f_; }
  [[nodiscard]] double j() const { return j_; }

 private:
  double ticks_, rate_N_, stiffness_, j_ = 0;
  Vec3 f_ = Vec3::Zero();
};

constexpr double kForceErrorLimit_N = 0.3;

// Force and position against the optimum on the samples or, where they are fused from images of a
// surface, on that surface itself (Scene::truth), every `stride` ticks. Unused force is what the
// samples still allow. Only for solids that stand still. `j_limit_N`: of the run; a guard of that
// rate is tried too. Unknown space holds no surface to be judged by (the oracle would meet a wall
// there): once either proxy has been in it, they are compared again when the hand has been in
// seen-free space.
struct Optimum {
  std::size_t row;
  Vec3 p, f;       // S
  Vec3 f_guarded;  // its force behind the slew guard
};
// A run against the optimum on the reference field, row by row.
class Judging {
 public:
  Judging(const Rig& rig, const std::vector<Row>& rows, std::size_t stride, double j_limit_N)
      : setup_(rig.setup()),
        samples_(reference_field(rig, rows)),
        field_(judging_field(rig, rows)),
        on_samples_(samples_, radius(), setup_.voxel, known()),
        optimum_(field_, radius(), setup_.voxel,
                 setup_.truth ? support::FieldOptimum::Known{} : known()),
        guarded_(0.3, setup_.config.stiffness_N_per_m, stride),
        slower_(std::min(0.3, j_limit_N), setup_.config.stiffness_N_per_m, stride) {
    p_ = h_last_ = p_on_samples_ = setup_.X_WS * rows.front().h;
  }
  Judging(const Judging&) = delete;  // its parts know each other
  Judging& operator=(const Judging&) = delete;

  // Every tick: how far below the surface it is.
  void see(const Row& r, Figures& out) const {
    const Vec3 p_mine = setup_.X_WS * r.p;
    if (r.telemetry.in_contact && in_known(setup_, p_mine))
      out.below_max = std::max(out.below_max, radius() - samples_(p_mine));
  }
  // Every tick of the stride.
  void judge(std::size_t i, const Row& r, Figures& out) {
    const Vec3 p_mine = setup_.X_WS * r.p, h = setup_.X_WS * r.h;
    const bool inside = r.telemetry.in_contact || field_(h) <= setup_.config.tip_radius_m;
    asked_ += inside ? 1U : 0U;
    comparable_ = comparable_ && in_known(setup_, p_mine) && in_known(setup_, p_);
    if (!comparable_) {
      begin_again(r, h);
      return;
    }
    p_ = optimum_.follow(p_, h_last_, h);
    if (setup_.truth) p_on_samples_ = on_samples_.follow(p_on_samples_, h_last_, h);
    const double moved = (h - h_last_).norm();
    h_last_ = h;
    comparable_ = in_known(setup_, p_);  // it may have come there in this step
    if (!comparable_) return;
    judged_ += inside ? 1U : 0U;
    const Vec3 f = limited(setup_.config.stiffness_N_per_m * (p_ - h));
    // Behind the slew guard: a force may not jump as the optimum may. In the free too.
    guarded_.follow(f, moved);
    slower_.follow(f, moved);
    if (!r.telemetry.in_contact && (p_ - h).norm() < 1e-4) return;
    compare(i, r, h, f, out);
  }
  [[nodiscard]] std::vector<Optimum> finish(Figures& out) {
    out.judged_share = asked_ > 0 ? static_cast<double>(judged_) / static_cast<double>(asked_) : 1;
    out.f_error_p95 = rt::quantile(f_error_, 0.95);
    out.f_error_max = rt::quantile(f_error_, 1);
    out.f_error_guarded_optimum = rt::quantile(f_guarded_error_, 0.95);
    // The samples force a step over the limit of J only if a slower one puts the force off.
    out.j_guarded_optimum =
        rt::quantile(f_slower_error_, 0.95) <= kForceErrorLimit_N ? slower_.j() : guarded_.j();
    out.p_error_p95 = rt::quantile(p_error_, 0.95);
    out.p_error_max = rt::quantile(p_error_, 1);
    out.f_error_samples_p95 = setup_.truth ? rt::quantile(f_samples_, 0.95) : out.f_error_p95;
    out.p_error_samples_p95 = setup_.truth ? rt::quantile(p_samples_, 0.95) : out.p_error_p95;
    return std::move(path_);
  }

 private:
  static constexpr double kForceLimit_N = 12;
  [[nodiscard]] double radius() const { return setup_.config.tip_radius_m; }
  [[nodiscard]] support::FieldOptimum::Known known() const {
    if (!setup_.known) return {};
    return [this](const Vec3& p_W) { return in_known(setup_, p_W); };
  }
  [[nodiscard]] static Vec3 limited(Vec3 f) {
    const double whole = f.norm();
    if (whole > kForceLimit_N) f *= kForceLimit_N / whole;
    return f;
  }
  void begin_again(const Row& r, const Vec3& h) {
    comparable_ =
        !r.telemetry.in_contact && in_known(setup_, h) && field_(h) > setup_.config.tip_radius_m;
    p_ = p_on_samples_ = h_last_ = h;
    guarded_.reset();
    slower_.reset();
  }
  // `f`: the optimum's, limited.
  void compare(std::size_t i, const Row& r, const Vec3& h, const Vec3& f, Figures& out) {
    const Vec3 p_mine = setup_.X_WS * r.p;
    const double stiffness = setup_.config.stiffness_N_per_m;
    f_guarded_error_.push_back((f - guarded_.force()).norm());
    f_slower_error_.push_back((f - slower_.force()).norm());
    const double mine = (p_mine - h).norm(), best = (p_ - h).norm();
    out.longer_max = std::max(out.longer_max, mine - best);
    out.shorter_max = std::max(out.shorter_max, best - mine);
    out.unused_max = std::max(out.unused_max, on_samples_.unused(p_mine, h) * stiffness * mine);
    const double whole = (stiffness * (p_ - h)).norm();
    out.unused_optimum = std::max(out.unused_optimum, optimum_.unused(p_, h) * whole);
    const Mat3 R_SW = setup_.X_WS.linear().transpose();
    path_.push_back({i, setup_.X_WS.inverse() * p_, R_SW * f, R_SW * guarded_.force()});
    f_error_.push_back((setup_.X_WS.linear() * r.f - f).norm());
    p_error_.push_back((p_mine - p_).norm());
    if (!setup_.truth) return;
    const Vec3 f_there = limited(stiffness * (p_on_samples_ - h));
    f_samples_.push_back((setup_.X_WS.linear() * r.f - f_there).norm());
    p_samples_.push_back((p_mine - p_on_samples_).norm());
  }

  const Scene& setup_;
  support::ReferenceField samples_, field_;
  support::FieldOptimum on_samples_, optimum_;
  SlewFollower guarded_, slower_;
  Vec3 p_, h_last_, p_on_samples_;
  bool comparable_ = true;
  std::size_t asked_ = 0, judged_ = 0;
  std::vector<Optimum> path_;
  std::vector<double> f_error_, p_error_, f_guarded_error_, f_slower_error_, f_samples_, p_samples_;
};

inline std::vector<Optimum> score(const Rig& rig, const std::vector<Row>& rows, Figures& out,
                                  std::size_t stride = 5, double j_limit_N = 0.3) {
  Judging judging(rig, rows, stride, j_limit_N);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    judging.see(rows[i], out);
    if (i % stride == 0) judging.judge(i, rows[i], out);
  }
  return judging.finish(out);
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

}  // namespace rig
