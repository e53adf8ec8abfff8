// What moves in an image, before the camera is tracked by it.
//
//   consensus   how the camera has moved against what stands still (consensus.hpp), on the coarse image
//   evidence    a coarse pixel speaks for motion when its point lies in space that the map has seen free, or, in a cell
//               that does not fit the consensus, off the map's surface; patches count, lone pixels do not
//               Or where nobody could look, close behind a surface of the map that its ray goes through: it recedes.
//   thing       evidence is grown over connected surface: to depth edges and concave creases (a thing stands ON the
//               floor), over convex ones; a thing moves when least_share of it is evidence, or when it moved in the last image
//               One too thin to have an inside is its evidence alone; one whose middle wanders does not stand.
//   rest        a thing whose points have been where they are for rest_frames is part of the place again
//
// Everything at about 128 x 106 pixels whatever the camera; the mask of the camera's own pixels is made from that by
// depth. A frame in which every cell fits and nothing lies in free space ends after the consensus.
//
// Noexcept, no allocation after construction; the same bytes on every instruction set.
#pragma once

#include <array>
#include <cstdint>
#include <cstring>
#include <vector>

#include "config/schema.hpp"
#include "perception/geometry/image.hpp"
#include "perception/icp/tracker.hpp"
#include "perception/motion/agree_kernel.hpp"
#include "perception/motion/consensus.hpp"
#include "perception/motion/motion_mask.hpp"
#include "perception/tsdf/blocks/map_reader.hpp"
#include "rt/memory/non_realtime.hpp"

namespace perception {

struct MotionConfig {
  bool on = true;
  // chosen on: recording both ways at 10 and 20 mm, moving 1 first 40; judged on: moving 606, moving 707
  double front_m = 0.018;  // in front of the map's surface by this ...
  // chosen on: not recorded; judged on: moving 606, moving 707
  double front_voxel = 0.4;  // ... and this share of a voxel ...
  double front_sigma = 3;    // ... and so many sigma of a coarse pixel: evidence
  // chosen on: recording both ways at 10 and 20 mm, moving 1 first 40; judged on: moving 606, moving 707
  double least_share = 0.15;  // of a thing that is evidence
  // chosen on: not recorded; judged on: moving 606, moving 707
  int least_pixels = 10;  // of the coarse image
  int rest_frames = 20;
  // chosen on: recording both ways at 10 and 20 mm, moving 1 first 40; judged on: moving 606, moving 707
  double least_explained = 0.975;  // of what stands still, by a pose that is tracked by its noise
  // chosen on: not recorded; judged on: moving 606, moving 707
  double rest_cell_m = 0.025;
  void describe(config::Section& s);
};

struct MotionResult {
  bool moving = false;  // some pixels are masked
  bool doubtful =
      false;  // the prior leaves much of what may stand still unexplained: hypotheses have competed
  bool sudden =
      false;  // much more moves than in the last image: compete() and find() have to look again
  bool certain = true;           // no other motion explains the image nearly as well
  Pose X_WC = Pose::Identity();  // by what stands still; where tracking starts
  ConsensusResult consensus;
  double masked_share = 0;  // of the coarse pixels with depth
  int evidence = 0, cells_misfit = 0;
  std::uint64_t work = 0;
};

class MotionWatch {
 public:
  static constexpr int kMostWidth = CellSums::kMostColumns * CellSums::kEdge;
  static constexpr int kMostHeight = CellSums::kMostRows * CellSums::kEdge;
  static constexpr int kMost = kMostWidth * kMostHeight;

  MotionWatch(rt::NonRealtime&, const MotionConfig& config, const TrackerConfig& tracker);
  // Another map, or a camera that was elsewhere.
  void forget() noexcept;
  // The image in `pyramid`, a camera that should be at `prior` and was at `model`.X_WF, in three steps:
  // Does the prior, mended, explain the image? If not, `out`.doubtful: compete() has to follow.
  void look(const MapView& map, const TrackingPyramid& pyramid, const ModelView& model,
            const MotionPrior& prior, MotionResult& out) noexcept;
  // Hypotheses, about the prior or about where the whole image would have the camera, `X_tracked_WC`.
  void compete(const TrackingPyramid& pyramid, const ModelView& model, const MotionPrior& prior,
               const Pose& X_tracked_WC, MotionResult& out) noexcept;
  // What moves against that.
  void find(const MapView& map, const TrackingPyramid& pyramid, const ModelView& model,
            MotionResult& out) noexcept;
  // Is it the place that moves? Where the map began with a thing that fills the image, its motion may pass for the camera's.
  // A thing is in front of the place: while the map is young, no frame is certain of which what does not fit lies behind
  // what does. After find(); odometry that is `trusted` tells by itself.
  void doubt_place(const MapView& map, const TrackingPyramid& pyramid, bool trusted,
                   MotionResult& out) noexcept;
  // The map was made before: it is not young.
  void grown() noexcept { known_ = kYoungMap; }
  // After tracking, by its result: where the masked points are, for the next image; how well the map is met.
  void settle(const TrackingResult& r) noexcept;

  // Did no other motion explain the last image as well?
  [[nodiscard]] bool certain() const noexcept { return certain_ || !looked_; }
  // Of what the pose by what stands still explains of the image: the share that another pose does.
  [[nodiscard]] double explains(const TrackingPyramid& pyramid, const ModelView& model,
                                const Pose& X_WC) noexcept;
  // Level of the pyramid that misfits() has the size of.
  [[nodiscard]] int level() const noexcept { return level_; }
  // Of the coarse image, 1: no part in the fit. What moves, and cells that do not fit what stands still.
  [[nodiscard]] ImageView<const std::uint8_t> misfits() noexcept;
  // And what does not meet the map at all, or came to rest where the map does not show it yet. `kept_share`: of the
  // readings, what is left.
  [[nodiscard]] ImageView<const std::uint8_t> strangers(const DepthLevel& live,
                                                        double& kept_share) noexcept;
  // The same for the camera's pixels. kPlace and kMoving.
  void spread(const TrackingPyramid& pyramid, std::uint8_t* out) const noexcept;

 private:
  void linearise(const TrackingPyramid& pyramid, const ModelView& model, const Pose& X_WC,
                 bool again = false) noexcept;
  [[nodiscard]] bool shows_nothing(MapReader& reader, const Pose& X_FC,
                                   const Vec3f& p_C) const noexcept;
  bool settle_at(const TrackingPyramid& pyramid, const ModelView& model, const Pose& X_WC,
                 MotionResult& out) noexcept;
  void stay_at(const TrackingPyramid& pyramid, const ModelView& model, const Pose& X_WC,
               MotionResult& out) noexcept;
  [[nodiscard]] double met_share() const noexcept;
  [[nodiscard]] bool loose(float scale) const noexcept;
  double choose_start(const TrackingPyramid& pyramid, const ModelView& model,
                      const Pose& X_expected_WC, const Pose& X_tracked_WC,
                      MotionResult& out) noexcept;
  void remember_cells(const DepthLevel& live, const Pose& X_WC) noexcept;
  [[nodiscard]] std::uint64_t pixels() const noexcept {
    return static_cast<std::uint64_t>(width_) * static_cast<std::uint64_t>(height_);
  }
  // Does the image say something else than odometry that is good enough to claim on?
  [[nodiscard]] bool against_odometry(const MotionPrior& prior,
                                      const MotionResult& r) const noexcept;
  [[nodiscard]] double prior_sigma_m() const noexcept;
  [[nodiscard]] Pose moved_by(const Vec6& xi) const noexcept;
  [[nodiscard]] Vec6 twist_to(const Pose& X_WC) const noexcept;
  void start_evidence(const MapView& map, const Pose& X_WC) noexcept;
  [[nodiscard]] bool may_hold(int c) const noexcept;
  [[nodiscard]] bool glimpse(const MapView& map, MapReader& reader, const DepthLevel& live,
                             int least) noexcept;
  void gather_evidence(const MapView& map, MapReader& reader, const DepthLevel& live,
                       bool all) noexcept;
  void mark_cell(MapReader& reader, const DepthLevel& live, int c, unsigned rows) noexcept;
  [[nodiscard]] bool speaks_beside(int u0, int v) const noexcept;
  [[nodiscard]] bool seen_through(const MapView& map, MapReader& reader, const Vec3f& p_C,
                                  const Vec3f& p_W, float limit_m) noexcept;
  bool ask(const MapView& map, MapReader& reader, const DepthLevel& live, int i) noexcept;
  [[nodiscard]] std::uint8_t evidence_at(const MapView& map, MapReader& reader,
                                         const DepthLevel& live, int i, bool fits) noexcept;
  // Of evidence_ from i to i + 7: the top bit of each byte that speaks for motion, or may.
  [[nodiscard]] std::uint64_t speaking_at(int i) const noexcept {
    std::uint64_t eight = 0;
    std::memcpy(&eight, evidence_.data() + i, sizeof eight);
    return (eight + 0x7d7d7d7d7d7d7d7dU) & 0x8080808080808080U;  // from 3 on; all are below 128
  }
  [[nodiscard]] int patches(const MapView& map, MapReader& reader, const DepthLevel& live) noexcept;
  void recall(const DepthLevel& live, const Pose& X_WC) noexcept;
  void grow(const DepthLevel& live) noexcept;
  void find_core(const DepthLevel& live) noexcept;
  void fringe(const DepthLevel& live) noexcept;
  struct
      Thing {  // counts of its pixels; young: where nothing was a moment ago; misfits: of cells that do not fit
    int evidence = 0, remembered = 0, agrees = 0, old = 0, young = 0, misfits = 0;
  };
  void judge_thing(const DepthLevel& live, int first, int end, const Thing& thing) noexcept;
  void grow_thin(const DepthLevel& live) noexcept;
  [[nodiscard]] bool wanders(const DepthLevel& live, int first, int end) noexcept;
  [[nodiscard]] int cell_of(int u, int v) const noexcept {
    return v / CellSums::kEdge * consensus_.sums().columns + u / CellSums::kEdge;
  }
  [[nodiscard]] Vec3f point_C(const DepthLevel& live, int i) const noexcept;
  [[nodiscard]] Vec3f point_W(const DepthLevel& live,
                              int i) const noexcept {  // by the evidence's pose
    return turned_W(point_C(live, i));
  }
  [[nodiscard]] Vec3f turned_W(const Vec3f& p_C) const noexcept;
  [[nodiscard]] float front_limit(float z) const noexcept;

  static constexpr int kYoungMap = 25;  // claimed frames

  MotionConfig config_;
  TrackerConfig tracker_;
  Consensus consensus_;
  int width_ = 0, height_ = 0, level_ = 0;
  float voxel_m_ = 0.01F;
  Pose X_WF_ = Pose::Identity(), X_FC_ = Pose::Identity();  // where the sums were taken
  Vec3 centre_F_ = Vec3::Zero();
  Pose X_majority_WC_ = Pose::Identity();
  ConsensusConfig rule_;
  double length_m_ = 1;
  std::array<Consensus::Stand, 3> stand_{};  // of the poses that choose_start() compares
  Consensus::Cells memory_{};                // 0: moved in the last image
  std::vector<std::uint8_t> mask_, evidence_, seed_, recalled_, visited_, core_;
  std::vector<std::int32_t> queue_;
  std::vector<Vec3f> points_W_;  // of last image's masked pixels
  std::vector<Vec3f> now_W_;     // of this one's, by consensus
  ModelView model_;              // of the image that is looked at, in find()
  Pose X_FW_ = Pose::Identity();
  motion::AgreeJob agree_{};  // where evidence is gathered from
  float clear_m_ = 0;         // what is seen free lies so far before a surface at least
  std::array<std::uint8_t, CellSums::kMost> marked_{};  // by cell: a bit for each row that is
  int remembered_ = 0, since_masked_ = 0;               // points of the last mask, frames since
  bool had_ = false;
  bool doubtful_ = false;
  bool looked_ = false;         // the consensus is of this image
  bool held_ = false;           // its pose is believed against what explains more
  bool certain_ = false;        // and no other motion explains it as well
  double masked_share_ = 0;     // of the last image
  double innovation_m_ = 0.02;  // mean way of the tracked poses from their priors, of late
  Pose X_prior_WC_ = Pose::Identity();
  float scale_ = 1, late_scale_ = 1;  // by which the cells fit: in the last image, of late
  float map_error_m_ = 0;             // RMS by which what stands still misses the map, of late
  std::uint64_t frame_ = 0;
  double least_holes_ = 0;  // share of the image, while the map is young
  double holes_ = 0;        // of the last image
  double own_holes_ = 0;    // that the map has without a thing that moves
  int in_doubt_ = 0;        // frames yet
  int grown_ago_ = 1000;    // frames since an image with more holes
  bool sure_ = false;       // by a second one soon after
  int known_ = 0;           // claimed frames since the map began, up to kYoungMap
  int recent_ = 0;          // frames that evidence is remembered for
  struct Place {
    std::int32_t x = 0, y = 0, z = 0;
    std::uint32_t first = 0, last = 0;
  };
  [[nodiscard]] Place* place_of(const Vec3f& p_W, bool make, bool seen = true) noexcept;
  [[nodiscard]] bool grazed(const DepthLevel& live, int i) const noexcept;
  [[nodiscard]] bool beside_rested(const Vec3f& p_W) noexcept;
  // Where a thing's middle was in the last images, and the camera with it.
  struct Trail {
    static constexpr std::uint32_t kLength = 8;
    std::array<Vec3f, kLength> middle_W{}, camera_W{};
    std::uint32_t count = 0, seen = 0;
  };
  std::array<Trail, 16> trails_{};
  std::vector<Place> places_;         // motion::place_slot() says which
  std::vector<std::uint32_t> taken_;  // a bit for each that may be one
};

}  // namespace perception
