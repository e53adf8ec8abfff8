// Cells of the ground's grid that something moves in: an obstacle from the image that shows it on,
// and not for ever.
//
// sighted  by the pixels of one image that move (motion_mask.hpp), between the floor and the
//          robot's height, and that lie on a surface: a lone pixel between two surfaces is none. No
//          evidence is gathered: one image is enough.
// reaches  a camera sees the front of a thing. What is hidden behind it up to depth_m, away from
//          the camera, is taken to be of it, as long as it is sighted.
// goes     when its floor is seen and the lowest height that the thing was met at is seen through,
//          or all heights are; when the ground map has an obstacle of its own there (it stands);
//          under the robot's own base; and hold_s after its last sight, by the clock, whether an
//          image comes or not.
//
// Sparse: what is not masked costs nothing. Frames: M grid, C camera, B base.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include <Eigen/Geometry>

#include "config/schema.hpp"
#include "perception/geometry/camera_model.hpp"
#include "perception/geometry/image.hpp"
#include "perception/geometry/pose.hpp"
#include "perception/ground/cost_map.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/time.hpp"

namespace perception {

struct MovingCellsConfig {
  bool on = true;
  double hold_s = 3.0;    // without a sight
  double depth_m = 0.30;  // that a thing reaches behind what is seen of it
  void describe(config::Section& s);
};

// An image in which something moves or has moved: all of its readings, and what they are of.
struct MovingFrame {
  Intrinsics intrinsics{};
  ImageView<const float> depth_m{};      // 0: none
  ImageView<const std::uint8_t> what{};  // PixelOf, of the same size
  Pose X_WC = Pose::Identity();
  rt::Time taken{};
  bool any = false;   // some of `what` moves
  bool sure = false;  // the pose is claimed: what is seen free may go
};

class MovingCells {
 public:
  static constexpr int kMost = CostMap::kMaxMoving;
  static constexpr std::uint8_t kBit = 2;  // of `drawn`: a cell of this

  // Of the ground map that this belongs to.
  struct Rule {
    int cells = 0;  // along an edge
    float resolution_m = 0, tolerance_m = 0, per_m2 = 0, range_m = 0, top_m = 0;
    int slices = 0;
    int enough = 1;                           // 1/256 of a cell's area in one image
    std::vector<Eigen::AlignedBox2d> body_B;  // plan of the robot's own base
    Pose X_BC = Pose::Identity();
  };
  MovingCells(rt::NonRealtime&, const MovingCellsConfig& config, const Rule& rule);

  // Where the camera is, and the plane h = tilt . (1, x, y) that heights are above, in M.
  struct Place {
    Pose X_MC = Pose::Identity();
    Vec3f tilt = Vec3f::Zero();
    std::span<const std::uint8_t> occupied;  // by what stands
    std::span<std::uint8_t> drawn;           // kBit is kept here
  };
  // True when the set of cells is another one.
  bool see(const MovingFrame& frame, const Place& place) noexcept;
  // Forgets what was last seen longer than hold_s before `now`. True when there was any.
  bool expire(rt::Time now, std::span<std::uint8_t> drawn) noexcept;
  void write(CostMap& out, rt::Time now) const noexcept;
  // Nobody saw an obstacle where a thing is only taken to reach: kInscribed, with an obstacle's
  // inflation.
  void soften(CostMap& out, std::span<const std::uint8_t> occupied,
              std::span<const std::uint8_t> drawn) const noexcept;
  void clear(std::span<std::uint8_t> drawn) noexcept;

  [[nodiscard]] bool on() const noexcept { return config_.on; }
  [[nodiscard]] int size() const noexcept { return count_; }
  // Cells that there was no room for, of the last image; deterministic work since the last call.
  [[nodiscard]] int refused() const noexcept { return refused_; }
  [[nodiscard]] std::uint64_t take_work() noexcept;

 private:
  struct Entry {
    std::uint16_t cell = 0;
    bool shown = false;                  // an obstacle; else only begun in this image
    bool seen = false, reached = false;  // in this image: itself, or behind what was seen
    bool behind = false;                 // only ever behind
    std::int32_t area = 0;               // of this image
    std::uint32_t slices = 0, met = 0,
                  through = 0;  // heights: of all sights, of this one, seen through since
    rt::Time last{};
  };
  struct Eye;  // the image, seen from M
  Entry* entry_of(std::uint32_t cell, bool make) noexcept;
  void remove(int i, std::span<std::uint8_t> drawn) noexcept;
  void show(Entry& e, std::span<std::uint8_t> drawn) noexcept;
  void collect(const MovingFrame& frame, const Place& place) noexcept;
  int settle(const Eye& eye, const Place& place) noexcept;
  void reach_behind(const Eye& eye, const Place& place, int sighted) noexcept;
  void let_go(const Eye& eye, const Place& place, bool any_sighted) noexcept;
  [[nodiscard]] Vec3f centre_M(std::uint32_t cell, float h, const Place& place) const noexcept;
  [[nodiscard]] bool floor_seen(const Eye& eye, const Place& place, std::uint32_t cell) noexcept;
  [[nodiscard]] bool seen_through(const Eye& eye, const Place& place, Entry& e) noexcept;
  [[nodiscard]] bool in_body(const Eye& eye, const Place& place, std::uint32_t cell) const noexcept;

  MovingCellsConfig config_;
  Rule rule_;
  std::vector<Entry> entries_;
  std::vector<std::uint16_t> slot_;  // of a cell: index of its entry, or kNone
  int count_ = 0, refused_ = 0;
  bool changed_ = false;
  std::uint64_t work_ = 0;
};

}  // namespace perception
