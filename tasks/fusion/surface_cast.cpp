#include "tasks/fusion/surface_cast.hpp"

namespace tasks {

SurfaceCast::SurfaceCast(rt::NonRealtime& nrt, const perception::Intrinsics& camera)
    : camera_(camera), maps_(nrt, camera.width, camera.height) {}

perception::RaycastStats SurfaceCast::cast(const perception::TsdfMap& map, double reach_m,
                                           rt::ForkJoin& crew, SurfacePoints& out) noexcept {
  const auto pixels =
      static_cast<std::size_t>(camera_.width) * static_cast<std::size_t>(camera_.height);
  if (!X_WC_ || out.x.size() < pixels) return {};
  perception::RaycastOptions o;
  o.min_weight = kObserved;
  o.max_depth_m = reach_m;
  o.crew = &crew;
  const perception::RaycastStats stats = perception::raycast(map, camera_, *X_WC_, o, maps_);
  if (stats.rays == 0) return stats;
  // In float: a point within 10 m is off by less than 2 um, and there are 217,088 of them.
  const Eigen::Matrix3f R = X_WC_->linear().cast<float>();
  const Eigen::Vector3f t = X_WC_->translation().cast<float>();
  std::size_t i = 0;
  for (int v = 0; v < maps_.height(); ++v) {
    for (int u = 0; u < maps_.width(); ++u, ++i) {
      if (!maps_.hit(u, v)) {
        out.x[i] = out.y[i] = out.z[i] = SurfacePoints::kFar;
        out.nx[i] = out.ny[i] = out.nz[i] = 0;
        continue;
      }
      const Eigen::Vector3f p = R * maps_.vertex_C(u, v) + t, n = R * maps_.normal_C(u, v);
      out.x[i] = p.x(), out.y[i] = p.y(), out.z[i] = p.z();
      out.nx[i] = n.x(), out.ny[i] = n.y(), out.nz[i] = n.z();
    }
  }
  out.count = pixels;
  out.X_WC = *X_WC_;
  out.seq = ++seq_;
  return stats;
}

}  // namespace tasks
