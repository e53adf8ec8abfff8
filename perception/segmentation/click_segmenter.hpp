// An object named by several clicks: what is of it (add) and what is not (take away). Without a second click it is
// the touch of touch_segmenter.hpp, byte for byte.
//
//   outlines    the touch answers several times, each time with another choice of regions or another belief in depth
//               against colour; once with the clicks as constraints: pieces of both kinds never join. Each answer is
//               a signed distance to its outline, px, positive inside, not beyond reach_px.
//   correction  The object is where s(x) + c(x) > 0: s of the plain touch, and c the least correction by which every
//               click lies on its side (ridge regression in its dual form): a weighted sum of what the other
//               outlines differ from s, of a shift of the whole outline, of one that depends on the direction that
//               the outline faces, and of one near each click. So a click speaks for the rest of the outline too,
//               as far as the same cause explains it.
//   how far     People click in the middle of what is wrong. A click d inside the wrong side of an outline asks for
//               d on the right one.
//
// The first add click names the object. The others are a set: their order and repetitions change no bit. Clicks are
// taken up by how wrong they are: those that the outline is right about ask for nothing. Bounded: at most max_clicks,
// outlines of a fixed number. Nothing allocates or throws after construction. Same input, same bytes.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "perception/segmentation/touch_segmenter.hpp"

namespace perception {

struct Click {
  int u = 0, v = 0;  // pixel of the full image
  bool add = true;   // else take away
};

struct ClickConfig {
  TouchConfig touch;
  int max_clicks = 32;
  int reach_px = 10;     // farther from an outline all distances count the same
  float outline_weight = 1, seeded_weight = 1, shift_px = 1, direction_px = 1, local_px = 1;
  float local_reach_px = 30, slack_px = 0.3F;
};

class ClickSegmenter {
 public:
  ClickSegmenter(int max_width, int max_height, const ClickConfig& config = {});

  void set_frame(ImageView<const Rgb> rgb, ImageView<const std::uint16_t> depth,
                 const Intrinsics& k, float mm_per_unit) noexcept;

  enum class Answer { kDone, kNoDepth, kNothingAdded, kOutside, kContradiction, kTooMany };
  Answer segment(std::span<const Click> clicks) noexcept;
  [[nodiscard]] bool in(int u, int v) const noexcept {
    return mask_[static_cast<std::size_t>(v * width_ + u)] != 0;
  }

 private:
  static constexpr int kOutlines = 6;  // the plain one first, the seeded one last
  struct Box {
    int u0 = 0, v0 = 0, width = 0, height = 0;
  };
  struct Point {
    int u, v;
    float sign;
    std::array<float, kOutlines> s;  // signed distances
    float nu, nv;                    // where the outline faces
    float target, weight;
  };
  void keep(std::size_t outline) noexcept;
  void signed_distance(const std::uint8_t* mask, float* out) noexcept;
  [[nodiscard]] float kernel(const Point& a, const Point& b) const noexcept;
  void solve() noexcept;
  [[nodiscard]] float corrected(const Point& p) const noexcept;
  void look(Point& p) const noexcept;

  ClickConfig config_;
  TouchSegmenter touch_;
  int width_ = 0, height_ = 0;
  int first_u_ = -1, first_v_ = -1, answered_ = 0;
  bool found_ = false;
  std::vector<std::uint8_t> mask_;
  std::vector<Click> clicks_;
  std::vector<TouchSegmenter::Sided> sided_;
  std::vector<Point> points_;
  std::vector<int> active_;
  std::vector<double> matrix_;
  Box box_;
  std::array<std::vector<std::uint8_t>, kOutlines> answer_;
  std::array<std::vector<float>, kOutlines> distance_;
  std::vector<std::uint8_t> crop_, column_;  // by column: to the nearest pixel of the other kind
};

}  // namespace perception
