// An object that a person has accepted: what of the frame reads within its boxes.
#include <algorithm>

#include "perception/objects/object_look.hpp"

namespace perception {
namespace {

constexpr int kMostGivenPixels = 36000;  // as many as a touch looks at
constexpr int kLeastGivenPixels = 48;

struct PixelBox {
  int u0, v0, u1, v1;  // inclusive
  [[nodiscard]] int size() const noexcept { return (u1 - u0 + 1) * (v1 - v0 + 1); }
};

// Pixels that a box in W can fall on; all of the image where a corner is beside or behind the
// camera.
PixelBox pixels_of(const Eigen::AlignedBox3d& box_W, const Pose& X_CW,
                   const Intrinsics& k) noexcept {
  double u0 = k.width, v0 = k.height, u1 = -1, v1 = -1;
  for (int n = 0; n < 8; ++n) {
    const Vec3 p_C = X_CW * box_W.corner(static_cast<Eigen::AlignedBox3d::CornerType>(n));
    if (p_C.z() < 0.05) return {0, 0, k.width - 1, k.height - 1};
    const double u = k.fx * p_C.x() / p_C.z() + k.cx, v = k.fy * p_C.y() / p_C.z() + k.cy;
    u0 = std::min(u0, u), u1 = std::max(u1, u), v0 = std::min(v0, v), v1 = std::max(v1, v);
  }
  const auto pixel = [](double x, int size) {
    return static_cast<int>(std::clamp(x, -1.0, static_cast<double>(size)));
  };
  return {std::max(0, pixel(u0, k.width)), std::max(0, pixel(v0, k.height)),
          std::min(k.width - 1, pixel(u1, k.width) + 1),
          std::min(k.height - 1, pixel(v1, k.height) + 1)};
}

}  // namespace

void ObjectMap::answer_given(const Look& look, const GivenObject& given) noexcept {
  for (const MapObject& o : objects_)
    if (o.id != 0) turn_into(project(look, o.id), 0, kNoVote);
  int u = 0, v = 0;
  stats_.answer = check(look, given.p_W, u, v);
  if (stats_.answer != TouchAnswer::kObject) return;
  MapObject* place = free_place(look, given.p_W);
  if (place == nullptr) return;
  given_[id_of(*place) - 1U] = given;
  if (!given_at(look, id_of(*place))) {
    stats_.answer = TouchAnswer::kNoReading;
    return;
  }
  name(*place, given.p_W);
  place->given = true;
}

// Paints what reads within the boxes, but not over what the map gives to another object. Every
// pixel is asked, or of a large object one of each few, so that a frame's cost is bounded.
bool ObjectMap::given_at(const Look& look, std::uint8_t id) noexcept {
  const GivenObject& given = given_[id - 1U];
  const FrameView& f = look.frame;
  const Eigen::AlignedBox3d bounds_W = given.bounds();
  if (bounds_W.isEmpty()) return false;
  const PixelBox window = pixels_of(bounds_W, look.X_CW, f.intrinsics);
  if (window.u1 < window.u0 || window.v1 < window.v0) return false;
  int step = 1;
  while (window.size() > kMostGivenPixels * step * step) ++step;
  int pixels = 0;
  for (int v = window.v0; v <= window.v1; v += step) {
    for (int u = window.u0; u <= window.u1; u += step) {
      const std::uint16_t mm = f.depth_mm.at(u, v);
      if (!reads(mm)) continue;
      const Vec3 p_W = look.X_WC * f.intrinsics.unproject(u, v, 1e-3 * mm);
      if (!bounds_W.contains(p_W) || !given.contains(p_W)) continue;
      if (image_.at(u, v) == kNoVote) {
        const std::uint8_t fused = look.reader.label(p_W);
        if (fused != 0 && fused != id) continue;
      }
      const int right = std::min(u + step, f.intrinsics.width);
      const int below = std::min(v + step, f.intrinsics.height);
      for (int b = v; b < below; ++b) std::fill_n(&image_.at(u, b), right - u, id);
      pixels += (right - u) * (below - v);
    }
  }
  stats_.work += static_cast<std::uint64_t>(window.size() / (step * step));
  if (pixels < kLeastGivenPixels) {
    replace(id, 0);
    return false;
  }
  stats_.mask_pixels = pixels;
  return true;
}

}  // namespace perception
