// The drawn numbers of a sample, before it is known how large its mover has to be. Internal to
// moving_*.cpp.
#pragma once

#include "tools/measure/accuracy/moving_sample.hpp"

namespace teletact {

// Values that are drawn once for a sample and held while the rest is drawn again, so that samples
// which are hard to place are not left out.
struct MovingKind {
  MoverKind kind = MoverKind::kBox;
  bool low = true, from_rest = true;
  Carry carry = Carry::kAtRest;
  MoverEnd end = MoverEnd::kBackAndForth;
  double step = 0.02;  // m or degrees a frame
};
[[nodiscard]] MovingKind draw_kind(rt::Random& rng, MoverKind kind, bool low);

struct MovingPlan {
  MoverKind kind = MoverKind::kBox;
  Carry carry = Carry::kAtRest;
  MoverEnd end = MoverEnd::kBackAndForth;
  bool from_rest = true, enters = false, vertical_axis = true, on_floor = true;
  int still = 60, move = 70, rest = 50;  // frames
  double step = 0.02;                    // m or degrees a frame
  double distance_m = 1.5;
  double share = 0.1;             // wanted
  double person_m = 1.7;          // height: of a person the distance follows, not the size
  double lateral = 0;             // place across the image, of half its width
  double phi_rad = 0, climb = 0;  // direction of the motion against the camera's right; upwards
  double turn_rad = 0;            // of a box, a door, an arm's first link
  double middle = 0.5;            // of the excursion, where the mover is placed
  double excursion = 1;           // m or degrees at most
  std::array<double, 3> ratio{1, 1, 1};  // edges
  int links = 2;
  std::array<double, 3> bend{1, 1, 1};  // of the links' turns
  CameraWay way;
};

[[nodiscard]] MovingPlan draw_plan(rt::Random& rng, const MovingKind& of);

// The room with the mover of this size in it; `room` has none.
[[nodiscard]] MovingSample build_sample(const MovingPlan& plan, const drivers::WorldConfig& room,
                                        double size_m);

// Removes the things of `room` (by name) that stand in the mover's or the camera's way. False:
// mover or camera meet a wall, the floor, the ceiling, or each other.
[[nodiscard]] bool make_way(rt::NonRealtime& nrt, const MovingSample& sample,
                            drivers::WorldConfig& room);

}  // namespace teletact
