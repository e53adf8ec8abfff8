// After tracking was lost: where in the map is this camera?
//
// A frame that is claimed from a new place leaves a keyframe. A lost frame ranks the keyframes by their small
// images, casts the map from the best one (coarsely) and aligns the frame to it by ICP; if that passes the gates
// of Tracker::reacquire it is proposed. It is no claim: the caller believes it only when the next frame, tracked
// from there, passes too. What was tried in vain rests for some frames, so that the next best has its turn and
// look-alike views do not hide the right one.
//
// Doubt: a fit that more than `sure_contradiction` of the points speak against may be a look-alike. It is held, the
// keyframes of its place rest, and up to `rivals` others have their turn; a fit without doubt goes before it, of two
// in doubt the one that less speaks against is proposed in the end.
//
// Bounded: at most `tries` coarse casts and alignments a frame, or one look(). A ray of a cast without a hint
// costs thirty times one with: this is what a lost frame's time goes into, so it is spread over frames. What a
// view would show and is put away far from the camera is brought back first, a part a frame, and cast in the
// frame after.
#pragma once

#include <array>
#include <cstdint>

#include "perception/icp/tracker.hpp"
#include "perception/raycast/raycast.hpp"
#include "perception/relocalisation/keyframes.hpp"

namespace perception {

struct RelocaliserConfig {
  KeyframeConfig keyframes;
  int tries = 1;        // candidates a frame
  int rest_frames = 8;  // before one that failed is tried again
  int rivals = 4;       // tried before a fit in doubt is proposed
  double sure_contradiction = 0.006;
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
  // A search begins: nothing was tried yet, and there is no view.
  void restart() noexcept;
  // Casts the view from X_WC: where the camera is looked for. False: of that view too much is put away; a part
  // of it came back, the view is as it was, and the next frame is to ask again.
  [[nodiscard]] bool look(TsdfMap& map, const Pose& X_WC) noexcept;
  // Is `found`, of Tracker::reacquire(), beyond doubt?
  [[nodiscard]] bool sure(const TrackingResult& found) const noexcept {
    return found.contradiction <= config_.sure_contradiction;
  }
  // Of the last look(), or of what search() has found; invalid where there was neither.
  [[nodiscard]] ModelView view() const noexcept {
    const RaycastMaps& m = maps_[viewed_];
    return has_view_ ? ModelView{m.data(), m.intrinsics, m.X_WC} : ModelView{};
  }
  // Looks for the frame that `tracker` has prepared. True: `found` passed the gates at found.X_WC, in view().
  [[nodiscard]] bool search(TsdfMap& map, const Tracker& tracker, ImageView<const Rgb> colour,
                            TrackingResult& found) noexcept;

  [[nodiscard]] const Keyframes& keyframes() const noexcept { return keyframes_; }
  [[nodiscard]] Keyframes& keyframes() noexcept { return keyframes_; }
  [[nodiscard]] std::uint64_t take_work() noexcept;
  [[nodiscard]] std::size_t memory_bytes() const noexcept { return keyframes_.memory_bytes(); }

 private:
  // A fit in doubt that waits for its rivals.
  struct Doubt {
    bool held = false;
    Pose X_WC = Pose::Identity();
    double contradiction = 0;
    int rivals_left = 0;
  };
  enum class Tried : std::uint8_t { kWaiting, kNothing, kFits };  // waiting: for what is put away
  [[nodiscard]] Tried try_at(TsdfMap& map, const Tracker& tracker, const Pose& X_WC,
                             TrackingResult& found) noexcept;
  void hold(const TrackingResult& found) noexcept;
  void propose() noexcept;
  // Brings back what can be seen from X_WC. True: enough is there, and time left, to cast it.
  [[nodiscard]] bool fetched(TsdfMap& map, const Pose& X_WC) noexcept;
  RaycastStats cast(const TsdfMap& map, const Pose& X_WC, RaycastMaps& maps) noexcept;
  [[nodiscard]] Pose guess(const Keyframes::Candidate& c) const noexcept;
  RelocaliserConfig config_;
  Intrinsics camera_;
  Keyframes keyframes_;
  int step_;                         // pixels of the camera a ray
  std::array<RaycastMaps, 2> maps_;  // the view, and what is being tried
  std::size_t viewed_ = 0;
  bool has_view_ = false;
  int fetched_ = 0;  // blocks moved in this frame
  std::array<bool, Keyframes::kMax> resting_{};
  std::array<std::int64_t, Keyframes::kMax> rests_until_{};
  std::int64_t searches_ = 0;
  Doubt doubt_;
  std::uint64_t work_ = 0;
};

}  // namespace perception
