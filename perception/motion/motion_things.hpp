// Which things move: the third step of MotionWatch. Evidence is grown over connected surface, to
// depth edges and concave creases (a thing stands ON the floor), over convex ones; a thing moves
// when least_share of it is evidence, or when it moved in the last image. One too thin to have an
// inside is its evidence alone; one whose middle wanders does not stand. A thing whose points have
// been where they are for rest_frames is part of the scene again.
//
// Frames: W world, C camera. Noexcept, no allocation after construction.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "perception/icp/tracker.hpp"
#include "perception/motion/consensus.hpp"
#include "perception/motion/motion_config.hpp"
#include "perception/motion/motion_evidence.hpp"
#include "perception/motion/place_memory.hpp"
#include "perception/motion/watched_image.hpp"

namespace perception::motion {

// Where the middles of things were in the last images, and the camera with them.
class ThingTrails {
 public:
  void forget() noexcept { trails_ = {}; }
  // Notes a thing's middle in this frame. Has it gone some way in the last images? One that turns
  // round goes back over places that it has filled. Farther than `slack_m` and the share
  // `of_camera` of the camera's own way.
  [[nodiscard]] bool wanders(const Vec3f& middle_W, const Vec3f& camera_W, std::uint64_t frame,
                             float slack_m, float of_camera) noexcept;

 private:
  struct Trail {
    static constexpr std::uint32_t kLength = 8;
    std::array<Vec3f, kLength> middle_W{}, camera_W{};
    std::uint32_t count = 0, seen = 0;
  };
  std::array<Trail, 16> trails_{};
};

class MotionThings {
 public:
  // Keeps references.
  MotionThings(const MotionConfig& config, const TrackerConfig& tracker, const WatchedImage& image,
               const Consensus& consensus, const MotionEvidence& evidence, PlaceMemory& places);

  // Another map, or a camera that was elsewhere.
  void forget() noexcept;
  // Of each cell 0 where a quarter of it moved in the last image, else 1; a camera that should be
  // at X_WC.
  void remember_cells(const DepthLevel& live, const Pose& X_WC, Consensus::Cells& out) noexcept;
  // Nothing moves in this image.
  void clear() noexcept;
  // Grows the evidence of a camera at X_WC to things, into mask(). `thin`: those without an inside,
  // too.
  void grow(const DepthLevel& live, const Pose& X_WC, bool thin) noexcept;
  // Pixels of mask(), whose points are noted for settle().
  [[nodiscard]] int note_points(const DepthLevel& live) noexcept;
  // The image's pose is settled: where the masked points are, for the next image. Returns how many.
  int settle() noexcept;

  // 1: the pixel moves.
  [[nodiscard]] const std::vector<std::uint8_t>& mask() const noexcept { return mask_; }

 private:
  struct Thing {  // counts of its pixels
    int evidence = 0, remembered = 0, agrees = 0, old = 0;
    int young = 0;    // where nothing was a moment ago
    int misfits = 0;  // of cells that do not fit
  };
  void recall(const DepthLevel& live, const Pose& X_WC) noexcept;
  void find_core(const DepthLevel& live) noexcept;
  void grow_whole(const DepthLevel& live) noexcept;
  void grow_thin(const DepthLevel& live) noexcept;
  void fringe(const DepthLevel& live) noexcept;
  void judge(const DepthLevel& live, int first, int end, const Thing& thing) noexcept;
  void let_stand(const DepthLevel& live, int first, int end) noexcept;
  [[nodiscard]] bool wanders(const DepthLevel& live, int first, int end) noexcept;
  [[nodiscard]] bool grazed(const DepthLevel& live, int i) const noexcept;

  const MotionConfig& config_;
  const TrackerConfig& tracker_;
  const WatchedImage& image_;
  const Consensus& consensus_;
  const MotionEvidence& evidence_;
  PlaceMemory& places_;
  ThingTrails trails_;
  std::vector<std::uint8_t> mask_, recalled_, visited_, core_;
  std::vector<std::int32_t> queue_;
  std::vector<Vec3f> points_W_;            // of last image's masked pixels
  std::vector<Vec3f> now_W_;               // of this one's, by consensus
  int remembered_ = 0, since_masked_ = 0;  // points of the last mask, frames since
  bool had_ = false;                       // there are some
};

}  // namespace perception::motion
