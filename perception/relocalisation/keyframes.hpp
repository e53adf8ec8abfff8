// Views to recognise a place by: small images of depth and brightness with the pose they were taken
// from.
//
// Thumbnail  32 x 26 cells over the whole image, whatever its size. Depth as a logarithmic code
//            (one step is 1.2 % of the depth, 0 = no reading), brightness, where there is colour,
//            scaled to a fixed mean and contrast, so that exposure does not matter. 1.7 KiB a view:
//            256 of them are 0.5 MiB.
// Distance   mean over the cells both see of the cut-off absolute differences; tried with small
//            shifts of the image, since a turn of the camera is a shift. After the small blurry
//            images of Klein and Murray, "Improving the agility of keyframe-based SLAM", ECCV 2008,
//            section 3.
//
// Keyframes only propose places; ICP decides (relocaliser.hpp). Integers throughout: the same on
// every machine.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "config/schema.hpp"
#include "perception/geometry/image.hpp"
#include "perception/geometry/rgbd_frame.hpp"
#include "perception/icp/preprocess.hpp"
#include "rt/memory/non_realtime.hpp"

namespace perception {

struct Thumbnail {
  static constexpr int kWidth = 32, kHeight = 26, kCells = kWidth * kHeight;
  std::array<std::uint8_t, kCells> depth{};  // 0 = none, else 1 + log(z / 0.3 m) / log(1.012)
  std::array<std::uint8_t, kCells> grey{};   // mean 128, standard deviation 40; 0 = none
};

// The pixel, of `pixels` along an edge, that stands for a cell of `cells`.
[[nodiscard]] constexpr int cell_to_pixel(int cell, int cells, int pixels) noexcept {
  return std::min(pixels - 1, (2 * cell + 1) * pixels / (2 * cells));
}
// Depth (m) of a code; 0 of 0.
[[nodiscard]] double thumbnail_depth(std::uint8_t code) noexcept;

// `colour` may be empty (no data).
[[nodiscard]] Thumbnail make_thumbnail(const DepthLevel& depth,
                                       ImageView<const Rgb> colour) noexcept;

// Compares `seen` at (u, v) with `kept` at (u + du, v + dv): mean difference in 1/256 of a code.
// The largest integer if too few cells are known in both, or as soon as it can not be less than
// `below`.
[[nodiscard]] int thumbnail_distance(const Thumbnail& seen, const Thumbnail& kept, int du, int dv,
                                     int below = std::numeric_limits<int>::max()) noexcept;

struct KeyframeConfig {
  int max_keyframes = 256;  // beyond, the one that is nearest to another is given up
  double spacing_m = 0.20;  // a view is kept when no other is nearer than this and ...
  double spacing_deg = 12;  // ... turned less than this
  void describe(config::Section& s);
};

class Keyframes {
 public:
  static constexpr int kMax = 256;
  struct Entry {
    Pose X_WC = Pose::Identity();
    Thumbnail view;
  };
  struct Candidate {
    int index = -1;
    int du = 0, dv = 0;  // cells, as in thumbnail_distance
    int distance = 0;
  };

  Keyframes(rt::NonRealtime&, const KeyframeConfig& config);

  // Is the view at X_WC unlike all that are kept?
  [[nodiscard]] bool is_new(const Pose& X_WC) const noexcept;
  // Does one of them look, by and large, the same way from about there?
  [[nodiscard]] bool near(const Pose& X_WC) const noexcept;
  // The keyframe that shows about the same as a camera at X_WC, from as near as possible; -1: there
  // is none.
  [[nodiscard]] int looking_at(const Pose& X_WC) const noexcept;
  void add(const Pose& X_WC, const Thumbnail& view) noexcept;

  // Best first, at most out.size(); entries with skip[i] are passed over. Returns how many.
  [[nodiscard]] int rank(const Thumbnail& seen, std::span<const bool> skip,
                         std::span<Candidate> out) const noexcept;

  [[nodiscard]] int size() const noexcept { return static_cast<int>(entries_.size()); }
  [[nodiscard]] const Entry& at(int i) const noexcept {
    return entries_[static_cast<std::size_t>(i)];
  }
  void clear() noexcept { entries_.clear(); }
  [[nodiscard]] std::size_t memory_bytes() const noexcept {
    return entries_.capacity() * sizeof(Entry);
  }

 private:
  [[nodiscard]] double nearness(const Pose& a, const Pose& b) const noexcept;
  [[nodiscard]] std::size_t most_redundant() const noexcept;
  [[nodiscard]] int short_list(const Thumbnail& seen, std::span<const bool> skip,
                               std::span<Candidate> out) const noexcept;
  KeyframeConfig config_;
  std::vector<Entry> entries_;  // never grows beyond its reserve
};

}  // namespace perception
