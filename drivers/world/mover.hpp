// A rigid motion of some shapes of the simulated world. It is a pure function of the time since the
// world's beginning, so any thread may ask for any instant.
//
//   line       from start_s on with velocity_m_per_s
//   shuttle    from where it stands by way_m and back, again and again, at speed_m_per_s
//   swing      sine: amplitude_m and angle_deg (about axis through point_m), every period_s
//   hinge      turns about axis through point_m at rate_deg_per_s up to angle_deg; with back there
//              and back again
//   waypoints  by offset_m and turn_deg (about axis through point_m) at at_s; straight on in
//              between, at rest before the first and after the last
//   walk       from start_s on, from where it stands through its waypoints at speed_m_per_s,
//              straight on in between; stands wait_s at each
//
// line, shuttle, swing and hinge stop duration_s after start_s where they are then; 0: never.
// Before start_s the shape rests at its own pose. A mover that is carried by another one (`on`: for
// example an arm's second link) moves in the carrier's frame; its point and axis are given for the
// state at rest.
#pragma once

#include <array>
#include <deque>
#include <string>
#include <vector>

#include "config/schema.hpp"
#include "perception/geometry/pose.hpp"

namespace drivers {

inline constexpr double kFar_m = 100.0;  // half the largest world

struct WaypointConfig {
  double at_s = 0;  // of waypoints
  std::array<double, 3> offset_m{0, 0, 0};
  double turn_deg = 0;
  double wait_s = 0;  // of a walk
  void describe(config::Section& s);
};

// One table of [[world.mover]].
struct MoverConfig {
  std::string name;
  std::string shapes;  // names with commas between
  std::string on;      // name of the mover that carries it; empty: none
  std::string kind = "line";
  double start_s = 0, duration_s = 0;
  std::array<double, 3> velocity_m_per_s{0, 0, 0}, way_m{0, 0, 0}, amplitude_m{0, 0, 0};
  double speed_m_per_s = 0.5, period_s = 2;
  std::array<double, 3> point_m{0, 0, 0}, axis{0, 0, 1};
  double rate_deg_per_s = 30, angle_deg = 0;
  bool back = false;
  std::deque<WaypointConfig> waypoints;
  void describe(config::Section& s);
};

class Mover {
 public:
  // Throws std::runtime_error naming the mover and what is wrong with it.
  explicit Mover(const MoverConfig& config);

  // The motion X of carried points: a point that rests at p is at X p at t_s. Without the motion of
  // its carrier.
  [[nodiscard]] perception::Pose moved(double t_s) const noexcept;
  [[nodiscard]] const std::string& name() const noexcept { return name_; }
  [[nodiscard]] bool turns() const noexcept { return turns_; }
  [[nodiscard]] const perception::Vec3& axis_W() const noexcept { return axis_; }

 private:
  enum class Kind : std::uint8_t { kLine, kShuttle, kSwing, kHinge, kWaypoints };
  struct Waypoint {
    double at_s, turn_rad;
    perception::Vec3 offset;
  };
  struct Where {
    perception::Vec3 offset = perception::Vec3::Zero();
    double turn_rad = 0;
  };
  [[nodiscard]] Where where(double t_s) const noexcept;
  [[nodiscard]] Where along_waypoints(double t_s) const noexcept;

  std::string name_;
  Kind kind_ = Kind::kLine;
  bool turns_ = false, back_ = false;
  double start_s_, duration_s_, speed_m_per_s_, period_s_, rate_rad_per_s_, angle_rad_;
  perception::Vec3 way_, point_, axis_;  // way: velocity, way or amplitude, by kind
  std::vector<Waypoint> waypoints_;
};

}  // namespace drivers
