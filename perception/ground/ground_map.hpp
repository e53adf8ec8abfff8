// Ground and cost map from depth frames: where may the robot's body stand?
//
// find     the ground plane is searched in the first claimed frames (ground_plane.hpp). When it is
//          found the grid frame M is fixed for good: origin so that the robot's start lies in the
//          middle, x along the world's x (y where x is nearly vertical) projected on the plane, z
//          up. It never moves, so paths stay valid; slow drift of the tracking against the plane is
//          followed by a small correction (offset and tilt) that only sorts heights.
// update   one claimed frame: each point falls into a cell and counts as ground (|height| below
//          ground_tolerance), obstacle (up to robot_height) or neither (overhead: the robot passes
//          below; deep below: a hole, counts as an obstacle). Between two points of neighbouring
//          pixel rows that are of one kind and height the cells count too (at grazing angles rows
//          lie farther apart than cells). Points count by the area they stand for, (z / f)^2.
//          Evidence: an obstacle frame adds, a ground frame takes away, so a moved box is forgotten
//          after `cap` views of its floor. Where the floor is not in view (a mast before a camera
//          that looks ahead, a table's far side) a frame takes away too once all that the obstacle
//          was is seen through: every slice of the cell's column in which one was met
//          (seen_through.cpp). A ray without a reading sees through nothing.
// layers   occupied; inscribed within robot_radius of an occupied cell (centre to centre, plus half
//          a cell: on the safe side); inflation falls linearly to 0 over inflation_m beyond;
//          unknown. Exact Euclidean distances, capped at robot_radius + inflation_m.
//
// moves    what moves is no part of `update`: it is an obstacle of its own, at once and for a while
//          (moving_cells.hpp).
//
// Virtual obstacles are drawn into the occupied layer; every cell such a shape touches counts.
//
// START DISC: a camera on a robot can not see the floor under and just before the robot. The disc
// of start_radius_m about the robot's start position is declared free ("the robot stands there")
// when the ground is found; obstacles seen inside it still count. This is an assumption, not an
// observation: 0 switches it off, and then the robot's own cell is unknown.
//
// An unknown cell is not inflated: the body may overhang unseen ground by its radius.
//
// Cost: one pass over the points of pyramid level 1 plus, when the set of occupied cells changed,
// one distance transform of the whole grid; both bounded by sizes fixed at construction.
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <string>
#include <vector>

#include "config/schema.hpp"
#include "perception/geometry/camera_model.hpp"
#include "perception/geometry/image.hpp"
#include "perception/ground/cost_map.hpp"
#include "perception/ground/ground_plane.hpp"
#include "perception/ground/moving_cells.hpp"
#include "rt/memory/non_realtime.hpp"

namespace perception {

// A no-go area drawn in by the operator or the scene, in world coordinates (x, y of the ground).
struct VirtualObstacle {
  enum class Kind : std::uint8_t { kBox, kDisc };
  Kind kind = Kind::kDisc;
  Vec3 centre_W = Vec3::Zero();
  double half_x_m = 0.1, half_y_m = 0.1;  // box
  double yaw_rad = 0;                     // box, about up, from grid x
  double radius_m = 0.1;                  // disc
};

struct VirtualObstacleConfig {
  std::string shape = "disc";
  std::array<double, 3> position_m{0, 0, 0};
  std::array<double, 2> size_m{0.2, 0.2};  // box: edges
  double yaw_deg = 0;
  double radius_m = 0.1;
  void describe(config::Section& s);
  [[nodiscard]] VirtualObstacle obstacle() const;
};

struct GroundConfig {
  GroundPlaneConfig plane;
  int cells = 256;  // along an edge
  double resolution_m = 0.05;
  double range_m = 4.0;              // points farther along the optical axis are not used
  double ground_tolerance_m = 0.04;  // plus tolerance_per_m2 times range squared
  double tolerance_per_m2 = 0.004;
  double robot_height_m = 1.1;  // higher surfaces are overhead
  double bridge_m = 0.40;       // longest gap between two rows that is filled
  double obstacle_area = 0.06;  // of a cell's area, seen as obstacle in one frame, to count
  int occupied_at = 3;          // evidence
  int evidence_gain = 1, evidence_loss = 1, evidence_cap = 12;
  double robot_radius_m = 0.35;  // youBot: half diagonal of 580 x 376 mm is 0.345
  double inflation_m = 0.25;     // beyond the radius
  double start_radius_m = 0.60;  // see START DISC
  MovingCellsConfig moving;
  std::deque<VirtualObstacleConfig> virtual_obstacles;
  void describe(config::Section& s);
};

// A claimed frame: a depth image in metres (0 = none) of a camera at X_WC. The ground search uses
// it thinned.
struct GroundFrame {
  Intrinsics intrinsics{};
  ImageView<const float> depth_m{};
  Pose X_WC = Pose::Identity();
  // All readings, those of what moves too: through these a place is seen free. Empty: depth_m has
  // all.
  Intrinsics all_intrinsics{};
  ImageView<const float> all_m{};
};

// What is known beforehand, in the world.
struct GroundPrior {
  bool up_known = false;
  Vec3 up_W = Vec3::UnitZ();
  std::optional<double> camera_height_m;
  Vec3 start_W = Vec3::Zero();  // robot's start; centre of grid and start disc
  // Plan of the robot's own base, where nothing else can move, and the camera on it; empty: not
  // known.
  std::vector<Eigen::AlignedBox2d> body_B;
  Pose X_BC = Pose::Identity();
};

class GroundMap {
 public:
  static constexpr int kMaxVirtual = 64;
  static constexpr int kSlices = 31;  // of the robot's height
  static constexpr std::uint32_t kHole = 1U << kSlices;
  // Throws std::invalid_argument for a grid or radius that does not fit.
  GroundMap(rt::NonRealtime&, const GroundConfig& config, const GroundPrior& prior);

  void update(const GroundFrame& frame) noexcept;
  // What moves in an image, after its update(); and where nothing does, as long as moving() says
  // that something did.
  void see_moving(const MovingFrame& frame) noexcept;
  [[nodiscard]] int moving() const noexcept { return moving_.size(); }
  // Replaces the drawn-in obstacles; false (and unchanged) beyond kMaxVirtual.
  bool set_virtual(std::span<const VirtualObstacle> obstacles) noexcept;
  // The obstacles whose column of the robot's height meets the box are forgotten, not free: unknown
  // until they are seen again, or the floor is.
  void forget(const Eigen::AlignedBox3d& box_W) noexcept;
  // Fills everything but seq, fused, exposure. What moves is as old as `now` says, and goes by it.
  void write(CostMap& out, rt::Time now = {}) noexcept;

  [[nodiscard]] bool found() const noexcept { return found_; }
  [[nodiscard]] const GroundPlane& plane_W() const noexcept { return plane_W_; }
  [[nodiscard]] const Pose& X_WM() const noexcept { return X_WM_; }
  // Height correction h' = h - (a + b x + c y) in M, and whether it stays believable.
  [[nodiscard]] const Vec3& correction() const noexcept { return correction_; }
  // Deterministic work of the calls since the last take_work(): points and cells touched.
  [[nodiscard]] std::uint64_t take_work() noexcept;
  void clear() noexcept;  // back to "not found"

 private:
  struct Cell {
    std::uint8_t evidence, seen;
    std::uint16_t obstacle_area, ground_points;  // of the current frame; area in 1/256 of a cell
    float frame_height, height;
    // Of the column, a bit each: an obstacle was met in it; it has been seen through since.
    std::uint32_t slices, through;
  };
  void search(const GroundFrame& frame) noexcept;
  void fix_grid() noexcept;
  void collect(const GroundFrame& frame) noexcept;
  void settle() noexcept;
  void look_through(const GroundFrame& frame) noexcept;
  [[nodiscard]] std::uint32_t slice_of(float h) const noexcept;
  void draw_virtual() noexcept;
  void inflate() noexcept;
  void touch(std::size_t cell) noexcept;

  GroundConfig config_;
  GroundPrior prior_;
  bool found_ = false;
  int agreeing_ = 0;
  std::uint64_t searches_ = 0, work_ = 0;
  GroundPlane plane_W_, candidate_W_;
  Pose X_WM_ = Pose::Identity(), X_MW_ = Pose::Identity();
  Vec3 correction_ = Vec3::Zero();
  int reach_ = 0;  // cells, of the capped distance
  float slices_per_m_ = 0;
  bool dirty_ = true;          // occupied set changed since the last inflate()
  std::vector<Vec3f> points_;  // scratch of the search
  std::vector<Cell> cells_;
  std::vector<std::uint32_t> touched_;
  std::size_t touched_count_ = 0;
  std::vector<std::uint8_t> occupied_,
      drawn_;  // drawn_: by the operator, kDrawn; by what moves, MovingCells::kBit
  MovingCells moving_;
  std::vector<std::uint16_t> column_, distance2_;  // capped, cells
  std::vector<std::uint8_t> cost_of_distance2_;
  std::vector<float> row_x_, row_y_, row_h_;  // previous pixel row in M
  std::vector<std::uint8_t> row_kind_;
  std::array<VirtualObstacle, kMaxVirtual> virtual_{};
  int virtual_count_ = 0;
};

}  // namespace perception
