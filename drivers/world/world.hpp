// The simulated place: analytic solids that the synthetic camera sees, the virtual robot collides
// with, and tests use as ground truth. Immutable after construction, so any thread may ask. Motions
// are functions of time (mover.hpp); every query may name its instant, and without one it is about
// the beginning.
//
// World frame W: z up, floor at z = 0. SI units. Never linked into tasks.
#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/world/shape.hpp"
#include "drivers/world/world_config.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/time.hpp"

namespace drivers {

struct RayHit {
  int shape = -1;  // index into World::shapes(); -1: the ray leaves the world
  double t = 0;    // p = origin + t dir; metres when dir has length 1
  perception::Vec3 normal_W = perception::Vec3::Zero();  // out of the solid, length 1
  perception::Rgb colour{};
  [[nodiscard]] explicit operator bool() const noexcept { return shape >= 0; }
};

// The parts of the robot that can collide: boxes upright in B (x forward, z up, origin on the floor
// under the base's centre). Default: the youBot's base 580 x 376 x 140 mm (KUKA's data sheet), the
// folded arm and the camera mast (our own declaration).
struct BodyBox {
  perception::Vec3 centre_B, half;
};
[[nodiscard]] std::span<const BodyBox> youbot_body() noexcept;

class World {
 public:
  static constexpr rt::Time kBeginning = rt::Time::min();
  // Throws std::runtime_error naming the shape or mover and the value: a name used twice, a zero
  // normal, a cylinder that a motion would tilt. Motions count their seconds from t0.
  World(rt::NonRealtime&, const WorldConfig& config, rt::Time t0 = rt::Time{});

  [[nodiscard]] std::span<const Shape> shapes() const noexcept { return shapes_; }
  // Index of the shape of that name, -1 if there is none. The room's are floor, ceiling,
  // wall_x_min, wall_x_max, wall_y_min, wall_y_max.
  [[nodiscard]] int find(std::string_view name) const noexcept;

  // First entry of the ray into a solid at t > 0. A solid that the origin lies inside is not seen.
  // `dir` need not have length 1.
  [[nodiscard]] RayHit ray_cast(const perception::Vec3& origin_W, const perception::Vec3& dir_W,
                                rt::Time t = kBeginning) const noexcept;

  // Distance to the union of all solids, negative inside. Exact outside; inside it is the depth in
  // the solid that holds the point deepest (a bound where solids overlap). +infinity: empty world.
  [[nodiscard]] double signed_distance(const perception::Vec3& p_W,
                                       rt::Time t = kBeginning) const noexcept;
  [[nodiscard]] double signed_distance(const perception::Vec3& p_W, int shape,
                                       rt::Time t = kBeginning) const noexcept;

  // Does anything move, ever? Where a shape is at an instant.
  [[nodiscard]] bool moves() const noexcept { return !movers_.empty(); }
  [[nodiscard]] perception::Pose X_WS_at(int shape, rt::Time t) const noexcept;

  // First shape that the body at (x, y, yaw) touches or overlaps; -1: none. Ground shapes do not
  // count. Exact: box-plane by corners, box-box by separating axes, box-cylinder as rectangle-disc
  // in the plane times height overlap, box-sphere by distance, box-capsule by the nearest point of
  // the axis.
  [[nodiscard]] int robot_collision(double x_m, double y_m, double yaw_rad,
                                    rt::Time t = kBeginning) const noexcept;
  [[nodiscard]] int robot_collision(double x_m, double y_m, double yaw_rad,
                                    std::span<const BodyBox> body,
                                    rt::Time t = kBeginning) const noexcept;

 private:
  struct Motion {
    Mover mover;
    int carrier;  // -1: none; else an earlier one
  };
  void add(Shape shape);
  void add(const MoverConfig& mover);
  // Where the shape is: its own X_WS, or `moved`, filled.
  [[nodiscard]] const perception::Pose& pose(const Shape& s, rt::Time t,
                                             perception::Pose& moved) const noexcept;
  std::vector<Shape> shapes_;
  std::vector<Motion> movers_;
  rt::Time t0_;
};

// A capsule with its axis from a to b, in W or wherever its X_WS is put later. Throws nothing.
[[nodiscard]] Shape make_capsule(std::string name, const perception::Vec3& a_W,
                                 const perception::Vec3& b_W, double radius, const Paint& paint);
// Places an existing one: its length and radius stay.
void place_capsule(const perception::Vec3& a_W, const perception::Vec3& b_W,
                   perception::Pose& X_WS) noexcept;
// Fills the fields that World derives, for shapes that are not in a world (moving bodies).
void derive(Shape& shape);

// Colour of a shape at a point of its surface.
[[nodiscard]] perception::Rgb surface_colour(const Shape& shape,
                                             const perception::Vec3& p_S) noexcept;

}  // namespace drivers
