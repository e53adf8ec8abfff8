#include "perception/relocalisation/thumbnail_fit.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include <Eigen/Cholesky>

namespace perception {

namespace {

constexpr int kW = Thumbnail::kWidth, kH = Thumbnail::kHeight;
constexpr int kLeastPairs = 60;
constexpr int kLeastAbout = 5;  // of 3 x 3 cells
constexpr float kSoft_m = 0.06F;
constexpr float kLimit_m = 0.06F, kLimitPerM = 0.03F;  // what alignment and the codes leave

using Vec6d = Eigen::Matrix<double, 6, 1>;
using Mat6d = Eigen::Matrix<double, 6, 6>;

constexpr std::size_t at(int i, int j) noexcept { return static_cast<std::size_t>(j * kW + i); }

// Of nine depths, those that are known.
struct About {
  float nearest = std::numeric_limits<float>::infinity(), farthest = 0;
  int known = 0;
  void add(float z) noexcept {
    if (!(z > 0)) return;
    nearest = std::min(nearest, z);
    farthest = std::max(farthest, z);
    ++known;
  }
};

template <class Points>
About about(const Points& points, int i, int j) noexcept {
  About a;
  for (int k = 0; k < 9; ++k) a.add(points[at(i + k % 3 - 1, j + k / 3 - 1)].z());
  return a;
}

bool inner(int i, int j) noexcept { return i >= 1 && j >= 1 && i < kW - 1 && j < kH - 1; }

}  // namespace

void fill_cell_view(const DepthLevel& depth, CellView& out) noexcept {
  const Intrinsics& k = depth.intrinsics;
  for (int j = 0; j < kH; ++j) {
    const int v = cell_to_pixel(j, kH, depth.depth.height());
    for (int i = 0; i < kW; ++i) {
      const int u = cell_to_pixel(i, kW, depth.depth.width());
      const float z = depth.depth.row(v)[u];
      Vec3f &p = out.point[at(i, j)], &n = out.normal[at(i, j)];
      p.setZero();
      n.setZero();
      if (!(z > 0)) continue;
      p = k.unproject(u, v, static_cast<double>(z)).cast<float>();
      n = {depth.nx.row(v)[u], depth.ny.row(v)[u], depth.nz.row(v)[u]};
    }
  }
}

struct ThumbnailAligner::Kept {
  std::array<Vec3f, Thumbnail::kCells> point;
};

ThumbnailAligner::ThumbnailAligner(const Intrinsics& camera) noexcept {
  const double sx = static_cast<double>(kW) / camera.width;
  const double sy = static_cast<double>(kH) / camera.height;
  cells_ = {camera.fx * sx, camera.fy * sy, camera.cx * sx - 0.5, camera.cy * sy - 0.5, kW, kH};
  // The pixels of the coarsest level at the full size, see make_thumbnail().
  constexpr int kStep = 1 << (TrackingPyramid::kLevels - 1);
  const Intrinsics coarse = camera.subsampled(kStep);
  for (int i = 0; i < kW; ++i) {
    const int u = cell_to_pixel(i, kW, coarse.width);
    ray_x_[static_cast<std::size_t>(i)] = static_cast<float>((u - coarse.cx) / coarse.fx);
  }
  for (int j = 0; j < kH; ++j) {
    const int v = cell_to_pixel(j, kH, coarse.height);
    ray_y_[static_cast<std::size_t>(j)] = static_cast<float>((v - coarse.cy) / coarse.fy);
  }
  for (std::size_t c = 1; c < depth_m_.size(); ++c) {
    depth_m_[c] = static_cast<float>(thumbnail_depth(static_cast<std::uint8_t>(c)));
  }
}

inline bool ThumbnailAligner::cell_of(const Vec3f& p, int& i, int& j) const noexcept {
  if (!(p.z() > 0.1F)) return false;
  const float u = static_cast<float>(cells_.fx) * p.x() / p.z() + static_cast<float>(cells_.cx);
  const float v = static_cast<float>(cells_.fy) * p.y() / p.z() + static_cast<float>(cells_.cy);
  if (!(u > -0.5F && v > -0.5F && u < kW - 0.5F && v < kH - 0.5F)) return false;
  i = static_cast<int>(u + 0.5F);
  j = static_cast<int>(v + 0.5F);
  return true;
}

// One step of ICP; every second cell, in a chequered pattern.
void ThumbnailAligner::refine(const CellView& seen, const Kept& kept, float gate_m,
                              Pose& X_KS) const noexcept {
  const Eigen::Matrix3f R = X_KS.linear().cast<float>();
  const Vec3f t = X_KS.translation().cast<float>();
  Eigen::Matrix<float, 6, 6> H = Eigen::Matrix<float, 6, 6>::Zero();
  Eigen::Matrix<float, 6, 1> g = Eigen::Matrix<float, 6, 1>::Zero();
  std::array<float, 27> sums{};
  float weighed[6];
  int pairs = 0;
  for (int j = 0; j < kH; ++j) {
    for (int i = j & 1; i < kW; i += 2) {
      const Vec3f& p = seen.point[at(i, j)];
      const Vec3f& n_S = seen.normal[at(i, j)];
      if (!(p.z() > 0) || n_S.squaredNorm() < 0.5F) continue;  // a unit vector or zero
      const Vec3f q = R * p + t;
      int a = 0, b = 0;
      if (!cell_of(q, a, b)) continue;
      const Vec3f& m = kept.point[at(a, b)];
      if (!(m.z() > 0) || std::fabs(q.z() - m.z()) > gate_m) continue;
      const Vec3f n = R * n_S;
      const float r = n.dot(q - m);
      const float soft = kSoft_m / (kSoft_m + std::fabs(r));
      Eigen::Matrix<float, 6, 1> J;
      J.head<3>() = n;
      J.tail<3>() = q.cross(n);
      // Of H the half that ldlt() reads, column by column.
      for (int c = 0; c < 6; ++c) weighed[c] = soft * J(c);
      float* h = sums.data();
#pragma GCC unroll 6
      for (int c = 0; c < 6; ++c)
#pragma GCC unroll 6
        for (int k = c; k < 6; ++k) *h++ += weighed[k] * J(c);
#pragma GCC unroll 6
      for (int k = 0; k < 6; ++k) *h++ += (soft * r) * J(k);
      ++pairs;
    }
  }
  if (pairs < kLeastPairs) return;
  const float* h = sums.data();
  for (int c = 0; c < 6; ++c)
    for (int k = c; k < 6; ++k) H(k, c) = *h++;
  for (int k = 0; k < 6; ++k) g(k) = *h++;
  // A direction that the cells do not hold stays about where it is.
  Mat6d A = H.cast<double>();
  A.diagonal().array() += 1e-3 * A.trace();
  const Vec6d xi = A.ldlt().solve(-g.cast<double>());
  if (!xi.allFinite()) return;
  X_KS = orthonormalised(exp_se3(xi) * X_KS);
}

ThumbnailFit ThumbnailAligner::judge(const CellView& seen, const Kept& kept,
                                     const Pose& X_KS) const noexcept {
  ThumbnailFit fit;
  fit.X_KS = X_KS;
  const Pose X_SK = X_KS.inverse();
  int live = 0, fell = 0, close = 0, met = 0, against = 0;
  for (std::size_t c = 0; c < seen.point.size(); ++c) {
    const Vec3f& p = seen.point[c];
    if (p.z() > 0) {
      ++live;
      const Vec3f q = X_KS.linear().cast<float>() * p + X_KS.translation().cast<float>();
      int i = 0, j = 0;
      if (cell_of(q, i, j) && inner(i, j)) {
        const About a = about(kept.point, i, j);
        if (a.known >= kLeastAbout) {
          const float limit = kLimit_m + kLimitPerM * q.z();
          ++fell;
          ++met;
          against += q.z() < a.nearest - limit ? 1 : 0;
          close += q.z() >= a.nearest - limit && q.z() <= a.farthest + limit ? 1 : 0;
        }
      }
    }
    const Vec3f& m = kept.point[c];
    if (m.z() > 0) {
      const Vec3f q = X_SK.linear().cast<float>() * m + X_SK.translation().cast<float>();
      int i = 0, j = 0;
      if (cell_of(q, i, j) && inner(i, j)) {
        const About a = about(seen.point, i, j);
        if (a.known >= kLeastAbout) {
          ++met;
          against += q.z() < a.nearest - (kLimit_m + kLimitPerM * q.z()) ? 1 : 0;
        }
      }
    }
  }
  if (fell == 0) return fit;
  fit.overlap = static_cast<double>(fell) / live;
  fit.close = static_cast<double>(close) / fell;
  fit.against = static_cast<double>(against) / met;
  return fit;
}

ThumbnailFit ThumbnailAligner::align(const CellView& seen, const Thumbnail& kept,
                                     const Pose& X_KS0) const noexcept {
  Kept k;
  for (int j = 0; j < kH; ++j) {
    for (int i = 0; i < kW; ++i) {
      const float z = depth_m_[kept.depth[at(i, j)]];
      k.point[at(i, j)] = {z * ray_x_[static_cast<std::size_t>(i)],
                           z * ray_y_[static_cast<std::size_t>(j)], z};
    }
  }
  Pose X_KS = X_KS0;
  for (int n = 0; n < kIterations; ++n) {
    // From what a keyframe's distance can make of a depth, down to what the codes leave.
    const float gate = 0.6F - 0.45F * static_cast<float>(n) / (kIterations - 1);
    refine(seen, k, gate, X_KS);
  }
  return judge(seen, k, X_KS);
}

}  // namespace perception
