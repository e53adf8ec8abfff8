#include "perception/raycast/sparse_cast.hpp"

#include <cmath>
#include <cstddef>
#include <initializer_list>

namespace perception {

namespace {

constexpr float kInFull = 0, kNothing = -1;  // hints
constexpr float kLeastCos = 0.8F;            // between the normals of one surface

// Do b and a lie on one surface: in each other's tangent planes, by less than reach_m?
bool on_one_surface(const Vec3f& p_a, const Vec3f& n_a, const Vec3f& p_b, const Vec3f& n_b,
                    float reach_m) noexcept {
  const Vec3f way = p_b - p_a;
  return n_a.dot(n_b) > kLeastCos && std::fabs(n_a.dot(way)) < reach_m &&
         std::fabs(n_b.dot(way)) < reach_m;
}

struct At {
  int u, v;
};

// Of a ray in the middle of these: 1/depth is linear in the image of a plane.
float hint_between(const RaycastMaps& m, std::initializer_list<At> about, float reach_m) noexcept {
  const At a = *about.begin();
  const bool hit = m.hit(a.u, a.v);
  const Vec3f p_a = m.vertex_C(a.u, a.v), n_a = m.normal_C(a.u, a.v);
  float inverse = 0;
  for (const At& b : about) {
    if (m.hit(b.u, b.v) != hit) return kInFull;
    if (!hit) continue;
    inverse += 1.0F / m.at(b.u, b.v)[3];
    if (&b != about.begin() &&
        !on_one_surface(p_a, n_a, m.vertex_C(b.u, b.v), m.normal_C(b.u, b.v), reach_m))
      return kInFull;
  }
  return hit ? static_cast<float>(about.size()) / inverse : kNothing;
}

}  // namespace

SparseCast::SparseCast(rt::NonRealtime& nrt, int width, int height)
    : every_other_(nrt, (width + 1) / 2, (height + 1) / 2),
      hint_m_(static_cast<std::size_t>(width) * static_cast<std::size_t>(height)) {}

void SparseCast::fill_hints(const Intrinsics& k, float reach_m) noexcept {
  const RaycastMaps& m = every_other_;
  for (int v = 0; v < k.height; ++v) {
    float* const row = hint_m_.data() + static_cast<std::ptrdiff_t>(v) * k.width;
    const int v0 = v / 2, v1 = (v + 1) / 2;
    for (int u = 0; u < k.width; ++u) {
      const int u0 = u / 2, u1 = (u + 1) / 2;
      if (u1 >= m.width() || v1 >= m.height()) {
        row[u] = kInFull;
      } else if (u0 == u1 && v0 == v1) {
        row[u] = m.hit(u0, v0) ? m.at(u0, v0)[3] : kNothing;
      } else if (u0 == u1) {
        row[u] = hint_between(m, {{u0, v0}, {u0, v1}}, reach_m);
      } else if (v0 == v1) {
        row[u] = hint_between(m, {{u0, v0}, {u1, v0}}, reach_m);
      } else {
        row[u] = hint_between(m, {{u0, v0}, {u1, v1}, {u1, v0}, {u0, v1}}, reach_m);
      }
    }
  }
}

RaycastStats SparseCast::cast(const MapView& map, const Intrinsics& camera, const Pose& X_WC,
                              const RaycastOptions& options, RaycastMaps& out) noexcept {
  out.intrinsics = {};
  if (!camera.valid() || options.pixel_step < 1) return {};
  const Intrinsics k = camera.subsampled(options.pixel_step);
  const std::size_t rays = static_cast<std::size_t>(k.width) * static_cast<std::size_t>(k.height);
  if (rays > hint_m_.size()) return {};
  RaycastOptions o = options;
  o.hint_depth_m = {};
  o.hinted_only = o.colour = o.labels = false;
  o.pixel_step = 2 * options.pixel_step;
  const RaycastStats first = raycast(map, camera, X_WC, o, every_other_);
  if (first.rays == 0) return {};
  fill_hints(k, static_cast<float>(map.truncation()));
  o.hint_depth_m = {hint_m_.data(), k.width, k.height, k.width};
  o.pixel_step = options.pixel_step;
  RaycastStats stats = raycast(map, camera, X_WC, o, out);
  stats.steps += first.steps;
  return stats;
}

}  // namespace perception
