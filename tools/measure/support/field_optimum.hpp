// Slow reference for the haptic proxy: where a point rests that is drawn towards the hand, cannot
// enter the solid and never moves away from the hand (the path-constrained minimum of |p - h|),
// found by direct search on the samples. No gradient, no tangent plane, no quadratic programme, and
// its own trilinear interpolation: nothing is shared with the renderer. Resolution 0.05 mm: no step
// is longer, so no ridge wider than that is hopped over, and the hand comes on in pieces of at most
// 0.1 mm, so that the way it took counts and not how often it was looked at.
//
// Search: the neighbourhood of p is seen along the line to the hand h. An offset across that line
// is walked to; a walk that enters the solid rises away from h to the surface, and in the free it
// sinks towards h until it meets the surface or h. The best of 16 directions and their refinement
// is taken, at ever smaller radii, until none is better. What is exactly zero is solid.
//
// Checked against closed forms and by random search in tests/unit/tasks_haptic.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <numbers>
#include <utility>
#include <vector>

#include "perception/geometry/pose.hpp"

namespace support {

using perception::Vec3;

// Trilinear interpolation of node values, sampled once over a box of the grid; beyond it the
// nearest node counts. NaN = unknown.
class ReferenceField {
 public:
  using Node = std::function<double(int, int, int)>;
  // Nodes first .. first + count - 1 of each axis.
  ReferenceField(const Node& node, double voxel, const Eigen::Array3i& first,
                 const Eigen::Array3i& count)
      : voxel_(voxel), first_(first), count_(count) {
    nodes_.reserve(static_cast<std::size_t>(count.prod()));
    for (int x = 0; x < count.x(); ++x) {
      for (int y = 0; y < count.y(); ++y) {
        for (int z = 0; z < count.z(); ++z) {
          nodes_.push_back(node(first.x() + x, first.y() + y, first.z() + z));
        }
      }
    }
  }

  // A surface given by its distance itself.
  explicit ReferenceField(std::function<double(const Vec3& p)> exact)
      : exact_(std::move(exact)), first_(0, 0, 0), count_(0, 0, 0) {}

  [[nodiscard]] double operator()(const Vec3& p) const {
    if (exact_) return exact_(p);
    const Vec3 q = p / voxel_;
    const Eigen::Array3i cell = q.array().floor().cast<int>();
    const Vec3 u = q - cell.cast<double>().matrix();
    double sum = 0;
    for (int c = 0; c < 8; ++c) {
      const Eigen::Array3i bit(c & 1, (c >> 1) & 1, c >> 2);
      double w = 1;
      for (int a = 0; a < 3; ++a) w *= bit[a] != 0 ? u[a] : 1 - u[a];
      const Eigen::Array3i i = (cell + bit - first_).max(0).min(count_ - 1);
      sum +=
          w * nodes_[static_cast<std::size_t>((i.x() * count_.y() + i.y()) * count_.z() + i.z())];
    }
    return sum;
  }

 private:
  std::function<double(const Vec3& p)> exact_;
  double voxel_ = 0;
  Eigen::Array3i first_, count_;
  std::vector<double> nodes_;
};

class FieldOptimum {
 public:
  using Known = std::function<bool(const Vec3& p)>;
  // `radius`: of the tip, m. Where the field rises faster than distance (a projective one seen at a
  // grazing angle), as many times more of it is asked for, by differences over a voxel; along an
  // axis on which one side was not seen, within the cell. `known`: of the cell of a place; empty:
  // all were seen.
  FieldOptimum(const ReferenceField& field, double radius, double voxel = 0.01, Known known = {})
      : field_(field), tip_(radius), voxel_(voxel), known_(std::move(known)), radius_(radius) {}

  // p rests for the hand at `from`; where it rests once the hand has gone straight on to `to`.
  [[nodiscard]] Vec3 follow(Vec3 p, const Vec3& from, const Vec3& to) const {
    const int pieces =
        std::max(1, static_cast<int>(std::ceil((to - from).norm() / kHandStep - 1e-6)));
    for (int i = 1; i <= pieces; ++i) {
      p = descend(p, from + (static_cast<double>(i) / pieces) * (to - from));
    }
    return p;
  }

  // From p (outside the solid, or less than 20 mm below its surface along the line from h). Every
  // step ends nearer to h.
  [[nodiscard]] Vec3 descend(Vec3 p, const Vec3& h) const {
    if (tip_ > 0) radius_ = tip_ * std::max(1.0, slope(p));
    p = sink(rise(p, h), h);
    for (int round = 0; round < 2000; ++round) {
      const double distance = (p - h).norm();
      if (distance < 1e-5) break;
      const Vec3 axis = (p - h) / distance;
      const Vec3 a = axis.unitOrthogonal(), b = axis.cross(a);
      Vec3 best = p;
      double best_distance = distance - 5e-8;
      for (double r = kStep; r > 8e-6 && best == p; r *= 0.5) {
        // Distance reached in one direction; only what really moves counts.
        const auto attempt = [&](double angle) {
          const Vec3 x = walk(p, std::cos(angle) * a + std::sin(angle) * b, r, h);
          const double d = x == p ? 1e9 : (x - h).norm();
          if (d < best_distance) {
            best = x;
            best_distance = d;
          }
          return d;
        };
        constexpr int kFan = 16;
        std::array<double, kFan> reached{};
        const auto angle_of = [](int k) { return 2 * std::numbers::pi * k / kFan + 0.1; };
        for (int k = 0; k < kFan; ++k) reached[static_cast<std::size_t>(k)] = attempt(angle_of(k));
        // In a crease only a narrow fan leads down: close in on every local minimum of the fan.
        for (int k = 0; k < kFan && best == p; ++k) {
          const auto at = [&](int i) {
            return reached[static_cast<std::size_t>((i + kFan) % kFan)];
          };
          if (at(k) >= 1e9 || at(k) > at(k - 1) || at(k) > at(k + 1)) continue;
          double middle = angle_of(k), least = at(k);
          for (double turn = 0.2; turn > 5e-4; turn *= 0.5) {
            const double m = middle;
            for (const double angle : {m - turn, m + turn}) {
              const double d = attempt(angle);
              if (d < least) {
                least = d;
                middle = angle;
              }
            }
          }
        }
      }
      if (best == p) best = squeeze(p, h);
      if (best == p) break;
      p = best;
    }
    return p;
  }

  // How much of the pull K (h - p) could still move p: the largest part of it along a way of
  // 0.25 mm that stays outside the solid from its first micrometres on, as a share of |h - p|. 0 where p
  // rests. A p in the solid is asked at the surface over it.
  [[nodiscard]] double unused(const Vec3& p, const Vec3& h) const {
    if ((h - p).norm() < 2e-4) return 0;
    if (tip_ >
        0) {  // the sheet that p is on, if it is near the right one: how near, its place says
      const double right = tip_ * std::max(1.0, slope(p));
      radius_ = std::clamp(field_(p) - 1e-7, 0.75 * right, 1.25 * right);
    }
    return steepest(rise(p, h), h, kUnusedWay, true).first;
  }

 private:
  static constexpr double kStep = 5e-5, kHandStep = 1e-4, kUnusedWay = 2.5e-4, kAway = 0.8;

  // The straight way of length r that leads most towards h without entering the solid: the part of
  // it towards h, and its direction.
  [[nodiscard]] std::pair<double, Vec3> steepest(const Vec3& p, const Vec3& h, double r,
                                                 bool whole) const {
    const double distance = (h - p).norm();
    const Vec3 axis = (h - p) / distance;
    const Vec3 a = axis.unitOrthogonal(), b = axis.cross(a);
    r = std::min(r, distance);
    // The steepest free way in the half-plane through the axis at `angle`: its slope, which may
    // lead away from h.
    const auto reach = [&](double angle, Vec3& way) {
      const Vec3 side = std::cos(angle) * a + std::sin(angle) * b;
      double lo = -kAway, hi = 0.5 * std::numbers::pi;
      for (int i = 0; i < 10; ++i) {
        const double e = 0.5 * (lo + hi);
        const Vec3 d = std::cos(e) * side + std::sin(e) * axis;
        bool barred = field_(p + r * d) <= (whole ? radius_ : radius_ - 2e-6);
        if (whole && !barred) {
          for (const double part : {0.02, 0.05, 0.1, 0.2, 0.4, 0.6, 0.8}) {
            barred = barred || solid(p + (part * r) * d);
          }
        }
        (barred ? hi : lo) = e;
      }
      way = std::cos(lo) * side + std::sin(lo) * axis;
      return lo;
    };
    constexpr int kFan = 48;
    std::array<double, kFan> slope_of{};
    const auto angle_of = [](int k) { return 2 * std::numbers::pi * k / kFan + 0.05; };
    const auto at = [&](int k) { return slope_of[static_cast<std::size_t>((k + kFan) % kFan)]; };
    double best = 0;
    Vec3 way = Vec3::Zero(), attempt;
    for (int k = 0; k < kFan; ++k) {
      slope_of[static_cast<std::size_t>(k)] = reach(angle_of(k), attempt);
      if (at(k) > best) {
        best = at(k);
        way = attempt;
      }
    }
    if (best > 0) return {std::sin(best), way};
    // A crease may lead down between two rays of the fan: close in on its peaks.
    for (int k = 0; k < kFan; ++k) {
      if (at(k) <= -0.99 * kAway || at(k) < at(k - 1) || at(k) <= at(k + 1)) continue;
      double middle = angle_of(k), top = at(k);
      for (double turn = std::numbers::pi / kFan; turn > 2e-3; turn *= 0.5) {
        const double m = middle;
        for (const double angle : {m - turn, m + turn}) {
          const double slope = reach(angle, attempt);
          if (slope <= top) continue;
          top = slope;
          middle = angle;
          if (slope > best) {
            best = slope;
            way = attempt;
          }
        }
      }
    }
    best = std::sin(best);
    return {best, way};
  }
  // Out of a place that the fan across the line to h does not lead out of; p itself if there is no
  // way.
  [[nodiscard]] Vec3 squeeze(const Vec3& p, const Vec3& h) const {
    const double distance = (h - p).norm();
    // A whole free way, as unused() looks for one: along a crease narrower than the steps of the
    // fan.
    for (const double r : {kUnusedWay, 1e-4, kStep, 2e-5}) {
      const auto [part, way] = steepest(p, h, r, true);
      if (part < 0.002) continue;
      Vec3 x = sink(p + std::min(r, distance) * way, h);
      if ((x - h).norm() < distance - 5e-8) return x;
    }
    for (double r = kStep; r > 2e-5; r *= 0.5) {
      const auto [part, way] = steepest(p, h, r, false);
      if (part < 0.01) continue;
      Vec3 x = sink(rise(p + std::min(r, distance) * way, h), h);
      const bool free = field_(p + 0.5 * std::min(r, distance) * way) > radius_ - 5e-6;
      if (free && (x - h).norm() < distance - 5e-8) return x;
    }
    return p;
  }

  [[nodiscard]] double slope(const Vec3& p) const {
    double sum = 0;
    for (int a = 0; a < 3; ++a) {
      const Vec3 step = voxel_ * Vec3::Unit(a);
      double rise = (field_(p + step) - field_(p - step)) / (2 * voxel_);
      if (known_ && !(known_(p + step) && known_(p - step))) {
        Vec3 wall = p;
        wall[a] = voxel_ * std::floor(p[a] / voxel_);
        rise = (field_(wall + step) - field_(wall)) / voxel_;
      }
      sum += rise * rise;
    }
    return std::sqrt(sum);
  }
  [[nodiscard]] bool solid(const Vec3& x) const { return field_(x) <= radius_; }

  // Out of the solid, away from h; where that is far (in a slot that the tip hardly fits in), the
  // shortest way out of 96.
  [[nodiscard]] Vec3 rise(const Vec3& p, const Vec3& h) const {
    constexpr double kShort = 2e-4, kFarthest = 0.02;
    if (!solid(p)) return p;
    const Vec3 away = (p - h).normalized();
    double far = kStep;
    while (far < kFarthest && solid(p + far * away)) far += kStep;
    if (far > kShort) {
      for (double s = 1e-5; s < std::min(far, kFarthest); s *= 1.3) {
        for (int k = 0; k < 96; ++k) {  // evenly over the sphere
          const double z = (k + 0.5) / 48 - 1, angle = 2.399963 * k, r = std::sqrt(1 - z * z);
          const Vec3 way(r * std::cos(angle), r * std::sin(angle), z);
          if (!solid(p + s * way)) return edge(p, p + s * way);
        }
      }
    }
    return far < kFarthest ? edge(p + (far - kStep) * away, p + far * away) : p;
  }
  // Between a place in the solid and a free one: the free side of the surface.
  [[nodiscard]] Vec3 edge(Vec3 in, Vec3 out) const {
    for (int i = 0; i < 12; ++i) {
      const Vec3 middle = 0.5 * (in + out);
      (solid(middle) ? in : out) = middle;
    }
    return out;
  }
  // Towards h until the surface.
  [[nodiscard]] Vec3 sink(const Vec3& p, const Vec3& h) const {
    const double length = (h - p).norm();
    if (length < 1e-9) return p;
    const Vec3 way = (h - p) / length;
    double done = 0;
    while (done < length) {
      const double next = std::min(length, done + kStep);
      if (solid(p + next * way)) {
        double lo = done, hi = next;
        for (int i = 0; i < 12; ++i) {
          const double m = 0.5 * (lo + hi);
          (solid(p + m * way) ? hi : lo) = m;
        }
        return p + lo * way;
      }
      done = next;
    }
    return h;
  }
  // One step; p itself when the slope there is steeper than 8 in 1.
  [[nodiscard]] Vec3 walk(const Vec3& p, const Vec3& direction, double r, const Vec3& h) const {
    Vec3 next = p + r * direction;
    if (solid(next)) {
      const Vec3 away = (next - h).normalized();
      double lo = 0, hi = 8 * r;
      if (solid(next + hi * away)) return p;
      for (int k = 0; k < 14; ++k) {
        const double m = 0.5 * (lo + hi);
        (solid(next + m * away) ? lo : hi) = m;
      }
      return next + hi * away;
    }
    return sink(next, h);
  }

  const ReferenceField& field_;
  double tip_, voxel_;
  Known known_;
  mutable double radius_;  // of the field, for this place
};

}  // namespace support
