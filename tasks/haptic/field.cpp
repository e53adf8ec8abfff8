#include "tasks/haptic/field.hpp"

#include <algorithm>
#include <cmath>

namespace tasks {

using perception::SurfacePatch;
using perception::Vec3;

namespace {

struct Node {
  bool known;
  double value;
};

bool inside(const SurfacePatch& patch, std::int32_t x, std::int32_t y, std::int32_t z) noexcept {
  const auto n = static_cast<std::uint32_t>(patch.nodes);
  return static_cast<std::uint32_t>(x) < n && static_cast<std::uint32_t>(y) < n &&
         static_cast<std::uint32_t>(z) < n;
}

// A node seen free that has no distance (yet): at most one voxel more than its nearest neighbours
// with one, since a surface next to it must not be pushed away by a whole truncation; never solid.
double free_value(const SurfacePatch& patch, std::int32_t x, std::int32_t y,
                  std::int32_t z) noexcept {
  const auto unit = static_cast<double>(patch.metres_per_unit);
  double least = static_cast<double>(patch.truncation());
  constexpr int kSides[6][3] = {{-1, 0, 0}, {1, 0, 0},  {0, -1, 0},
                                {0, 1, 0},  {0, 0, -1}, {0, 0, 1}};
  for (const auto& side : kSides) {
    const std::int32_t nx = x + side[0], ny = y + side[1], nz = z + side[2];
    if (!inside(patch, nx, ny, nz)) continue;
    const std::size_t i = patch.index(nx, ny, nz);
    if (patch.material[i] == 0) continue;
    least = std::min(least, static_cast<double>(patch.distance[i]) * unit + patch.voxel_size);
  }
  return std::max(least, 0.5 * patch.voxel_size);
}

// The node at world grid index (x, y, z) as one window has it.
Node node_of(const SurfacePatch& patch, std::int32_t x, std::int32_t y, std::int32_t z) noexcept {
  const std::int32_t lx = x - patch.origin_node[0], ly = y - patch.origin_node[1],
                     lz = z - patch.origin_node[2];
  if (!inside(patch, lx, ly, lz)) return {false, 0};
  const std::size_t i = patch.index(lx, ly, lz);
  if (patch.material[i] != 0) {
    return {true,
            static_cast<double>(patch.distance[i]) * static_cast<double>(patch.metres_per_unit)};
  }
  if (patch.free_at(i)) return {true, free_value(patch, lx, ly, lz)};
  return {false, 0};
}

}  // namespace

void Field::set(const SurfacePatch* older, const SurfacePatch* newer, double s) noexcept {
  older_ = older;
  newer_ = newer;
  s_ = older == nullptr ? 1.0 : s;
  if (newer != nullptr) {
    voxel_ = newer->voxel_size;
    inverse_voxel_ = 1.0 / voxel_;
    truncation_ = static_cast<double>(newer->truncation());
  }
  forget();
}

void Field::forget() const noexcept {
  for (Cell& c : cache_) c.x = INT32_MIN;
}

void Field::fill(Cell& cell) const noexcept {
  std::array<double, 8> v;
  for (int b = 0; b < 8; ++b) {
    const std::int32_t x = cell.x + (b >> 2), y = cell.y + ((b >> 1) & 1), z = cell.z + (b & 1);
    Node n = node_of(*newer_, x, y, z);
    if (older_ != nullptr) {
      const Node o = node_of(*older_, x, y, z);
      if (!n.known) {
        n = o;
      } else if (o.known) {
        n.value = (1.0 - s_) * o.value + s_ * n.value;
      }
    }
    if (!n.known) {
      cell.known = false;
      return;
    }
    v[static_cast<std::size_t>(b)] = n.value;
  }
  // Node values to polynomial coefficients, one axis at a time.
  for (const std::size_t bit : {1U, 2U, 4U}) {
    for (std::size_t b = 0; b < 8; ++b) {
      if ((b & bit) != 0) v[b] -= v[b ^ bit];
    }
  }
  cell.c = v;
  cell.known = true;
}

const Field::Cell& Field::cell(std::int32_t x, std::int32_t y, std::int32_t z) const noexcept {
  Cell& c = cache_[static_cast<std::size_t>(((x & 1) << 2) | ((y & 1) << 1) | (z & 1))];
  if (c.x != x || c.y != y || c.z != z) {
    c.x = x;
    c.y = y;
    c.z = z;
    fill(c);
  }
  return c;
}

FieldSample Field::sample(const Vec3& p_W) const noexcept {
  ++work_;
  FieldSample out;
  if (newer_ == nullptr) return out;
  const double gx = p_W.x() * inverse_voxel_, gy = p_W.y() * inverse_voxel_,
               gz = p_W.z() * inverse_voxel_;
  // Written so that NaN fails: nothing outside the range is turned into an integer.
  constexpr double kRange = 1e9;
  if (!(std::abs(gx) < kRange && std::abs(gy) < kRange && std::abs(gz) < kRange)) return out;
  const double fx = std::floor(gx), fy = std::floor(gy), fz = std::floor(gz);
  const Cell& k = cell(static_cast<std::int32_t>(fx), static_cast<std::int32_t>(fy),
                       static_cast<std::int32_t>(fz));
  if (!k.known) return out;
  const double u = gx - fx, v = gy - fy, w = gz - fz;
  const auto& c = k.c;
  // value = (c0 + c1 w + c2 v + c3 v w) + u (c4 + c5 w + c6 v + c7 v w)
  const double a = c[0] + c[1] * w + v * (c[2] + c[3] * w);
  const double b = c[4] + c[5] * w + v * (c[6] + c[7] * w);
  out.known = true;
  out.value = a + u * b;
  out.gradient = inverse_voxel_ * Vec3(b, c[2] + c[3] * w + u * (c[6] + c[7] * w),
                                       c[1] + c[3] * v + u * (c[5] + c[7] * v));
  return out;
}

bool Field::sample_in(const std::array<std::int32_t, 3>& at, const Vec3& u,
                      CellSample& out) const noexcept {
  ++work_;
  const Cell& k = cell(at[0], at[1], at[2]);
  if (!k.known) return false;
  const auto& c = k.c;
  const double x = u.x(), y = u.y(), z = u.z();
  const double xy = c[6] + c[7] * z, a = c[0] + c[1] * z + y * (c[2] + c[3] * z);
  const double b = c[4] + c[5] * z + y * xy;
  out.value = inverse_voxel_ * (a + x * b);
  out.gradient =
      inverse_voxel_ * Vec3(b, c[2] + c[3] * z + x * xy, c[1] + c[3] * y + x * (c[5] + c[7] * y));
  out.bend = inverse_voxel_ * Vec3(c[3] + c[7] * x, c[5] + c[7] * y, xy);
  return true;
}

Vec3 Field::smooth_gradient(const Vec3& p_W, double half_step_vox) const noexcept {
  const FieldSample here = sample(p_W);
  if (!here.known) return Vec3::Zero();
  Vec3 g = here.gradient;
  const double half = half_step_vox * voxel_;
  for (int axis = 0; axis < 3; ++axis) {
    Vec3 step = Vec3::Zero();
    step[axis] = half;
    const FieldSample ahead = sample(p_W + step), behind = sample(p_W - step);
    if (ahead.known && behind.known) g[axis] = (ahead.value - behind.value) / (2 * half);
  }
  return g;
}

bool Field::near_edge(const Vec3& p_W, double voxels) const noexcept {
  if (newer_ == nullptr) return true;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const double i = p_W[static_cast<Eigen::Index>(axis)] * inverse_voxel_ -
                     static_cast<double>(newer_->origin_node[axis]);
    if (!(i >= voxels && i <= static_cast<double>(newer_->nodes - 1) - voxels)) return true;
  }
  return false;
}

}  // namespace tasks
