#include "drivers/codec/depth_motion.hpp"

#include <algorithm>
#include <cstdlib>

#include "drivers/codec/depth_lattice.hpp"

namespace drivers {

namespace {

std::size_t kept_of(const DepthStreamConfig& c, int stride) {
  const auto along = [&](int pixels) {
    return static_cast<std::size_t>(std::max(pixels, 0) / stride);
  };
  return along(c.width) * along(c.height);
}

}  // namespace

DepthMotion::DepthMotion(rt::NonRealtime&, const DepthStreamConfig& config)
    : config_(config), kept_(kept_of(config, kStride)), past_(kept_ * kBack) {}

DepthMode DepthMotion::judge(std::span<const std::uint16_t> depth_mm) noexcept {
  const int w = config_.width, h = config_.height;
  if (depth_mm.size() != static_cast<std::size_t>(w) * static_cast<std::size_t>(h)) return mode_;
  // The ring's next place holds the oldest frame; before the ring is full, the first.
  const std::size_t oldest = frames_ < kBack ? 0 : static_cast<std::size_t>(next_);
  std::uint16_t* const here = past_.data() + static_cast<std::size_t>(next_) * kept_;
  const std::uint16_t* const before = past_.data() + oldest * kept_;
  int both = 0, moved = 0;
  std::size_t n = 0;
  for (int v = kStride / 2; v < h / kStride * kStride; v += kStride) {
    const std::uint16_t* row =
        depth_mm.data() + static_cast<std::size_t>(v) * static_cast<std::size_t>(w);
    for (int u = kStride / 2; u < w / kStride * kStride; u += kStride, ++n) {
      const int is = row[u], was = before[n];
      here[n] = row[u];
      if (is == 0 || was == 0) continue;
      ++both;
      const std::int64_t gate =
          kGate_sigma * codec::sigma_1024th_mm(config_.law, std::max(is, was));
      moved += std::int64_t{1024} * std::abs(is - was) > gate ? 1 : 0;
    }
  }
  const bool compared = frames_ > 0 && both > 0;
  frames_ = std::min(frames_ + 1, kBack);
  next_ = (next_ + 1) % kBack;
  if (!compared) return mode_;
  moved_permille_ = static_cast<int>(std::int64_t{1000} * moved / both);
  still_ = moved_permille_ < kRests_permille ? std::min(still_ + 1, kBack) : 0;
  if (moved_permille_ > kMoves_permille) mode_ = DepthMode::kMoving;
  if (still_ == kBack) mode_ = DepthMode::kQuiet;
  return mode_;
}

}  // namespace drivers
