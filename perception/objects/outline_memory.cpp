#include "perception/objects/outline_memory.hpp"

#include <algorithm>
#include <cmath>
#include <span>

#include "perception/objects/object_look.hpp"

namespace perception {
namespace {

constexpr int kReach_px = 5;            // of the band, either side
constexpr float kOfNew = 0.3F;          // least share of a frame in the mean
constexpr float kMostApart_px = 1.25F;  // mean distance of mask and mean: beyond it has moved
constexpr int kRounds = 6;              // of carrying depths on, a pixel each
constexpr int kSlopeRounds = 3;         // ... of them with their slope
constexpr float kMostSlope_m = 0.015F;  // a pixel

}  // namespace

OutlineMemory::OutlineMemory(int max_width, int max_height)
    : held_(max_width, max_height),
      band_(kMostBand),
      next_(kMostBand),
      number_(max_width, max_height) {}

void OutlineMemory::forget(std::uint8_t id) noexcept { known_[id].masks = 0; }

void OutlineMemory::settle(const FrameView& frame, const Pose& X_WC, std::uint8_t id,
                           const Box& box, const TsdfConfig& edges,
                           ImageView<std::uint8_t> labels) noexcept {
  Known& known = known_[id];
  const Intrinsics& k = frame.intrinsics;
  if (!(known.k == k)) known.masks = 0;
  if (box.u1 < box.u0) return;
  find_band(labels, id, box);
  find_depths(frame, edges);
  const bool had = known.masks > 0;
  believe(known, X_WC, id);
  if (had)
    for (int v = known.box.v0; v <= known.box.v1; ++v)
      for (int u = known.box.u0; u <= known.box.u1; ++u)
        if (held_.at(u, v) >> 8U == id) held_.at(u, v) = 0;
  known = {known.masks + 1,
           X_WC.inverse(Eigen::Isometry),
           k,
           {std::max(0, box.u0 - kReach_px), std::max(0, box.v0 - kReach_px),
            std::min(k.width - 1, box.u1 + kReach_px), std::min(k.height - 1, box.v1 + kReach_px)}};
  keep(labels, id, box);
  for (int n = 0; n < count_; ++n) {
    const Pixel& p = band_[static_cast<std::size_t>(n)];
    number_.at(p.u, p.v) = 0;
    if (!p.beside) continue;
    std::uint8_t& label = labels.at(p.u, p.v);
    if (p.in && p.belief < 0.5F) label = 0;
    if (label == 0 && !p.in && p.belief > 0.5F) label = id;
  }
}

// Every pixel within reach of the outline.
void OutlineMemory::find_band(ImageView<const std::uint8_t> labels, std::uint8_t id,
                              const Box& box) noexcept {
  const int w = labels.width, h = labels.height;
  count_ = rim_ = 0;
  const auto inside = [&](int u, int v) {
    return u >= 0 && v >= 0 && u < w && v < h && labels.at(u, v) == id;
  };
  for (int v = box.v0; v <= box.v1; ++v)
    for (int u = box.u0; u <= box.u1; ++u) {
      if (!inside(u, v) ||
          (inside(u - 1, v) && inside(u + 1, v) && inside(u, v - 1) && inside(u, v + 1)))
        continue;
      ++rim_;
      for (int b = std::max(0, v - kReach_px); b <= std::min(h - 1, v + kReach_px); ++b)
        for (int a = std::max(0, u - kReach_px); a <= std::min(w - 1, u + kReach_px); ++a) {
          if (number_.at(a, b) != 0 || count_ == kMostBand) continue;
          const bool in = labels.at(a, b) == id;
          const bool beside = inside(a - 1, b) != in || inside(a + 1, b) != in ||
                              inside(a, b - 1) != in || inside(a, b + 1) != in;
          band_[static_cast<std::size_t>(count_)] = {a, b, 0, in ? 1.0F : 0.0F, in, beside};
          number_.at(a, b) = ++count_;
        }
    }
}

// The mean of what the pixels beside it say, each with its slope towards this one.
float OutlineMemory::continued(const Pixel& p, bool sloped) const noexcept {
  const auto z = [&](int u, int v) {
    if (u < 0 || v < 0 || u >= number_.width() || v >= number_.height()) return 0.0F;
    const int n = number_.at(u, v);
    return n == 0 ? 0.0F : band_[static_cast<std::size_t>(n - 1)].z_m;
  };
  float sum = 0, count = 0;
  for (int y = -1; y <= 1; ++y)
    for (int x = -1; x <= 1; ++x) {
      const float near = z(p.u + x, p.v + y);
      if (!(near > 0)) continue;
      const float far = sloped ? z(p.u + 3 * x, p.v + 3 * y) : 0.0F;
      const float slope =
          far > 0 ? std::clamp(0.5F * (near - far), -kMostSlope_m, kMostSlope_m) : 0;
      sum += near + slope, count += 1;
    }
  return count > 0 ? sum / count : 0.0F;
}

void OutlineMemory::find_depths(const FrameView& frame, const TsdfConfig& edges) noexcept {
  const auto band = std::span(band_).first(static_cast<std::size_t>(count_));
  for (Pixel& p : band) {
    const std::uint16_t mm = frame.depth_mm.at(p.u, p.v);
    if (p.in && reads(mm) && !on_edge(frame, edges, p.u, p.v))
      p.z_m = 1e-3F * static_cast<float>(mm);
  }
  for (int round = 0; round < kRounds; ++round) {
    for (std::size_t n = 0; n < band.size(); ++n)
      next_[n] = band[n].z_m > 0 ? band[n].z_m : continued(band[n], round < kSlopeRounds);
    for (std::size_t n = 0; n < band.size(); ++n) band[n].z_m = next_[n];
  }
}

// What is held of a point, between the pixels round it.
float OutlineMemory::carried(const Known& known, const Vec3& p_W, std::uint8_t id,
                             float otherwise) const noexcept {
  const Vec3 p_C = known.X_CW * p_W;
  if (!(p_C.z() > 0.05)) return otherwise;
  const Eigen::Vector2d at = known.k.project(p_C);
  if (!(at.x() >= 0 && at.y() >= 0 && at.x() < known.k.width - 1 && at.y() < known.k.height - 1))
    return otherwise;
  const int u = static_cast<int>(at.x()), v = static_cast<int>(at.y());
  const auto fu = static_cast<float>(at.x() - u), fv = static_cast<float>(at.y() - v);
  const float above = held(u, v, id) + fu * (held(u + 1, v, id) - held(u, v, id));
  const float below = held(u, v + 1, id) + fu * (held(u + 1, v + 1, id) - held(u, v + 1, id));
  return (above + fv * (below - above)) / 255;
}

void OutlineMemory::believe(Known& known, const Pose& X_WC, std::uint8_t id) noexcept {
  if (known.masks == 0) return;
  const auto band = std::span(band_).first(static_cast<std::size_t>(count_));
  float apart = 0;
  for (std::size_t n = 0; n < band.size(); ++n) {
    const Pixel& p = band[n];
    next_[n] = p.belief;
    if (p.z_m > 0)
      next_[n] = carried(known, X_WC * known.k.unproject(p.u, p.v, static_cast<double>(p.z_m)), id,
                         p.belief);
    apart += std::abs(next_[n] - p.belief);
  }
  if (apart > kMostApart_px * static_cast<float>(rim_)) {
    known.masks = 0;
    return;
  }
  const float share = std::max(kOfNew, 1.0F / static_cast<float>(known.masks + 1));
  for (std::size_t n = 0; n < band.size(); ++n)
    band[n].belief = next_[n] + share * (band[n].belief - next_[n]);
}

// The mask inside, the mean along its outline; nothing over another object's mask.
void OutlineMemory::keep(ImageView<const std::uint8_t> labels, std::uint8_t id,
                         const Box& box) noexcept {
  const auto as_held = [id](float belief) {
    return static_cast<std::uint16_t>(id << 8 | static_cast<int>(255 * belief + 0.5F));
  };
  for (int v = box.v0; v <= box.v1; ++v)
    for (int u = box.u0; u <= box.u1; ++u)
      if (labels.at(u, v) == id) held_.at(u, v) = as_held(1);
  for (int n = 0; n < count_; ++n) {
    const Pixel& p = band_[static_cast<std::size_t>(n)];
    const std::uint8_t label = labels.at(p.u, p.v);
    if (p.in || label == 0 || label > kMostLabel) held_.at(p.u, p.v) = as_held(p.belief);
  }
}

}  // namespace perception
