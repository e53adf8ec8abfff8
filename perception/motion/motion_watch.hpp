// What moves in an image, before the camera is tracked by it.
//
//   consensus   how the camera has moved against what stands still (still_motion.hpp)
//   evidence    which coarse pixels speak for motion: their point lies where the map has seen free
//               space, or off its surface (motion_evidence.hpp)
//   thing       evidence is grown over connected surface; enough of it and the thing moves
//               (motion_things.hpp)
//   rest        a thing whose points have been where they are for rest_frames is part of
//               the place again
//
// The steps and what they share lie in files of their own: still_motion, motion_evidence,
// motion_things, place_memory, place_doubt, watched_image.
//
// Everything at about 128 x 106 pixels whatever the camera; the mask of the camera's own pixels is
// made from that by depth. A frame in which every cell fits and nothing lies in free space ends
// after the consensus.
//
// Noexcept, no allocation after construction; the same bytes on every instruction set.
#pragma once

#include <cstdint>
#include <vector>

#include "perception/geometry/image.hpp"
#include "perception/icp/tracker.hpp"
#include "perception/motion/motion_config.hpp"
#include "perception/motion/motion_evidence.hpp"
#include "perception/motion/motion_mask.hpp"
#include "perception/motion/motion_things.hpp"
#include "perception/motion/place_doubt.hpp"
#include "perception/motion/place_memory.hpp"
#include "perception/motion/still_motion.hpp"
#include "perception/motion/watched_image.hpp"
#include "rt/memory/non_realtime.hpp"

namespace perception {

class MotionWatch {
 public:
  MotionWatch(rt::NonRealtime&, const MotionConfig& config, const TrackerConfig& tracker);
  MotionWatch(const MotionWatch&) = delete;
  MotionWatch& operator=(const MotionWatch&) = delete;
  // Another map, or a camera that was elsewhere.
  void forget() noexcept;
  // The image in `pyramid`, a camera that should be at `prior` and was at `model`.X_WF, in three
  // steps: Does the prior, mended, explain the image? If not, `out`.doubtful: compete() has to
  // follow.
  void look(const MapView& map, const TrackingPyramid& pyramid, const ModelView& model,
            const MotionPrior& prior, MotionResult& out) noexcept;
  // Hypotheses, about the prior or about where the whole image would have the camera,
  // `X_tracked_WC`.
  void compete(const TrackingPyramid& pyramid, const ModelView& model, const MotionPrior& prior,
               const Pose& X_tracked_WC, MotionResult& out) noexcept {
    still_.compete(pyramid, model, prior, X_tracked_WC, out);
  }
  // What moves against that.
  void find(const MapView& map, const TrackingPyramid& pyramid, const ModelView& model,
            MotionResult& out) noexcept;
  // Is it the place that moves (place_doubt.hpp)? Then the frame is not certain. After find();
  // odometry that is `trusted` tells by itself.
  void doubt_place(const MapView& map, const TrackingPyramid& pyramid, bool trusted,
                   MotionResult& out) noexcept;
  // The map was made before: it is not young.
  void grown() noexcept { image_.known = motion::WatchedImage::kYoungMap; }
  // After tracking, by its result: where the masked points are, for the next image; how well the
  // map is met.
  void settle(const TrackingResult& r) noexcept;

  // Did no other motion explain the last image as well?
  [[nodiscard]] bool certain() const noexcept { return still_.certain() || !still_.looked(); }
  // Of what the pose by what stands still explains of the image: the share that another pose does.
  [[nodiscard]] double explains(const TrackingPyramid& pyramid, const ModelView& model,
                                const Pose& X_WC) noexcept {
    return still_.explains(pyramid, model, X_WC);
  }
  // Level of the pyramid that misfits() has the size of.
  [[nodiscard]] int level() const noexcept { return image_.level; }
  // Of the coarse image, 1: no part in the fit. What moves, and cells that do not fit what stands
  // still.
  [[nodiscard]] ImageView<const std::uint8_t> misfits() noexcept;
  // And what does not meet the map at all, or came to rest where the map does not show it yet.
  // `kept_share`: of the readings, what is left.
  [[nodiscard]] ImageView<const std::uint8_t> strangers(const DepthLevel& live,
                                                        double& kept_share) noexcept;
  // The same for the camera's pixels. kPlace and kMoving.
  void spread(const TrackingPyramid& pyramid, std::uint8_t* out) const noexcept;

 private:
  [[nodiscard]] bool anything_moves(const MapView& map, MapReader& reader, const DepthLevel& live,
                                    int& evidence) noexcept;

  MotionConfig config_;
  TrackerConfig tracker_;
  motion::WatchedImage image_;
  motion::PlaceMemory places_;
  motion::StillMotion still_;
  motion::MotionEvidence evidence_;
  motion::MotionThings things_;
  motion::PlaceDoubt doubt_;
  std::vector<std::uint8_t> dropped_;  // misfits(), strangers()
  double masked_share_ = 0;            // of the last image
};

}  // namespace perception
