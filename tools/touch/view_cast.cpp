#include "tools/touch/view_cast.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace teletact {

using perception::Vec3;

namespace {

Vec3 field_normal(const DenseField& field, double voxel, const Vec3& p) {
  Vec3 g = Vec3::Zero();
  const double here = field_value(field, voxel, p);
  for (int a = 0; a < 3; ++a) {
    Vec3 step = Vec3::Zero();
    step[a] = voxel;
    const double ahead = field_value(field, voxel, p + step),
                 behind = field_value(field, voxel, p - step);
    if (!std::isnan(ahead) && !std::isnan(behind)) {
      g[a] = ahead - behind;
    } else if (!std::isnan(ahead)) {
      g[a] = 2 * (ahead - here);
    } else if (!std::isnan(behind)) {
      g[a] = 2 * (here - behind);
    }
  }
  const double size = g.norm();
  return size > 0 ? Vec3(g / size) : Vec3::Zero();
}

// Distances along the ray at which it is inside the box of the field.
bool clip(const DenseField& field, double voxel, const Vec3& eye, const Vec3& way, double& near,
          double& far) {
  near = 0;
  far = 1e6;
  for (std::size_t a = 0; a < 3; ++a) {
    const auto i = static_cast<Eigen::Index>(a);
    const double top = voxel * (field.size[a] - 1);
    if (std::abs(way[i]) < 1e-12) {
      if (eye[i] < 0 || eye[i] > top) return false;
      continue;
    }
    const double t0 = -eye[i] / way[i], t1 = (top - eye[i]) / way[i];
    near = std::max(near, std::min(t0, t1));
    far = std::min(far, std::max(t0, t1));
  }
  return near < far;
}

}  // namespace

double field_value(const DenseField& field, double voxel_size, const Vec3& p) {
  const Vec3 q = p / voxel_size;
  std::array<std::int64_t, 3> i{};
  Vec3 u;
  for (std::size_t a = 0; a < 3; ++a) {
    const auto k = static_cast<Eigen::Index>(a);
    const double last = field.size[a] - 1;
    if (!(q[k] >= -1e-9 && q[k] <= last + 1e-9)) return std::numeric_limits<double>::quiet_NaN();
    i[a] =
        std::clamp<std::int64_t>(static_cast<std::int64_t>(std::floor(q[k])), 0, field.size[a] - 2);
    u[k] = q[k] - static_cast<double>(i[a]);
  }
  double sum = 0;
  for (int c = 0; c < 8; ++c) {
    const int b[3] = {c >> 2, (c >> 1) & 1, c & 1};
    double w = 1;
    for (int a = 0; a < 3; ++a) w *= b[a] != 0 ? u[a] : 1 - u[a];
    const auto at = static_cast<std::size_t>(
        ((i[0] + b[0]) * field.size[1] + i[1] + b[1]) * field.size[2] + i[2] + b[2]);
    sum += w * static_cast<double>(field.distance[at]);
  }
  return sum;
}

std::size_t cast_view(const DenseField& field, double voxel_size, const View& view,
                      tasks::SurfacePoints& out) {
  out.resize(static_cast<std::size_t>(view.width) * static_cast<std::size_t>(view.height));
  ++out.seq;
  const Vec3 ahead = (view.look - view.eye).normalized();
  const Vec3 up = std::abs(ahead.z()) < 0.99 ? Vec3::UnitZ() : Vec3::UnitX();
  const Vec3 right = ahead.cross(up).normalized(), down = ahead.cross(right);
  std::size_t met = 0;
  for (int v = 0; v < view.height; ++v) {
    for (int u = 0; u < view.width; ++u) {
      const Vec3 way = (ahead + ((u - 0.5 * (view.width - 1)) / view.f) * right +
                        ((v - 0.5 * (view.height - 1)) / view.f) * down)
                           .normalized();
      double near = 0, far = 0;
      if (!clip(field, voxel_size, view.eye, way, near, far)) continue;
      double before = std::numeric_limits<double>::quiet_NaN();
      for (double t = near; t <= far; t += 0.5 * voxel_size) {
        const double value = field_value(field, voxel_size, view.eye + t * way);
        if (before > 0 && value <= 0) {
          const double beyond = 0.5 * voxel_size * value / (value - before);
          const Vec3 p = view.eye + (t - beyond) * way;
          out.set(static_cast<std::size_t>(v) * static_cast<std::size_t>(view.width) +
                      static_cast<std::size_t>(u),
                  p, field_normal(field, voxel_size, p));
          ++met;
          break;
        }
        before = value;
      }
    }
  }
  return met;
}

std::optional<View> FirstContact::at(const DenseField& field, double voxel_size, const Vec3& p) {
  if (met_) return {};
  const double value = field_value(field, voxel_size, p);
  const bool contact = value <= 0 && !(before_ <= 0);
  before_ = value;
  if (!contact) return {};
  const Vec3 n = field_normal(field, voxel_size, p);
  if (!(n.norm() > 0)) return {};
  met_ = true;
  return View{.eye = p + n, .look = p};
}

}  // namespace teletact
