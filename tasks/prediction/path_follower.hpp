// From a planned path to the next goal: how far ahead on the path the base may be sent in one
// straight motion.
//
// Progress    The point of the path nearest to the predicted base; it never goes back and never
//             leaps to a later branch of a path that comes near itself.
// Path point  the point `look_ahead_m` further on, drawn nearer where the path bends: the
//             base drives straight at its goal, and pursuing a point at distance l on a bend of
//             radius r leaves the path by l^2 / 2r, four times what the chord does; so the chord
//             may leave it by a quarter of `corridor_m`.
//             A base that is off the path by more than `corridor_m` is led back to it first: its
//             chord may cut the corner at the nearest point by no more than that.
// End         the end of the path, planned for the marked point, if the straight way there stays in
//             the corridor as well.
// Of the two the one further from the robot is the goal.
// Frame W. Allocation only in the constructor's object itself.
#pragma once

#include <cstdint>

#include "config/schema.hpp"
#include "perception/geometry/planar.hpp"
#include "tasks/contract/messages.hpp"

namespace tasks {

// Section [prediction.path].
struct PathFollowerConfig {
  double look_ahead_m = 0.45;
  double look_ahead_min_m = 0.15;
  double corridor_m = 0.05;
  double search_m = 1.0;   // progress is looked for this far along the path
  double arrive_m = 0.03;  // nearer to the end than this, slow and turned right: arrived
  double arrive_rad = 0.1;
  double arrive_speed_m_per_s = 0.05;

  void describe(config::Section& s) {
    s.number("look_ahead_m", look_ahead_m, 0.05, 5, "goal this far ahead on the path");
    s.number("look_ahead_min_m", look_ahead_min_m, 0.02, 1, "but never nearer, however it bends");
    s.number("corridor_m", corridor_m, 0.005, 1, "the base may leave the path by this much");
    s.number("search_m", search_m, 0.1, 10, "window in which progress is looked for");
    s.number("arrive_m", arrive_m, 0.001, 0.5, "distance to the end that counts as arrived");
    s.number("arrive_rad", arrive_rad, 0.001, 3.15, "yaw error that counts as arrived");
    s.number("arrive_speed_m_per_s", arrive_speed_m_per_s, 0.001, 1, "and this slow");
  }
};

class PathFollower {
 public:
  explicit PathFollower(const PathFollowerConfig& c) noexcept : config_(c) {}

  // Takes a new path; nothing happens if it is the one in force. False: empty or not finite.
  bool take(const Path&) noexcept;
  void drop() noexcept {
    size_ = 0;
    seq_ = 0;
    arrived_ = false;
  }
  [[nodiscard]] bool has_path() const noexcept { return size_ > 0; }
  [[nodiscard]] std::uint64_t seq() const noexcept { return seq_; }

  struct Goal {
    perception::Pose2 X_WG;
    bool is_mark = false;    // the end was chosen over the path point
    double progress_m = 0;   // along the path, of the predicted base
    double off_path_m = 0;   // distance of the predicted base from the path
    double remaining_m = 0;  // from there to the end, along the path
    double ahead_m = 0;      // along the path, from progress to the goal
  };
  // The goal for a base that will be at `predicted` when the goal arrives. Needs a path.
  [[nodiscard]] Goal next(const perception::Pose2& predicted_X_WB) noexcept;
  // Whether the base stands at the end; stays true for this path.
  bool update_arrival(const perception::Pose2& X_WB, double speed_m_per_s) noexcept;
  [[nodiscard]] bool arrived() const noexcept { return arrived_; }
  [[nodiscard]] double length() const noexcept { return size_ > 0 ? along_[size_ - 1] : 0; }
  [[nodiscard]] perception::Pose2 end() const noexcept { return point(size_ - 1); }

 private:
  [[nodiscard]] perception::Pose2 point(int i) const noexcept {
    return {points_[i][0], points_[i][1], points_[i][2]};
  }
  [[nodiscard]] perception::Pose2 at(double s) const noexcept;
  // Largest distance of the path between s0 and s1 from the straight line from `from` to the path
  // at s1.
  [[nodiscard]] double bend(const perception::Pose2& from, double s0, double s1) const noexcept;
  void advance(const perception::Pose2& X_WB, double& off) noexcept;

  PathFollowerConfig config_;
  std::uint64_t seq_ = 0;
  int size_ = 0;
  std::array<std::array<double, 3>, Path::kMaxPoints> points_{};
  std::array<double, Path::kMaxPoints> along_{};  // arc length up to point i
  double progress_ = 0;
  bool arrived_ = false;
};

}  // namespace tasks
