#include "tools/measure/stability/ray_cast.hpp"

#include <cmath>
#include <cstring>
#include <memory>
#include <numbers>

#include "tools/touch/field_window.hpp"
#include "tools/touch/view_cast.hpp"

namespace stability {

using rig::Vec3;

namespace {

constexpr double kVoxel_m = 0.01, kDistance_m = 1.0;
constexpr int kHalf = 13;  // voxels of the field to either side of the middle

bool sees_the_middle(const std::function<double(const Vec3&)>& solid, const Vec3& way) {
  for (double s = 0.05; s <= kDistance_m; s += 0.01) {
    if (solid(s * way) <= 0) return false;
  }
  return true;
}

Vec3 way_to_eye(const std::function<double(const Vec3&)>& solid, const Vec3& lean) {
  for (const double degrees : {45.0, 20.0}) {
    const double angle = degrees * std::numbers::pi / 180;
    Vec3 way = std::cos(angle) * Vec3::UnitZ() + std::sin(angle) * lean;
    if (sees_the_middle(solid, way)) return way;
  }
  return Vec3::UnitZ();
}

// The same bytes, NaN included.
bool same(const std::vector<float>& a, const std::vector<float>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(float)) == 0;
}

}  // namespace

std::function<bool(const rig::Scene::Node&, tasks::SurfacePoints&)> ray_cast_of(
    const rig::Pose& X_WS, const std::function<double(const Vec3&)>& solid, const Vec3& lean) {
  const Vec3 middle = X_WS.translation();
  const Eigen::Array3i first = (middle / kVoxel_m).array().round().cast<int>() - kHalf;
  const Vec3 origin = kVoxel_m * first.cast<double>().matrix();
  teletact::View view;
  view.eye = X_WS * Vec3(kDistance_m * way_to_eye(solid, lean)) - origin;
  view.look = middle - origin;
  const auto field = std::make_shared<teletact::DenseField>();
  field->size = {2 * kHalf + 1, 2 * kHalf + 1, 2 * kHalf + 1};
  return [=](const rig::Scene::Node& node, tasks::SurfacePoints& out) {
    std::vector<float> now;
    now.reserve(field->distance.size());
    for (int x = 0; x < field->size[0]; ++x) {
      for (int y = 0; y < field->size[1]; ++y) {
        for (int z = 0; z < field->size[2]; ++z) {
          now.push_back(static_cast<float>(node(first.x() + x, first.y() + y, first.z() + z)));
        }
      }
    }
    if (same(now, field->distance)) return false;
    field->distance = std::move(now);
    (void)teletact::cast_view(*field, kVoxel_m, view, out);
    for (std::size_t i = 0; i < out.count; ++i) {  // of the field's own frame into W
      out.x[i] += static_cast<float>(origin.x());
      out.y[i] += static_cast<float>(origin.y());
      out.z[i] += static_cast<float>(origin.z());
    }
    return true;
  };
}

}  // namespace stability
