#include "tasks/haptic/surface_left.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace tasks {

namespace {

using perception::Vec3;

constexpr double kApart_vox = 2;  // points of a face, 3 x 3

struct Face {
  double rise_m = 0;     // median over its points
  bool unknown = false;  // its middle and most of it
};

// What the newer window, alone, has of the face about p_W: what only the older one knows is not
// there any more. Noise moves a node, not its neighbours with it. Leaves `field` with both windows,
// the older one's values.
Face face_ahead(Field& field, const perception::SurfacePatch* older,
                const perception::SurfacePatch* newer, const Vec3& p_W, const Vec3& gradient,
                double steep) noexcept {
  const Vec3 along = gradient.unitOrthogonal(), across = gradient.cross(along).normalized();
  std::array<Vec3, 9> points;
  std::array<FieldSample, 9> now;
  field.set(older, newer, 0);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const std::size_t row = i / 3;
    const double a = static_cast<double>(row) - 1, b = static_cast<double>(i % 3) - 1;
    points[i] = p_W + kApart_vox * field.voxel() * (a * along + b * across);
    now[i] = field.sample(points[i]);
  }
  std::array<double, 9> rises{};
  std::size_t known_now = 0, known_then = 0;
  bool middle_known = false;
  field.set(nullptr, newer, 1);
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (!now[i].known) continue;
    ++known_now;
    const FieldSample then = field.sample(points[i]);
    if (i == points.size() / 2) middle_known = then.known;
    if (then.known) rises[known_then++] = (now[i].value - then.value) / steep;
  }
  field.set(older, newer, 0);
  Face out;
  out.unknown = !middle_known && 2 * known_then < known_now;
  if (known_then == 0) return out;
  // Of an even number the upper of the two in the middle: rt::quantile() has the lower, and another
  // rise is another force.
  const auto middle = rises.begin() + static_cast<std::ptrdiff_t>(known_then / 2);
  std::nth_element(rises.begin(), middle, rises.begin() + static_cast<std::ptrdiff_t>(known_then));
  out.rise_m = *middle;
  return out;
}

}  // namespace

double SurfaceLeft::look_ahead_m(SurfaceBlend& blend, const ProxyState& proxy,
                                 const Held& held) noexcept {
  constexpr double kSlopeLeast = 0.3;  // flatter is a rounded crease or the edge of the band
  if (proxy.phase != ProxyState::Phase::kContact || leaving_) return 0;
  const Vec3 p_W = proxy.p_WP();
  Field& field = blend.field();
  field.set(blend.older(), blend.newest(), 1);
  const FieldSample then = field.sample(p_W);
  field.set(blend.older(), blend.newest(), 0);
  const FieldSample now = field.sample(p_W);
  if (!now.known) return 0;
  const double steep = std::max(now.gradient.norm(), kSlopeLeast);
  const double rise_m = then.known ? (now.value - then.value) / steep : 0;
  // A window that lags behind the hand says nothing: the last frame is held.
  if (field.near_edge(p_W) || field.near_edge(held.hand_W)) return rise_m;
  const Face face = face_ahead(field, blend.older(), blend.newest(), p_W, now.gradient, steep);
  const bool moves = blend.newest()->touched_moves;
  left_ = moves || face.unknown || std::abs(face.rise_m) > held.most_m;
  const Vec3 pull = held.rendered_W - held.hand_W;
  if (!(moves || face.unknown || face.rise_m > held.most_m) || !(pull.norm() > 1e-9)) return rise_m;
  leaving_ = true;
  n_W_ = pull.normalized();
  // No deeper than the force limit: the fade is felt from its beginning.
  p_W_ = held.hand_W + std::min(pull.norm(), held.deepest_m) * n_W_;
  return 0;
}

Spring SurfaceLeft::spring(const Vec3& p_WH) const noexcept {
  Spring spring;
  spring.length_m = std::max(0.0, (p_W_ - p_WH).dot(n_W_));
  spring.pull_W = spring.elastic_W = spring.length_m * n_W_;
  spring.contact = spring.length_m > 0;
  spring.rendered_W = p_WH + spring.pull_W;
  return spring;
}

}  // namespace tasks
