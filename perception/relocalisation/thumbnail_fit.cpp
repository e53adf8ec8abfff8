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

// First along rows, then down columns: three comparisons each for what would be nine.
void fill_spans(const std::array<Vec3f, Thumbnail::kCells>& point, CellSpans& out) noexcept {
  constexpr float kFar = std::numeric_limits<float>::infinity();
  CellSpans row;
  std::array<float, Thumbnail::kCells> z, z_or_far;
  std::array<std::int32_t, Thumbnail::kCells> is;
  for (std::size_t c = 0; c < z.size(); ++c) {
    const float d = point[c].z();
    z[c] = d > 0 ? d : 0.0F;
    z_or_far[c] = d > 0 ? d : kFar;
    is[c] = d > 0 ? 1 : 0;
  }
  const auto least = [](float a, float b) { return a < b ? a : b; };
  const auto most = [](float a, float b) { return a > b ? a : b; };
  // The ends of a row take a cell of the next one: those are no inner cells and not asked for.
  for (std::size_t c = 1; c + 1 < z.size(); ++c) {
    row.nearest[c] = least(least(z_or_far[c - 1], z_or_far[c]), z_or_far[c + 1]);
    row.farthest[c] = most(most(z[c - 1], z[c]), z[c + 1]);
    row.known[c] = is[c - 1] + is[c] + is[c + 1];
  }
  constexpr std::size_t kDown = kW;
  for (std::size_t c = kDown + 1; c + kDown + 1 < z.size(); ++c) {
    out.nearest[c] = least(least(row.nearest[c - kDown], row.nearest[c]), row.nearest[c + kDown]);
    out.farthest[c] = most(most(row.farthest[c - kDown], row.farthest[c]), row.farthest[c + kDown]);
    out.known[c] = row.known[c - kDown] + row.known[c] + row.known[c + kDown];
  }
}

bool inner(int i, int j) noexcept { return i >= 1 && j >= 1 && i < kW - 1 && j < kH - 1; }

}  // namespace

void fill_cell_view(const DepthLevel& depth, CellView& out) noexcept {
  const Intrinsics& k = depth.intrinsics;
  out.count = 0;
  for (int j = 0; j < kH; ++j) {
    const int v = cell_to_pixel(j, kH, depth.depth.height());
    for (int i = 0; i < kW; ++i) {
      const int u = cell_to_pixel(i, kW, depth.depth.width());
      const float z = depth.depth.row(v)[u];
      Vec3f& p = out.point[at(i, j)];
      p.setZero();
      if (!(z > 0)) continue;
      p = k.unproject(u, v, static_cast<double>(z)).cast<float>();
      const Vec3f n(depth.nx.row(v)[u], depth.ny.row(v)[u], depth.nz.row(v)[u]);
      if ((i + j) % 2 != 0 || n.squaredNorm() < 0.5F) continue;  // a unit vector or zero
      const auto c = static_cast<std::size_t>(out.count++);
      out.at.x[c] = p.x(), out.at.y[c] = p.y(), out.at.z[c] = p.z();
      out.normal.x[c] = n.x(), out.normal.y[c] = n.y(), out.normal.z[c] = n.z();
    }
  }
  fill_spans(out.point, out.about);
}

struct ThumbnailAligner::Kept {
  std::array<Vec3f, Thumbnail::kCells> point;
};

struct ThumbnailAligner::Moved {
  CellView::Lanes at, normal;
  std::array<float, CellView::kMost> u, v;  // cells
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

// No branches, so that the compiler takes several cells at once.
void ThumbnailAligner::move(const CellView& seen, const Pose& X_KS, Moved& out) const noexcept {
  const Eigen::Matrix3f R = X_KS.linear().cast<float>();
  const Vec3f t = X_KS.translation().cast<float>();
  const float r00 = R(0, 0), r01 = R(0, 1), r02 = R(0, 2), tx = t.x();
  const float r10 = R(1, 0), r11 = R(1, 1), r12 = R(1, 2), ty = t.y();
  const float r20 = R(2, 0), r21 = R(2, 1), r22 = R(2, 2), tz = t.z();
  const float fx = static_cast<float>(cells_.fx), cx = static_cast<float>(cells_.cx);
  const float fy = static_cast<float>(cells_.fy), cy = static_cast<float>(cells_.cy);
  const auto count = static_cast<std::size_t>(seen.count);
  for (std::size_t c = 0; c < count; ++c) {
    const float x = seen.at.x[c], y = seen.at.y[c], z = seen.at.z[c];
    out.at.x[c] = r00 * x + r01 * y + r02 * z + tx;
    out.at.y[c] = r10 * x + r11 * y + r12 * z + ty;
    out.at.z[c] = r20 * x + r21 * y + r22 * z + tz;
    out.u[c] = fx * out.at.x[c] / out.at.z[c] + cx;
    out.v[c] = fy * out.at.y[c] / out.at.z[c] + cy;
  }
  for (std::size_t c = 0; c < count; ++c) {
    const float x = seen.normal.x[c], y = seen.normal.y[c], z = seen.normal.z[c];
    out.normal.x[c] = r00 * x + r01 * y + r02 * z;
    out.normal.y[c] = r10 * x + r11 * y + r12 * z;
    out.normal.z[c] = r20 * x + r21 * y + r22 * z;
  }
}

// Pairs of points on two surfaces: six derivatives, the distance and the weight of each; four at a
// time.
struct ThumbnailAligner::Pairs {
  alignas(16) std::array<std::array<float, CellView::kMost>, 7> row;
  alignas(16) std::array<float, CellView::kMost> weight;
  int count = 0;
  void add(const Vec3f& n, const Vec3f& a, float r) noexcept {
    const auto at = static_cast<std::size_t>(count++);
    for (std::size_t k = 0; k < 3; ++k) {
      row[k][at] = n[static_cast<int>(k)];
      row[k + 3][at] = a[static_cast<int>(k)];
    }
    row[6][at] = r;
    weight[at] = kSoft_m / (kSoft_m + std::fabs(r));
  }
  // Fills the last four up.
  void end() noexcept {
    for (auto at = static_cast<std::size_t>(count); at % 4 != 0; ++at) {
      for (auto& r : row) r[at] = 0;
      weight[at] = 0;
    }
  }
};

namespace {

// Column C of the normal equations, from the diagonal down, and its right side; four pairs at once.
template <std::size_t C, class Pairs>
void sum_column(const Pairs& pairs, Mat6d& H, Vec6d& g) noexcept {
  using Four = Eigen::Array4f;
  using Load = Eigen::Map<const Four, Eigen::Aligned16>;
  static_assert(CellView::kMost % 4 == 0);
  std::array<Four, 7 - C> sum;
  for (Four& s : sum) s.setZero();
  for (std::size_t n = 0; n < static_cast<std::size_t>(pairs.count); n += 4) {
    const Four weighed = Load(&pairs.weight[n]) * Load(&pairs.row[C][n]);
    for (std::size_t k = 0; k < sum.size(); ++k) sum[k] += weighed * Load(&pairs.row[C + k][n]);
  }
  for (std::size_t k = 0; k + 1 < sum.size(); ++k)
    H(static_cast<int>(C + k), C) = static_cast<double>(sum[k].sum());
  g(C) = static_cast<double>(sum.back().sum());
}

}  // namespace

// One step of ICP.
void ThumbnailAligner::refine(const CellView& seen, const Kept& kept, float gate_m,
                              Pose& X_KS) const noexcept {
  Moved moved;
  move(seen, X_KS, moved);
  Pairs pairs;
  for (std::size_t s = 0; s < static_cast<std::size_t>(seen.count); ++s) {
    const float u = moved.u[s], v = moved.v[s], z = moved.at.z[s];
    if (!(z > 0.1F && u > -0.5F && v > -0.5F && u < kW - 0.5F && v < kH - 0.5F)) continue;
    const Vec3f& m = kept.point[at(static_cast<int>(u + 0.5F), static_cast<int>(v + 0.5F))];
    if (!(m.z() > 0) || std::fabs(z - m.z()) > gate_m) continue;
    const Vec3f q(moved.at.x[s], moved.at.y[s], z);
    const Vec3f n(moved.normal.x[s], moved.normal.y[s], moved.normal.z[s]);
    pairs.add(n, q.cross(n), n.dot(q - m));
  }
  if (pairs.count < kLeastPairs) return;
  pairs.end();
  Mat6d A = Mat6d::Zero();
  Vec6d g;
  sum_column<0>(pairs, A, g);
  sum_column<1>(pairs, A, g);
  sum_column<2>(pairs, A, g);
  sum_column<3>(pairs, A, g);
  sum_column<4>(pairs, A, g);
  sum_column<5>(pairs, A, g);
  // A direction that the cells do not hold stays about where it is.
  A.diagonal().array() += 1e-3 * A.trace();
  const Vec6d xi = A.ldlt().solve(-g);
  if (!xi.allFinite()) return;
  X_KS = orthonormalised(exp_se3(xi) * X_KS);
}

ThumbnailFit ThumbnailAligner::judge(const CellView& seen, const Kept& kept,
                                     const Pose& X_KS) const noexcept {
  ThumbnailFit fit;
  fit.X_KS = X_KS;
  const Pose X_SK = X_KS.inverse();
  const Eigen::Matrix3f R_KS = X_KS.linear().cast<float>(), R_SK = X_SK.linear().cast<float>();
  const Vec3f t_KS = X_KS.translation().cast<float>(), t_SK = X_SK.translation().cast<float>();
  CellSpans about_kept;
  fill_spans(kept.point, about_kept);
  int live = 0, fell = 0, close = 0, met = 0, against = 0;
  for (std::size_t c = 0; c < seen.point.size(); ++c) {
    int i = 0, j = 0;
    if (const Vec3f& p = seen.point[c]; p.z() > 0) {
      ++live;
      const Vec3f q = R_KS * p + t_KS;
      if (cell_of(q, i, j) && inner(i, j) && about_kept.known[at(i, j)] >= kLeastAbout) {
        const float limit = kLimit_m + kLimitPerM * q.z();
        const float nearest = about_kept.nearest[at(i, j)] - limit;
        ++fell;
        ++met;
        against += q.z() < nearest ? 1 : 0;
        close += q.z() >= nearest && q.z() <= about_kept.farthest[at(i, j)] + limit ? 1 : 0;
      }
    }
    if (const Vec3f& m = kept.point[c]; m.z() > 0) {
      const Vec3f q = R_SK * m + t_SK;
      if (cell_of(q, i, j) && inner(i, j) && seen.about.known[at(i, j)] >= kLeastAbout) {
        ++met;
        against += q.z() < seen.about.nearest[at(i, j)] - (kLimit_m + kLimitPerM * q.z()) ? 1 : 0;
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
