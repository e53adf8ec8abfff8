// A surface that leaves the hand, or comes at it faster than a hand can be carried.
#include <algorithm>
#include <array>
#include <cmath>

#include "tasks/haptic/haptic_task.hpp"

namespace tasks {

namespace {

using perception::Vec3;

// A surface that goes or comes faster than this over one period does not carry a hand: 8 mm at 30 Hz. A step of 5 mm does.
constexpr double kLeaves_m_per_s = 0.24;

constexpr double kApart_vox = 2;  // points of a face, 3 x 3

struct Face {
  double rise_m = 0;     // median over its points
  bool unknown = false;  // its middle and most of it
};

// What the newer window, alone, has of the face about p_W: what only the older one knows is not there any more. Noise moves a
// node, not its neighbours with it. Leaves `field` with both windows, the older one's values.
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
  // Of an even number the upper of the two in the middle: rt::quantile() has the lower, and another rise is another force.
  const auto middle = rises.begin() + static_cast<std::ptrdiff_t>(known_then / 2);
  std::nth_element(rises.begin(), middle, rises.begin() + static_cast<std::ptrdiff_t>(known_then));
  out.rise_m = *middle;
  return out;
}

}  // namespace

// What the blend that begins brings to a hand that stands. A surface that goes, or that comes faster than a hand can be
// carried, is told to the operator. One that falls away takes its force with it in the blend; from one that comes, or is not
// known any more, the hand is let go. Returned: how much higher the newer window has the surface under the proxy.
double HapticTask::look_ahead_m() noexcept {
  constexpr double kSlopeLeast = 0.3;  // flatter is a rounded crease or the edge of the band
  if (proxy_.phase != ProxyState::Phase::kContact || leaving_) return 0;
  const Vec3 p_W = proxy_.p_WP();
  field_.set(older_, newer_, 1);
  const FieldSample then = field_.sample(p_W);
  field_.set(older_, newer_, 0);
  const FieldSample now = field_.sample(p_W);
  if (!now.known) return 0;
  const double steep = std::max(now.gradient.norm(), kSlopeLeast);
  const double rise_m = then.known ? (now.value - then.value) / steep : 0;
  // A window that lags behind the hand says nothing: the last frame is held.
  if (field_.near_edge(p_W) || field_.near_edge(to_world(h_D_))) return rise_m;
  const Face face = face_ahead(field_, older_, newer_, p_W, now.gradient, steep);
  const double most_m = kLeaves_m_per_s * config_.scale * config_.blend_s;
  const bool moves = newer_->touched_moves;
  left_ = moves || face.unknown || std::abs(face.rise_m) > most_m;
  const Vec3 pull = rendered_W_ - to_world(h_D_);
  if (!(moves || face.unknown || face.rise_m > most_m) || !(pull.norm() > 1e-9)) return rise_m;
  leaving_ = true;
  left_n_W_ = pull.normalized();
  // No deeper than the force limit: the fade is felt from its beginning.
  const double most = force_limit_N_ * config_.scale / std::max(stiffness_, 1e-9);
  left_p_W_ = to_world(h_D_) + std::min(pull.norm(), most) * left_n_W_;
  return 0;
}

// While the hand is let go: the last contact's plane, which pushes as far as the hand is behind it.
HapticTask::Spring HapticTask::held_spring(const Vec3& p_WH) noexcept {
  Spring spring;
  spring.length_m = std::max(0.0, (left_p_W_ - p_WH).dot(left_n_W_));
  spring.pull_W = spring.elastic_W = spring.length_m * left_n_W_;
  spring.contact = spring.length_m > 0;
  rendered_W_ = p_WH + spring.pull_W;
  return spring;
}

// Let go: what is touched next is entered from seen-free space.
void HapticTask::end_leaving() noexcept {
  leaving_ = false;
  proxy_ = ProxyState{};
  proxy_.set_p(to_world(h_D_));  // the next sweep begins here
  proxy_.phase = ProxyState::Phase::kUnknown;
  ramp_ = 1;
  fade_ = 0;
}

}  // namespace tasks
