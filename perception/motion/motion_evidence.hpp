// Which pixels of the coarse image speak for motion, and the patches of them: the second step of
// MotionWatch.
//
// A pixel speaks for motion when its point lies in space that the map has seen free, or, in a cell
// that does not fit the consensus, off the map's surface; or where nobody could look, close behind
// a surface of the map that its ray goes through: it recedes. Patches count, lone pixels do not.
//
// An image: start(), then glimpse() or gather(), then patches(). Pixels are asked one by one only
// where a vector loop (agree_kernel.hpp) leaves them open.
//
// Frames: W world, C camera, F the camera that the model was cast from. Noexcept, no allocation
// after construction.
#pragma once

#include <array>
#include <cstdint>
#include <cstring>
#include <vector>

#include "perception/icp/tracker.hpp"
#include "perception/motion/agree_kernel.hpp"
#include "perception/motion/consensus.hpp"
#include "perception/motion/evidence.hpp"
#include "perception/motion/motion_config.hpp"
#include "perception/motion/place_memory.hpp"
#include "perception/motion/watched_image.hpp"
#include "perception/tsdf/blocks/map_reader.hpp"

namespace perception::motion {

class MotionEvidence {
 public:
  // Keeps references.
  MotionEvidence(const MotionConfig& config, const TrackerConfig& tracker,
                 const WatchedImage& image, const Consensus& consensus, PlaceMemory& places);

  // Another map, or a camera that was elsewhere.
  void forget() noexcept { map_error_m_ = 0; }
  // What the pixels are compared with: `model`, a cast of the map.
  void compare_with(const ModelView& model) noexcept;
  // Of the camera at X_WC; nothing has been looked at.
  void start(const MapView& map, const Pose& X_WC) noexcept;
  // Of every second pixel of every second row of cells that may hold something: do `least` of them
  // speak for motion?
  [[nodiscard]] bool glimpse(const MapView& map, MapReader& reader, const DepthLevel& live,
                             int least) noexcept;
  // Marks what may be in a patch, in cells that may hold something. Or `all`, and asks all of it.
  void gather(const MapView& map, MapReader& reader, const DepthLevel& live, bool all) noexcept;
  // Evidence in patches, into seed(). Asks what may be in one. Returns the number of pixels.
  [[nodiscard]] int patches(const MapView& map, MapReader& reader, const DepthLevel& live) noexcept;
  // Does the map know where the point lies, and show nothing in the view where it should be? What
  // has never been seen before is not asked for: what comes into range, or from behind a thing.
  [[nodiscard]] bool shows_nothing(MapReader& reader, const Pose& X_FC,
                                   const Vec3f& p_C) const noexcept;
  // A claimed pose left these residuals.
  void settle(double residual_m) noexcept;

  // What pixel i says.
  [[nodiscard]] std::uint8_t at(int i) const noexcept {
    return evidence_[static_cast<std::size_t>(i)];
  }
  // 1: pixel i is of a patch.
  [[nodiscard]] std::uint8_t seed(int i) const noexcept {
    return seed_[static_cast<std::size_t>(i)];
  }
  [[nodiscard]] const Pose& X_FW() const noexcept { return X_FW_; }
  // Of a pixel, by the pose of start().
  [[nodiscard]] Vec3f point_W(const DepthLevel& live, int i) const noexcept {
    return turned_W(image_.point_C(live, i));
  }
  [[nodiscard]] Vec3f camera_W() const noexcept {
    return agree_.t_W[0] * Vec3f::UnitX() + agree_.t_W[1] * Vec3f::UnitY() +
           agree_.t_W[2] * Vec3f::UnitZ();
  }

 private:
  [[nodiscard]] bool may_hold(int c) const noexcept;
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
  [[nodiscard]] Vec3f turned_W(const Vec3f& p_C) const noexcept {
    const auto axis = [&](int a) {
      return turned(agree_.R_W + 3 * a, agree_.t_W[a], p_C.x(), p_C.y(), p_C.z());
    };
    return {axis(0), axis(1), axis(2)};
  }
  [[nodiscard]] float front_limit(float z) const noexcept;

  const MotionConfig& config_;
  const TrackerConfig& tracker_;
  const WatchedImage& image_;
  const Consensus& consensus_;
  PlaceMemory& places_;
  std::vector<std::uint8_t> evidence_, seed_;
  ModelView model_;
  Pose X_FW_ = Pose::Identity();
  AgreeJob agree_{};   // where evidence is gathered from
  float clear_m_ = 0;  // what is seen free lies so far before a surface at least
  std::array<std::uint8_t, CellSums::kMost> marked_{};  // by cell: a bit for each row that is
  float map_error_m_ = 0;  // RMS by which what stands still misses the map, of late
};

}  // namespace perception::motion
