#include "tasks/planning/grasp.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace tasks {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kDegree = kPi / 180;
constexpr double kLevel = 0.5;      // least level share of an axis that closes: 60 degrees from up
constexpr double kTie_m = 1e-3;     // widths that count as one
constexpr double kStand_m = 0.005;  // distances of the base that are tried
constexpr double kNarrowStand_m =
    0.02;  // least run of these: the base does not stand to the millimetre

// Of the box, along a unit direction.
double width_along(const Vec3& d_W, const ObjectBox& box) noexcept {
  return (box.X_WO.linear().transpose() * d_W).cwiseAbs().dot(box.extent_m);
}

bool within(double angle, const std::array<double, 2>& range_deg) noexcept {
  return angle >= range_deg[0] * kDegree && angle <= range_deg[1] * kDegree;
}

struct Place {
  Vec3 up, floor, robot;
};

Vec3 level(const Vec3& v, const Vec3& up) noexcept { return v - v.dot(up) * up; }

// Fills base_m and joint_rad: the middle of the longest run of distances from which the wrist gets
// there.
bool reach(double height_m, double pitch_rad, double depth_m, const GraspConfig& c,
           Grasp& g) noexcept {
  const bool from_above = pitch_rad > 0.75 * kPi;
  const double wrist_z = height_m + (from_above ? c.hand_m : 0.0) - c.shoulder_z_m;
  const double hand_x = from_above ? 0.0 : c.hand_m;
  // `depth_m`: the object reaches so much nearer to the base than the grasp point.
  const double nearest = c.front_m + c.front_clear_m + depth_m;
  int run = 0, best = 0, best_end = -1;
  const int steps = static_cast<int>((c.upper_m + c.fore_m) / kStand_m) + 1;
  std::array<double, 3> joints{};
  for (int n = 0; n <= steps; ++n) {
    const double x = n * kStand_m;
    const bool stands = c.shoulder_x_m + x + hand_x >= nearest;
    run = stands && arm_joints(x, wrist_z, pitch_rad, c, joints) ? run + 1 : 0;
    if (run > best) best = run, best_end = n;
  }
  if ((best - 1) * kStand_m < kNarrowStand_m) return false;
  const double x = (best_end - 0.5 * (best - 1)) * kStand_m;
  g.base_m = c.shoulder_x_m + x + hand_x;
  g.base_most_m = c.shoulder_x_m + best_end * kStand_m + hand_x;
  g.base_least_m = g.base_most_m - (best - 1) * kStand_m;
  return arm_joints(x, wrist_z, pitch_rad, c, g.joint_rad);
}

// The narrower grasp is better; of two equally narrow ones the one from above, of two from the side
// the one less askew.
bool better(const Grasp& a, const Grasp& b, const Vec3& away_W) noexcept {
  if (std::abs(a.width_m - b.width_m) > kTie_m) return a.width_m < b.width_m;
  if (a.kind != b.kind) return a.kind == Grasp::Kind::kTop;
  return a.kind == Grasp::Kind::kSide &&
         a.X_WG.linear().col(2).dot(away_W) > b.X_WG.linear().col(2).dot(away_W) + 1e-9;
}

// The grasp that closes along `closing` (level, unit); false: it can not be reached.
bool make(Grasp::Kind kind, const Vec3& closing, const ObjectBox& box, const Place& place,
          const GraspConfig& c, Grasp& g) noexcept {
  const Vec3 centre = box.X_WO * box.centre_m;
  Vec3 approach = -place.up;
  if (kind == Grasp::Kind::kSide) {
    approach = closing.cross(place.up).normalized();
    if (approach.dot(centre - place.robot) < 0) approach = -approach;
  }
  const double thick = width_along(approach, box);
  // Of the tips behind the face that they meet first.
  double in = std::min(c.finger_m, thick / 2);
  Vec3 tips = centre + (in - thick / 2) * approach;
  double height = (tips - place.floor).dot(place.up);
  if (kind == Grasp::Kind::kTop && height < c.floor_m) {
    tips += (c.floor_m - height) * place.up;
    in -= c.floor_m - height;
    height = c.floor_m;
    if (in <= 0) return false;
  }
  g.kind = kind;
  g.X_WG.linear().col(0) = closing;
  g.X_WG.linear().col(1) = approach.cross(closing);
  g.X_WG.linear().col(2) = approach;
  g.X_WG.translation() = tips;
  g.before_W = tips - c.before_m * approach;
  g.width_m = width_along(closing, box);
  g.opening_m = g.width_m + c.clearance_m;
  const double pitch = kind == Grasp::Kind::kTop ? kPi : kPi / 2;
  // From above the base may come from any side: with its farthest corner clear of the object it is
  // clear from all.
  const double nearer = kind == Grasp::Kind::kTop
                            ? 0.5 * level(box.X_WO.linear() * box.extent_m, place.up).norm()
                            : in;
  return reach(height, pitch, nearer, c, g);
}

}  // namespace

void GraspConfig::describe(config::Section& s) {
  s.number("opening_most_m", opening_most_m, 0.01, 0.2, "of the gripper, by the fingers' mount")
      .number("stroke_m", stroke_m, 0.005, 0.1, "both jaws together")
      .number("clearance_m", clearance_m, 0, 0.05, "both sides together, on the way")
      .number("finger_m", finger_m, 0.005, 0.2, "how deep the fingers go in at most")
      .number("before_m", before_m, 0, 0.5, "of the point before the grasp")
      .number("floor_m", floor_m, 0, 0.1, "the tips stay above the floor by this")
      .number("front_m", front_m, 0.1, 1, "of the base, from its centre")
      .number("front_clear_m", front_clear_m, 0, 1, "between it and the object")
      .number("shoulder_x_m", shoulder_x_m, -1, 1, "joint 2 before the centre of the base")
      .number("shoulder_z_m", shoulder_z_m, 0, 2, "joint 2 above the floor")
      .number("upper_m", upper_m, 0.05, 1, "joint 2 to 3")
      .number("fore_m", fore_m, 0.05, 1, "joint 3 to 4")
      .number("hand_m", hand_m, 0.05, 1, "joint 4 to the finger tips")
      .numbers("range2_deg", range2_deg, -180, 180, "of joint 2, from the upright pose")
      .numbers("range3_deg", range3_deg, -180, 180, "of joint 3")
      .numbers("range4_deg", range4_deg, -180, 180, "of joint 4");
}

std::string_view text_of(Grasp::Refused refused) noexcept {
  switch (refused) {
    case Grasp::Refused::kNo:
      return "";
    case Grasp::Refused::kTooWide:
      return "too wide for the gripper";
    case Grasp::Refused::kTooThin:
      return "too thin for the gripper's stroke";
    case Grasp::Refused::kOutOfReach:
      return "out of the arm's reach";
    case Grasp::Refused::kBadInput:
      break;
  }
  return "not an object";
}

bool arm_joints(double x_m, double z_m, double pitch_rad, const GraspConfig& c,
                std::array<double, 3>& joint_rad) noexcept {
  const double d2 = x_m * x_m + z_m * z_m, a = c.upper_m, b = c.fore_m;
  const double cosine = (d2 - a * a - b * b) / (2 * a * b);
  if (!(cosine >= -1 && cosine <= 1)) return false;
  const double bend = std::acos(cosine);
  // Elbow up first: it is what keeps the arm off the floor.
  for (const double q3 : {bend, -bend}) {
    const double q2 = std::atan2(x_m, z_m) - std::atan2(b * std::sin(q3), a + b * std::cos(q3));
    const double q4 = pitch_rad - q2 - q3;
    if (!within(q2, c.range2_deg) || !within(q3, c.range3_deg) || !within(q4, c.range4_deg))
      continue;
    joint_rad = {q2, q3, q4};
    return true;
  }
  return false;
}

Grasp find_grasp(const ObjectBox& box, const Vec3& up_W, const Vec3& floor_W, const Vec3& robot_W,
                 const GraspConfig& c) noexcept {
  Grasp best;
  if (!box.X_WO.matrix().allFinite() || !box.centre_m.allFinite() || !box.extent_m.allFinite() ||
      !(box.extent_m.minCoeff() > 0) || !up_W.allFinite() || !floor_W.allFinite() ||
      !robot_W.allFinite() || std::abs(up_W.norm() - 1) > 1e-6)
    return best;
  const Place place{up_W, floor_W, robot_W};
  const double most = c.opening_most_m - c.clearance_m, least = c.opening_most_m - c.stroke_m;
  const Vec3 away = box.X_WO * box.centre_m - robot_W;
  bool any_wide = false, any_fits = false, found = false;
  for (int axis = 0; axis < 3; ++axis) {
    Vec3 closing = level(box.X_WO.linear().col(axis), up_W);
    if (closing.norm() < kLevel) continue;
    closing.normalize();
    const double width = width_along(closing, box);
    any_wide = any_wide || width > most;
    if (width > most || width < least) continue;
    any_fits = true;
    for (const auto kind : {Grasp::Kind::kTop, Grasp::Kind::kSide}) {
      Grasp g;
      if (!make(kind, closing, box, place, c, g) || (found && !better(g, best, away))) continue;
      best = g;
      found = true;
    }
  }
  best.refused = found      ? Grasp::Refused::kNo
                 : any_fits ? Grasp::Refused::kOutOfReach
                 : any_wide ? Grasp::Refused::kTooWide
                            : Grasp::Refused::kTooThin;
  if (!found) best.kind = Grasp::Kind::kNone;
  return best;
}

}  // namespace tasks
