// Relocalisation: finds the camera in the map after tracking was lost.
//
// Search. A frame that is claimed from a new place leaves a keyframe. A lost frame ranks the
// keyframes by their small images and aligns its own small image to the best of them
// (thumbnail_fit.hpp). From the likeliest resulting pose it casts the map coarsely and aligns the
// frame to that by ICP. The frame fits if it passes the gates of Tracker::reacquire. A candidate
// that failed rests for some frames, so that the next best has its turn.
//
// Look-alikes. A fit is no proof, since another place may fit as well. So every other place that
// the small images allow is tried before a fit is proposed. The best is proposed only if clearly
// more evidence contradicts each other place (clash, contradiction.hpp: what one side shows where
// the other has seen free space). While two places fit about equally well the camera stays lost,
// until it sees what tells them apart. A fit is forgotten after a while, because it belongs to an
// older frame.
//
// A proposal is not a claim: the caller accepts it only if the next frame, tracked from there,
// passes too.
//
// Bounded: at most `tries` coarse casts and alignments a frame, or one look(). A ray without a hint
// costs thirty times one with a hint. So three of four rays start from what the fourth has found
// (sparse_cast.hpp), and casts are spread over frames. Compressed blocks that a view would show are
// restored first, a part in each frame, and cast in the frame after.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "perception/icp/tracker.hpp"
#include "perception/raycast/raycast.hpp"
#include "perception/raycast/sparse_cast.hpp"
#include "perception/relocalisation/keyframes.hpp"
#include "perception/relocalisation/thumbnail_fit.hpp"
#include "perception/tsdf/tsdf_map.hpp"

namespace perception {

struct RelocaliserConfig {
  KeyframeConfig keyframes;
  int tries = 1;        // candidates a frame
  int rest_frames = 8;  // before one that failed is tried again
  // chosen on: kidnaps 11 to 13, 23 to 25; judged on: kidnaps 46 to 50 (docs/fusion.md, Look-alikes)
  int rivals = 6;  // other places tried, at most, before a fit is proposed
  // Shares of points (contradiction.hpp). A rival must exceed twice the best's share by this;
  // largest share of the best.
  double clear_clash = 0.002;
  double most_clash = 0.004;
  double max_depth_m = 5.0;  // no data
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
  // Casts the view from X_WC, where the camera is searched. False: too much of that view is
  // compressed. Then a part of it was restored, the view is unchanged, and the next frame must ask
  // again.
  [[nodiscard]] bool look(TsdfMap& map, const Pose& X_WC) noexcept;
  // Of the last look(), or of what search() has found; invalid where there was neither.
  [[nodiscard]] ModelView view() const noexcept {
    const RaycastMaps& m = maps_[viewed_];
    return has_view_ ? ModelView{m.data(), m.intrinsics, m.X_WC} : ModelView{};
  }
  // Searches the place of the frame that `tracker` has prepared. `here`: its fit in view(), else
  // null. True: `found` passed the gates at found.X_WC, nothing else fits as well, and view() was
  // cast from near there.
  [[nodiscard]] bool search(TsdfMap& map, const Tracker& tracker, ImageView<const Rgb> colour,
                            const TrackingResult* here, TrackingResult& found) noexcept;
  // Is X_WC the only place where the kept views allow the frame that `tracker` has prepared?
  [[nodiscard]] bool alone(const Tracker& tracker, ImageView<const Rgb> colour,
                           const Pose& X_WC) noexcept;

  [[nodiscard]] const Keyframes& keyframes() const noexcept { return keyframes_; }
  [[nodiscard]] Keyframes& keyframes() noexcept { return keyframes_; }
  [[nodiscard]] std::uint64_t take_work() noexcept;
  [[nodiscard]] std::size_t memory_bytes() const noexcept { return keyframes_.memory_bytes(); }

 private:
  static constexpr std::size_t kAligned = 6;  // keyframes that a frame is aligned to by thumbnails
  static constexpr std::size_t kMirrored =
      4;  // and, while a place fits, that look like those of it
  static constexpr std::size_t kPlaces = 8;
  static constexpr std::size_t kTwins = 4;
  enum class Fit : std::uint8_t {
    kWaiting,  // for what is put away
    kNothing,  // tried in vain
    kMayBe,    // too poor to be claimed, too good to be left out
    kFits
  };
  // Where a frame was tried.
  struct Place {
    Pose X_WC = Pose::Identity();
    Fit fit = Fit::kNothing;
    double clash = 0, inlier_share = 0;
    std::int64_t at = 0;  // searches_ then
  };
  struct Guess {
    int keyframe = -1;  // below 0: -1 - the number of a twin
    Pose X_WC = Pose::Identity();
    double score = 0;
    bool possible = false;  // nothing in the small images forbids it
    bool mirrored = false;  // the camera is to the keyframe as it is to one of the place that fits
  };
  // From one place, here (H), to another that looked like it, there (T), in W.
  struct Twin {
    Pose X_TH = Pose::Identity();
    double quality = 0;  // inlier share of the poorer fit
  };
  [[nodiscard]] Fit try_at(TsdfMap& map, const Tracker& tracker, const Pose& X_WC,
                           TrackingResult& found) noexcept;
  // `leader`: where the camera would be by what fits best, if anything.
  void list_guesses(const Tracker& tracker, ImageView<const Rgb> colour,
                    const Pose* leader) noexcept;
  void list_mirrored(const Pose& leader) noexcept;
  void add_guess(int keyframe, const Pose& X_KS0, bool mirrored) noexcept;
  [[nodiscard]] bool next_guess(Guess& out) const noexcept;
  [[nodiscard]] bool was_tried(const Pose& X_WC) const noexcept;
  void note(const Pose& X_WC, Fit fit, const TrackingResult& r) noexcept;
  template <class Which>
  void forget_if(Which&& which) noexcept;
  void forget(const Pose& X_WC) noexcept;
  void forget_old() noexcept;
  void learn_twin(const Pose& X_WC, double inlier_share) noexcept;
  void forget_twin(std::size_t n) noexcept;
  [[nodiscard]] const Place* best() const noexcept;
  [[nodiscard]] const Place& oldest_fit() const noexcept;  // where there is one
  [[nodiscard]] bool clear(const Place& best) const noexcept;
  [[nodiscard]] bool rivals_left() const noexcept {
    return config_.tries > 0 && rivals_tried_ < config_.rivals;
  }
  [[nodiscard]] bool look_again(TsdfMap& map, const Tracker& tracker, const Place& place,
                                TrackingResult& found) noexcept;
  void propose() noexcept;
  // Brings back what can be seen from X_WC. True: enough is there, and time left, to cast it.
  [[nodiscard]] bool fetched(TsdfMap& map, const Pose& X_WC) noexcept;
  RaycastStats cast(const MapView& map, const Pose& X_WC, RaycastMaps& maps) noexcept;
  [[nodiscard]] Pose shift(const Keyframes::Candidate& c) const noexcept;
  RelocaliserConfig config_;
  Intrinsics camera_;
  Keyframes keyframes_;
  ThumbnailAligner aligner_;
  CellView seen_{};
  int step_;  // pixels of the camera a ray
  SparseCast caster_;
  std::array<RaycastMaps, 2> maps_;  // the view, and what is being tried
  std::size_t viewed_ = 0;
  bool has_view_ = false;
  int fetched_ = 0;  // blocks moved in this frame
  std::array<bool, Keyframes::kMax> resting_{};
  std::array<std::int64_t, Keyframes::kMax> rests_until_{};
  std::int64_t searches_ = 0;
  std::array<Guess, kAligned + kMirrored> guesses_{};  // best first
  std::size_t guess_count_ = 0;
  std::array<Keyframes::Candidate, kMirrored> mirrored_{};  // that look like keyframe mirrored_of_
  std::size_t mirrored_count_ = 0;
  int mirrored_of_ = -1;
  std::array<Place, kPlaces> places_{};
  std::size_t place_count_ = 0;
  int rivals_tried_ = 0;  // since there is a fit
  std::array<Twin, kTwins> twins_{};
  std::size_t twin_count_ = 0;
  std::uint64_t work_ = 0;
};

}  // namespace perception
