#include "tools/teletact/force_check.hpp"

#include <algorithm>
#include <cmath>

#include "perception/geometry/pose.hpp"
#include "perception/tsdf/map_reader.hpp"

namespace teletact {

namespace {

using perception::Vec3;

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

}  // namespace

ForceCheck check_force(const perception::TsdfMap& map,
                       const std::vector<tasks::HapticSample>& samples, double stiffness_N_per_m,
                       double scale) {
  perception::MapReader reader(map, 2.0);  // observed = weight >= 2, as the patch has it
  std::vector<double> errors;
  for (std::size_t i = 1; i < samples.size(); ++i) {
    const auto& s = samples[i];
    const double speed = (vec(s.p_WH) - vec(samples[i - 1].p_WH)).norm() * 1e3;
    if (s.contacts != 1 || s.force_N < 1.0F || s.gain < 1.0F || s.guard_active || speed > 0.005)
      continue;
    const Vec3 f = vec(s.f_W);
    const double depth =
        depth_to_surface(reader, map.voxel_size(), vec(s.p_WH), f.normalized(), 0.15);
    if (depth <= 0) continue;
    const double expected = stiffness_N_per_m * depth / scale;
    errors.push_back(std::abs(f.norm() - expected) / expected);
  }
  ForceCheck out;
  out.samples = errors.size();
  if (errors.empty()) return out;
  const auto at = static_cast<std::ptrdiff_t>(0.95 * static_cast<double>(errors.size() - 1));
  std::nth_element(errors.begin(), errors.begin() + at, errors.end());
  out.relative_error_p95 = errors[static_cast<std::size_t>(at)];
  return out;
}

}  // namespace teletact
