// What a claimed frame says of the cells (ground_map.hpp, "update").
#include <algorithm>
#include <cmath>
#include <limits>

#include <Eigen/Cholesky>

#include "perception/ground/ground_map.hpp"

namespace perception {

namespace {

constexpr std::uint8_t kNeither = 0, kGround = 1, kObstacle = 2;

// Tells ground from obstacle by the height of a pixel's point over the plane, corrected for drift.
class PointSorter {
 public:
  struct Point {
    Vec3f p_M;
    float height = 0, gate = 0;  // gate: height that is still ground at this range
    std::uint8_t kind = kNeither;
  };

  PointSorter(const GroundConfig& config, const Intrinsics& k, const Pose& X_MC,
              const Vec3& correction) noexcept
      : R_(X_MC.linear().cast<float>()),
        t_(X_MC.translation().cast<float>()),
        step_(R_.col(0) / static_cast<float>(k.fx)),
        k_(k),
        a_(static_cast<float>(correction.x())),
        b_(static_cast<float>(correction.y())),
        c_(static_cast<float>(correction.z())),
        tolerance_(static_cast<float>(config.ground_tolerance_m)),
        per_m2_(static_cast<float>(config.tolerance_per_m2)),
        top_(static_cast<float>(config.robot_height_m)) {}

  void begin_row(int v) noexcept {
    base_ = R_ * Vec3f(static_cast<float>(-k_.cx / k_.fx), static_cast<float>((v - k_.cy) / k_.fy),
                       1.0F);
  }
  [[nodiscard]] Point sort(int u, float z) const noexcept {
    Point q;
    q.p_M = z * (base_ + static_cast<float>(u) * step_) + t_;
    const float h = q.p_M.z() - (a_ + b_ * q.p_M.x() + c_ * q.p_M.y());
    q.height = h;
    q.gate = tolerance_ + per_m2_ * z * z;
    if (std::abs(h) <= q.gate)
      q.kind = kGround;
    else if (h > 0 ? h <= top_ : h < -3 * q.gate)
      q.kind = kObstacle;
    return q;
  }
  [[nodiscard]] const Vec3f& camera_M() const noexcept { return t_; }

 private:
  Eigen::Matrix3f R_;
  Vec3f t_, step_, base_ = Vec3f::Zero();
  const Intrinsics& k_;
  float a_, b_, c_, tolerance_, per_m2_, top_;
};

// `area`: of a cell, in 1/256, that an obstacle's point stands for.
template <class Cell>
void count_point(const PointSorter::Point& q, float area, std::uint32_t slice, Cell& at) noexcept {
  if (q.kind == kGround) {
    if (at.ground_points < 0xffffU) ++at.ground_points;
    return;
  }
  area = std::min(65535.0F - static_cast<float>(at.obstacle_area), std::max(1.0F, area));
  at.obstacle_area = static_cast<std::uint16_t>(at.obstacle_area + static_cast<int>(area));
  at.frame_height = std::max(at.frame_height, q.height);
  at.slices |= slice;
}

// How the frame's ground lies off the plane: offset and tilt about the camera's foot, so that they
// hardly mix.
class DriftFit {
 public:
  void add(const PointSorter::Point& q, const Vec3f& camera_M) noexcept {
    const Vec3 j(1, static_cast<double>(q.p_M.x() - camera_M.x()),
                 static_cast<double>(q.p_M.y() - camera_M.y()));
    normal_ += j * j.transpose();
    rhs_ += static_cast<double>(q.height) * j;
  }
  // Follows slow drift of the tracking: a twentieth of the way to this frame's ground, tilt damped.
  void follow(const Vec3& camera_M, Vec3& correction) noexcept {
    if (!(normal_(0, 0) > 100)) return;
    const double n = normal_(0, 0);
    normal_.diagonal() += n * Vec3(0, 0.5, 0.5);
    const Vec3 delta = 0.05 * normal_.ldlt().solve(rhs_);
    if (!delta.allFinite()) return;
    correction.x() += delta.x() - delta.y() * camera_M.x() - delta.z() * camera_M.y();
    correction.y() += delta.y();
    correction.z() += delta.z();
  }

 private:
  Eigen::Matrix3d normal_ = Eigen::Matrix3d::Zero();
  Vec3 rhs_ = Vec3::Zero();
};

}  // namespace

void GroundMap::touch(std::size_t cell) noexcept {
  Cell& c = cells_[cell];
  if (c.obstacle_area == 0 && c.ground_points == 0) {
    touched_[touched_count_++] = static_cast<std::uint32_t>(cell);
    c.frame_height = -std::numeric_limits<float>::infinity();
  }
}

// Counts each pixel's point in its cell. Also the cells between it and the point above it in the
// image (`bridge`), when both are of one kind and, for an obstacle, of one height: rows of a
// grazing surface lie farther apart than cells.
void GroundMap::collect(const GroundFrame& frame) noexcept {
  const Intrinsics& k = frame.intrinsics;
  const Pose X_MC = X_MW_ * frame.X_WC;
  const auto cell = static_cast<float>(config_.resolution_m),
             inv_cell = static_cast<float>(1 / config_.resolution_m);
  const auto range = static_cast<float>(config_.range_m);
  const auto bridge2 = static_cast<float>(config_.bridge_m * config_.bridge_m);
  const auto limit = static_cast<float>(config_.cells);
  const int width = std::min(k.width, static_cast<int>(row_kind_.size()));
  // A pixel at depth z stands for (z / f)^2 of surface that faces the camera.
  const float area_per_z2 = 256.0F * inv_cell * inv_cell / static_cast<float>(k.fx * k.fy);
  PointSorter sorter(config_, k, X_MC, correction_);
  DriftFit drift;
  std::uint64_t steps = 0;

  const auto count = [&](float x, float y, const PointSorter::Point& q, float area) {
    const float cx = x * inv_cell, cy = y * inv_cell;
    if (!(cx >= 0 && cy >= 0 && cx < limit && cy < limit)) return;
    const auto i =
        static_cast<std::size_t>(static_cast<int>(cy) * config_.cells + static_cast<int>(cx));
    touch(i);
    count_point(q, area, q.kind == kObstacle ? slice_of(q.height) : 0U, cells_[i]);
  };
  const auto bridge = [&](std::size_t i, const PointSorter::Point& q, float area) {
    const float dx = row_x_[i] - q.p_M.x(), dy = row_y_[i] - q.p_M.y(), d2 = dx * dx + dy * dy;
    if (row_kind_[i] != q.kind || !(std::abs(row_h_[i] - q.height) <= q.gate)) return;
    if (!(d2 > cell * cell && d2 <= bridge2)) return;
    const int n = static_cast<int>(std::sqrt(d2) * inv_cell * 1.5F) + 1;
    for (int s = 1; s < n; ++s) {
      const float f = static_cast<float>(s) / static_cast<float>(n);
      count(q.p_M.x() + f * dx, q.p_M.y() + f * dy, q, area);
    }
    steps += static_cast<std::uint64_t>(n);
  };

  std::fill(row_kind_.begin(), row_kind_.end(), kNeither);
  for (int v = 0; v < k.height; ++v) {
    const float* z_row = frame.depth_m.row(v);
    sorter.begin_row(v);
    for (int u = 0; u < width; ++u) {
      const auto i = static_cast<std::size_t>(u);
      const float z = z_row[u];
      if (!(z > 0 && z <= range)) {
        row_kind_[i] = kNeither;
        continue;
      }
      const PointSorter::Point q = sorter.sort(u, z);
      if (q.kind != kNeither) {
        count(q.p_M.x(), q.p_M.y(), q, area_per_z2 * z * z);
        bridge(i, q, area_per_z2 * z * z);
      }
      if (q.kind == kGround && ((u ^ v) & 3) == 0) drift.add(q, sorter.camera_M());
      row_x_[i] = q.p_M.x(), row_y_[i] = q.p_M.y();
      row_h_[i] = q.height;
      row_kind_[i] = q.kind;
    }
  }
  work_ += static_cast<std::uint64_t>(k.width) * static_cast<std::uint64_t>(k.height) + steps;
  drift.follow(X_MC.translation(), correction_);
}

}  // namespace perception
