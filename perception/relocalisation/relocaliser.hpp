// After tracking was lost: where in the map is this camera?
//
// A frame that is claimed from a new place leaves a keyframe. A lost frame ranks the keyframes by their small
// images, casts the map from the best few (coarsely, every fourth pixel) and aligns the frame to each by ICP;
// the first that passes the gates of Tracker::reacquire is proposed. It is no claim: the caller believes it
// only when the next frame, tracked from there, passes too. What was tried in vain rests for some frames, so
// that look-alike views do not hide the right one.
//
// Bounded: at most `tries` casts of 1/16 of the pixels and alignments a frame. What a candidate would see and
// is put away far from the camera is brought back first, a part a frame.
#pragma once

#include <array>
#include <cstdint>

#include "perception/icp/tracker.hpp"
#include "perception/raycast/raycast.hpp"
#include "perception/relocalisation/keyframes.hpp"

namespace perception {

struct RelocaliserConfig {
  KeyframeConfig keyframes;
  int tries = 3;        // candidates a frame
  int rest_frames = 4;  // before one that failed is tried again
  double max_depth_m = 5.0;
  void describe(config::Section& s);
};

class Relocaliser {
 public:
  static constexpr int kMaxTries = 16;
  Relocaliser(rt::NonRealtime&, const RelocaliserConfig& config, const Intrinsics& camera);

  // Keeps the frame in `pyramid`, taken at X_WC, when the place is new. `colour` may be empty.
  void remember(const TrackingPyramid& pyramid, ImageView<const Rgb> colour,
                const Pose& X_WC) noexcept;
  // A search begins: nothing was tried yet.
  void restart() noexcept;
  // Looks for the frame that `tracker` has prepared. True: `found` passed the gates at found.X_WC.
  [[nodiscard]] bool search(TsdfMap& map, const Tracker& tracker, ImageView<const Rgb> colour,
                            TrackingResult& found) noexcept;

  [[nodiscard]] const Keyframes& keyframes() const noexcept { return keyframes_; }
  [[nodiscard]] Keyframes& keyframes() noexcept { return keyframes_; }
  [[nodiscard]] std::uint64_t take_work() noexcept;
  [[nodiscard]] std::size_t memory_bytes() const noexcept { return keyframes_.memory_bytes(); }

 private:
  [[nodiscard]] Pose guess(const Keyframes::Candidate& c) const noexcept;
  RelocaliserConfig config_;
  Intrinsics camera_;
  Keyframes keyframes_;
  RaycastMaps maps_;
  std::array<bool, Keyframes::kMax> resting_{};
  std::array<std::int64_t, Keyframes::kMax> rests_until_{};
  std::int64_t searches_ = 0;
  std::uint64_t work_ = 0;
};

}  // namespace perception
