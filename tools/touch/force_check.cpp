#include "tools/touch/force_check.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "perception/geometry/pose.hpp"
#include "perception/tsdf/blocks/map_reader.hpp"
#include "rt/quantile.hpp"

namespace teletact {

namespace {

using perception::Vec3;

constexpr double kPlaneCosine = 0.985;  // normals within 10 degrees

Vec3 vec(const std::array<float, 3>& v) {
  return {static_cast<double>(v[0]), static_cast<double>(v[1]), static_cast<double>(v[2])};
}

// Distance from h along n to the first place where the field turns from inside to outside; -1: none
// within `reach`.
double depth_to_surface(perception::MapReader& reader, double voxel_size, const Vec3& h,
                        const Vec3& n, double reach) {
  const double step = 0.05 * voxel_size;
  bool inside = false;
  float before = 0;
  for (double s = 0; s < reach; s += step) {
    const Vec3 p = (h + s * n) / voxel_size;
    const auto cell = reader.cell(p.x(), p.y(), p.z());
    if (!cell.valid) {
      inside = false;  // deeper than the band: the march comes out of it further on
      continue;
    }
    const float value = cell.value();
    if (value <= 0) {
      inside = true;
      before = value;
    } else {
      if (!inside) return -1;
      return s - step * static_cast<double>(value / (value - before));
    }
  }
  return -1;
}

// Unit normal of the field at p by differences over `h` to each side; false where it is unknown.
bool map_normal(perception::MapReader& reader, double voxel_size, const Vec3& p, double h,
                Vec3& n) {
  for (int axis = 0; axis < 3; ++axis) {
    double side[2];
    for (int i = 0; i < 2; ++i) {
      Vec3 q = p;
      q[axis] += i == 0 ? -h : h;
      q /= voxel_size;
      const auto cell = reader.cell(q.x(), q.y(), q.z());
      if (!cell.valid) return false;
      side[i] = static_cast<double>(cell.value());
    }
    n[axis] = side[1] - side[0];
  }
  const double length = n.norm();
  if (!(length > 0)) return false;
  n /= length;
  return true;
}

// Depth of h below a plane of the map, along the map's own normal where that leaves the surface;
// the force only says where to look first. -1: no surface, or not a plane for 30 mm around.
double depth_under_plane(perception::MapReader& reader, double voxel_size, const Vec3& h,
                         const Vec3& towards) {
  const double difference = 1.5 * voxel_size;
  Vec3 n = towards;
  for (int i = 0; i < 3; ++i) {
    const double s = depth_to_surface(reader, voxel_size, h, n, 0.15);
    if (s <= 0 || !map_normal(reader, voxel_size, h + s * n, difference, n)) return -1;
  }
  const double depth = depth_to_surface(reader, voxel_size, h, n, 0.15);
  if (depth <= 0) return -1;
  const Vec3 foot = h + depth * n;
  const Vec3 u = n.unitOrthogonal(), v = n.cross(u);
  for (const Vec3& to : {u, v, Vec3(-u), Vec3(-v)}) {
    Vec3 there;
    if (!map_normal(reader, voxel_size, foot + 0.03 * to, difference, there)) return -1;
    if (there.dot(n) < kPlaneCosine) return -1;
  }
  return depth;
}

}  // namespace

void ForceChecker::look(const perception::TsdfMap& map,
                        const std::vector<tasks::HapticSample>& samples) {
  perception::MapReader reader(map, 2.0);  // observed = weight >= 2, as the patch has it
  auto next = samples.begin();
  if (before_) {
    next = std::upper_bound(next, samples.end(), before_->stamp,
                            [](rt::Time t, const auto& s) { return t < s.stamp; });
  }
  for (; next != samples.end() && errors_.size() < kMost; ++next) {
    const auto& s = *next;
    const auto before = std::exchange(before_, s);
    if (!before) continue;
    const double speed = (vec(s.p_WH) - vec(before->p_WH)).norm() * 1e3;
    if (s.contacts != 1 || s.force_N < 1.0F || s.gain < 1.0F || s.guard_active || speed > 0.005)
      continue;
    const Vec3 f = vec(s.f_W);
    const double depth = depth_under_plane(reader, map.voxel_size(), vec(s.p_WH), f.normalized());
    if (depth <= 0) continue;
    const double expected = stiffness_N_per_m_ * depth / scale_;
    errors_.push_back(std::abs(f.norm() - expected) / expected);
  }
}

ForceCheck ForceChecker::result() const {
  ForceCheck out;
  out.samples = errors_.size();
  if (!errors_.empty()) out.relative_error_p95 = rt::quantile(errors_, 0.95);
  return out;
}

ForceCheck check_force(const perception::TsdfMap& map,
                       const std::vector<tasks::HapticSample>& samples, double stiffness_N_per_m,
                       double scale, rt::Time since) {
  ForceChecker checker(stiffness_N_per_m, scale);
  const auto first = std::find_if(samples.begin(), samples.end(),
                                  [&](const tasks::HapticSample& s) { return s.stamp >= since; });
  checker.look(map, {first, samples.end()});
  return checker.result();
}

}  // namespace teletact
