// Objects in the map: a touched surface point becomes an object, later frames follow it, and the
// masks of single frames are fused into the map's labels by vote
// (perception/segmentation/label_vote.hpp), so that single bad masks do not change it.
//
// Each frame, after it was integrated:
//   segment()  the label image of the frame. First frames: seed = the touched point, so that a few
//              bad masks do not hand the object on to a neighbour. Later ones, and when the point
//              is not seen: seed = the pixels whose reading lies on the object's fused labels. An
//              object that a person has accepted as boxes (given_object.hpp) is, in its first
//              frames, what reads within them: nothing is segmented.
//   fuse()     its vote, and what became of the objects.
//
// One object is segmented in each frame, in turn. Others on the same support are segmented with it
// if one window of limited size holds them all; pieces and regions of the window are computed once.
// A window that fills much of the image is segmented at a half or a quarter of its resolution,
// which bounds the cost of a frame; a voxel then covers several pixels. Where other objects may be,
// the image does not vote.
//
// A mask is withheld (it does not vote) if
//   - it agrees with the map's view of the object much less than usual, until several in a row do;
//   - its size is out of proportion to the object;
//   - it is empty although the object is still there.
// The outermost pixels of a mask and their neighbours do not vote either: their side is chance, and
// voxels seen by them alone would change from frame to frame.
//
// Agreement: of the pixels with a reading, the number that both mask and map give to the object,
// divided by that number plus the pixels where they contradict each other. Surface that the map
// does not know contradicts nothing, so a new side of an object, or an object that is pushed, is
// followed.
//
// An object is forgotten after its place was seen empty, in full view, for a while.
//
// Labels: an object's id is its label in the map and its slot in the palette, 1 .. kMost. Frames: W
// world (= map), C camera (optical). SI. Everything is allocated in the constructor.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string_view>
#include <vector>

#include "config/schema.hpp"
#include "perception/objects/given_object.hpp"
#include "perception/objects/outline_memory.hpp"
#include "perception/segmentation/object_summary.hpp"
#include "perception/segmentation/reduced_frame.hpp"
#include "perception/segmentation/touch_segmenter.hpp"
#include "perception/tsdf/tsdf_map.hpp"
#include "rt/memory/non_realtime.hpp"

namespace perception {

struct ObjectsConfig {
  bool enabled = false;         // a mark on a surface names an object
  double touch_window_m = 0.5;  // half edge of the part of the image in which a touch is answered
  // chosen on: not recorded; judged on: ycb_video, mosd_learn, tabletop (docs/segmentation.md)
  double agree_m = 0.03;         // the reading at a touch lies so near to the touched point
  int young_frames = 10;         // masks of a new object that start from the touched point
  int settled_masks = 4;         // masks of a new object that always vote
  double agreement_drop = 0.15;  // a mask that agrees this much less than usual is withheld ...
  int held_masks = 4;            // ... unless it is the n-th in a row
  double most_growth =
      2.5;                 // of the mask against the fused object: beyond it never, once not young
  int gone_frames = 12;    // an empty place for so long: the object is forgotten
  int summary_period = 6;  // masks of an object between two summaries
  void describe(config::Section& s);
};

// What became of a touch.
enum class TouchAnswer : std::uint8_t {
  kNone,       // there was none
  kObject,     // a new object
  kKnown,      // the touched surface belongs to an object already
  kOutOfView,  // the point does not project into the image
  kHidden,     // something is in front of it
  kNoReading,  // no depth there
  kMoved,      // the surface is no longer there
  kSupport,    // it is what things stand on, not a thing
  kNoRoom,     // as many objects as there can be
  kNotTracked  // the camera did not know where it was, for too long
};
[[nodiscard]] std::string_view text_of(TouchAnswer answer) noexcept;

struct MapObject {
  std::uint8_t id = 0;            // 0: this entry is free
  std::uint32_t serial = 0;       // never used twice
  bool seen = false;              // its last turn found it
  std::int32_t masks = 0;         // that voted
  std::int32_t unseen = 0;        // turns in a row without
  float usual_seed = 0;           // pixels, running mean: what is normally seen of it
  std::int32_t window = 0;        // half-resolution pixels that it was last looked for in
  float usual_agreement = 0;      // of a mask with the fused object, running mean
  std::int32_t held = 0;          // masks in a row that disagreed
  std::uint32_t empty_since = 0;  // frame number; 0: its place is not empty
  bool gone = false;              // ... for long enough
  bool given = false;             // accepted as boxes; else touched
  Vec3 touched_W = Vec3::Zero();
  ObjectSummary summary;  // in W, of the labelled surface; points = 0 before the first
};

struct ObjectStats {
  TouchAnswer answer = TouchAnswer::kNone;
  std::uint8_t touched = 0;   // id that the answer names
  std::uint8_t followed = 0;  // id of the object whose turn it was
  std::uint32_t with_mask =
      0;  // bit n: so was that of object n, or it was near; its mask was found
  std::int32_t mask_pixels = 0;  // of all of them
  float agreement = 0;           // of the mask of `followed` with the fused object, 0 to 1
  bool withheld = false;         // that mask did not vote
  std::uint64_t work = 0;        // deterministic count
  LabelStats votes;
};

class ObjectMap {
 public:
  static constexpr int kMost = 15;  // slots of a palette without the scene's own

  ObjectMap(rt::NonRealtime&, int max_width, int max_height, const ObjectsConfig& config);

  // `frame` has colour and was just integrated into `map` at X_WC.
  void segment(const FrameView& frame, const MapView& map, const Pose& X_WC,
               const std::optional<Vec3>& touched_W) noexcept;
  // The same for an object that is given as boxes; answered as a touch at its point is.
  void segment_given(const FrameView& frame, const MapView& map, const Pose& X_WC,
                     const GivenObject& given) noexcept;
  void fuse(TsdfMap& map) noexcept;

  // 0 background, an id, or kNoVote; of the last segment(), before fuse() judges it. To be changed
  // by tests only.
  [[nodiscard]] ImageView<std::uint8_t> label_image() noexcept { return image_.view(); }
  // After fuse(): the id of the object at every step-th pixel of the same frame, 0: none. From the
  // map's labels and the frame's own mask (object_image.cpp). out: (width - 1) / step + 1 pixels
  // wide, ...
  void draw(const FrameView& frame, const MapView& map, const Pose& X_WC, int step,
            ImageView<std::uint8_t> out) noexcept;
  [[nodiscard]] const ObjectStats& stats() const noexcept { return stats_; }
  [[nodiscard]] const std::array<MapObject, kMost>& objects() const noexcept { return objects_; }
  [[nodiscard]] int count() const noexcept;
  // Frees the id and takes its label out of the map.
  void forget(TsdfMap& map, std::uint8_t id) noexcept;
  // After TsdfMap::clear().
  void clear() noexcept;

 private:
  using SeedBox = TouchSegmenter::SeedBox;
  static constexpr int kOthersMargin_px = 12;
  // chosen on: not recorded; judged on: ycb_video, mosd_learn, tabletop (docs/segmentation.md)
  static constexpr float kStillThere = 0.4F;       // of what is usually seen of an object
  static constexpr std::uint8_t kSureOther = 255;  // no data
  struct Look;  // one frame, its camera and the map (object_look.hpp)
  // What the segmenter works on.
  struct Work {
    ImageView<const Rgb> colour;
    ImageView<const std::uint16_t> depth_mm;
    Intrinsics k;
  };
  // An object of which this frame may say something.
  struct Turn {
    std::uint8_t id;
    int planted;       // half-resolution pixels where the map shows it
    SeedBox seed_box;  // that hold all of them
  };
  [[nodiscard]] bool ready(const FrameView& frame) noexcept;
  void begin_image() noexcept;
  // That an object has or would have at this place.
  [[nodiscard]] std::uint8_t id_of(const MapObject& place) const noexcept {
    return static_cast<std::uint8_t>(&place - objects_.data() + 1);
  }
  void answer_touch(const Look& look, const Vec3& p_W) noexcept;
  void answer_given(const Look& look, const GivenObject& given) noexcept;
  [[nodiscard]] MapObject* free_place(const Look& look, const Vec3& p_W) noexcept;
  void name(MapObject& place, const Vec3& p_W) noexcept;
  [[nodiscard]] bool given_at(const Look& look, std::uint8_t id) noexcept;
  bool touch_at(const Look& look, const Vec3& p_W, std::uint8_t id, const SeedBox& known) noexcept;
  [[nodiscard]] TouchAnswer check(const Look& look, const Vec3& p_W, int& u, int& v) const noexcept;
  void follow_next(const Look& look) noexcept;
  void follow(const Look& look, MapObject& object, const SeedBox& known,
              const SeedBox* shared) noexcept;
  void follow_also(const Look& look, MapObject& object, const SeedBox& known) noexcept;
  [[nodiscard]] Work at_scale(const Look& look, const SeedBox& part) noexcept;
  [[nodiscard]] bool stands_here(const Look& look, const MapObject& object) const noexcept;
  [[nodiscard]] SeedBox project(const Look& look, std::uint8_t id) const noexcept;
  [[nodiscard]] SeedBox place_of(const Look& look, const MapObject& object,
                                 const SeedBox& blocks) const noexcept;
  [[nodiscard]] Turn& find_known(const Look& look, std::uint8_t id, SeedBox within) noexcept;
  void wipe_known() noexcept;
  // Pixels from one that known_ notes to the next; the first such from `at` on.
  [[nodiscard]] int known_step() const noexcept { return 2 * scale_; }
  [[nodiscard]] int known_from(int at) const noexcept {
    return (at + known_step() - 1) / known_step() * known_step();
  }
  [[nodiscard]] bool place_is_empty(const Look& look, const MapObject& object) const noexcept;
  void watch_place(const Look& look, MapObject& object, int planted) noexcept;
  void settle(TsdfMap& map) noexcept;
  void judge(MapObject& object, const Turn& turn) noexcept;
  void replace(std::uint8_t id, std::uint8_t by) noexcept;
  [[nodiscard]] SeedBox shown(std::uint8_t id) const noexcept;
  [[nodiscard]] std::uint8_t known_round(int u, int v) const noexcept;
  [[nodiscard]] std::uint8_t shows(const Look& look, int u, int v) const noexcept;
  void leave_out_rim(std::uint8_t id) noexcept;
  [[nodiscard]] SeedBox grown(const SeedBox& box) const noexcept;
  int paint(const Look& look, std::uint8_t id) noexcept;
  // Pixels of the value `from` in the box and round it.
  void turn_into(const SeedBox& box, std::uint8_t from, std::uint8_t to) noexcept;
  void summarise_object(const MapView& map, MapObject& object) noexcept;

  ObjectsConfig config_;
  int max_width_ = 0, max_height_ = 0;
  TouchSegmenter segmenter_;
  ReducedFrame reduced_;
  int scale_ = 1;  // of this frame's segmentation: pixels of the image to one that is looked at
  Image<std::uint8_t> image_;    // what the segmenter says
  Image<std::uint8_t> voting_;   // what of it votes
  Image<std::uint8_t> settled_;  // it with outlines as frames agree on them, while drawn
  OutlineMemory outlines_;
  // What the map shows, at every 2nd pixel of the scale, round the objects of turns_: an id,
  // kSureOther, or 0.
  Image<std::uint8_t> known_;
  SeedBox within_{1 << 20, 1 << 20, -1, -1};  // where it may be set
  std::array<Turn, kMost> turns_{};
  int turn_count_ = 0;
  std::array<MapObject, kMost> objects_{};
  std::array<GivenObject, kMost> given_{};  // of the objects that say so
  ObjectStats stats_;
  std::uint32_t serial_ = 0, frame_ = 0;
  int turn_ = 0;
  bool painted_ = false;

  static constexpr std::size_t kMostPoints = 4096;
  std::vector<Vec3f> points_;
  std::vector<Rgb> colours_;
  std::vector<float> scratch_;
};

}  // namespace perception
