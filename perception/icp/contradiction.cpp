#include "perception/icp/contradiction.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>

namespace perception {

namespace {

constexpr double kNearest_m = 0.05;
constexpr int kLeastAbout = 5;  // of 9 pixels, and of 8 neighbours

// The pixel that sees p, and all eight about it are in the image.
bool pixel_of(const Intrinsics& k, const Vec3& p, int& u, int& v) noexcept {
  if (!(p.z() > kNearest_m)) return false;
  const Eigen::Vector2d px = k.project(p) + Eigen::Vector2d(0.5, 0.5);
  if (!(px.x() >= 1 && px.y() >= 1 && px.x() < k.width - 1 && px.y() < k.height - 1)) return false;
  u = static_cast<int>(px.x());
  v = static_cast<int>(px.y());
  return true;
}

// Depth images of the two kinds; 0: no reading.
struct LiveImage {
  const DepthLevel& level;
  [[nodiscard]] const Intrinsics& camera() const noexcept { return level.intrinsics; }
  [[nodiscard]] double at(int u, int v) const noexcept {
    return static_cast<double>(level.depth.row(v)[u]);
  }
};
struct ModelImage {
  const ModelView& view;
  [[nodiscard]] const Intrinsics& camera() const noexcept { return view.intrinsics; }
  [[nodiscard]] double at(int u, int v) const noexcept {
    return static_cast<double>(view.at(u, v)[3]);
  }
};

// Depth of the nearest of the 3 x 3 pixels about (u, v); infinite where too few show anything.
template <class Image>
double nearest_about(const Image& image, int u, int v) noexcept {
  double nearest = std::numeric_limits<double>::infinity();
  int shown = 0;
  for (int k = 0; k < 9; ++k) {
    const double d = image.at(u + k % 3 - 1, v + k / 3 - 1);
    if (!(d > 0)) continue;
    ++shown;
    nearest = std::min(nearest, d);
  }
  return shown >= kLeastAbout ? nearest : std::numeric_limits<double>::infinity();
}

// Marks of an image with a margin of one pixel.
class Marks {
 public:
  Marks(int width, int height) noexcept : width_(width), height_(height) {
    std::fill_n(marks_.begin(), static_cast<std::size_t>(height + 2) * kStride, std::uint8_t{0});
  }
  void set(int u, int v) noexcept { marks_[index(u, v)] = 1; }
  // Marked, and so are most about it.
  [[nodiscard]] int in_patches() const noexcept {
    int count = 0;
    for (int v = 0; v < height_; ++v) {
      for (int u = 0; u < width_; ++u) {
        if (marks_[index(u, v)] == 0) continue;
        int sum = -1;
        for (int k = 0; k < 9; ++k) sum += marks_[index(u + k % 3 - 1, v + k / 3 - 1)];
        count += sum >= kLeastAbout ? 1 : 0;
      }
    }
    return count;
  }

 private:
  static constexpr std::size_t kStride = ClashRule::kMostWidth + 2;
  [[nodiscard]] static std::size_t index(int u, int v) noexcept {
    return static_cast<std::size_t>(v + 1) * kStride + static_cast<std::size_t>(u + 1);
  }
  int width_, height_;
  std::array<std::uint8_t, (ClashRule::kMostHeight + 2) * kStride> marks_;
};

// Points of `a` in front of what `b` shows.
template <class A, class B>
void add_in_front(const A& a, const B& b, const Pose& X_BA, const ClashRule& rule,
                  Clash& out) noexcept {
  const Intrinsics& k = a.camera();
  const int step = std::max((k.width + ClashRule::kMostWidth - 1) / ClashRule::kMostWidth,
                            (k.height + ClashRule::kMostHeight - 1) / ClashRule::kMostHeight);
  const int width = (k.width + step - 1) / step, height = (k.height + step - 1) / step;
  Marks marks(width, height);
  for (int v = 0; v < height; ++v) {
    for (int u = 0; u < width; ++u) {
      const double z = a.at(u * step, v * step);
      if (!(z > 0)) continue;
      const Vec3 q = X_BA * k.unproject(u * step, v * step, z);
      int bu = 0, bv = 0;
      if (!pixel_of(b.camera(), q, bu, bv)) continue;
      const double shown = nearest_about(b, bu, bv);
      if (!std::isfinite(shown)) continue;
      ++out.met;
      if (q.z() < shown - (rule.limit_m + rule.limit_per_m * q.z())) marks.set(u, v);
    }
  }
  out.against += marks.in_patches();
}

}  // namespace

double contradiction_share(const DepthLevel& live, const ModelView& model, const Pose& X_FC,
                           double limit_m) noexcept {
  std::int64_t met = 0, against = 0;
  for (int v = 0; v < live.depth.height(); ++v) {
    for (int u = 0; u < live.depth.width(); ++u) {
      const auto z = static_cast<double>(live.depth.row(v)[u]);
      if (!(z > 0)) continue;
      const Vec3 q = X_FC * live.intrinsics.unproject(u, v, z);
      int iu = 0, iv = 0;
      if (!pixel_of(model.intrinsics, q, iu, iv)) continue;
      double nearest = std::numeric_limits<double>::infinity();
      for (int k = 0; k < 9; ++k) {
        const auto d = static_cast<double>(model.at(iu + k % 3 - 1, iv + k / 3 - 1)[3]);
        if (d > 0) nearest = std::min(nearest, std::abs(q.z() - d));
      }
      if (!std::isfinite(nearest)) continue;
      ++met;
      against += nearest > limit_m * std::max(1.0, z) ? 1 : 0;
    }
  }
  return met > 0 ? static_cast<double>(against) / static_cast<double>(met) : 1;
}

Clash clash(const DepthLevel& live, const ModelView& model, const Pose& X_FC,
            const ClashRule& rule) noexcept {
  Clash out;
  const LiveImage seen{live};
  const ModelImage map{model};
  add_in_front(seen, map, X_FC, rule, out);
  add_in_front(map, seen, X_FC.inverse(), rule, out);
  return out;
}

}  // namespace perception
