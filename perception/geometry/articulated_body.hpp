// A robot as a tree of joints, with the solid shape of each link as capsules. One description
// (config/robots/*.toml) serves masking, collision, kinematics, twin and console.
//
// Frames: B the robot's base (docs/frames.md); L a link's own frame, at its joint. A joint at q
// puts its link at
//   X_PL(q) = X_PJ * motion(q - zero)      P the parent link, X_PJ from origin_m and rpy_deg
// where motion turns about `axis` (revolute), shifts along it (prismatic), or is nothing (fixed). A
// joint's coordinate is what the robot's driver reports.
//
// A capsule is all points within radius_m of the segment from_m .. to_m, in L. SI, radians.
#pragma once

#include <array>
#include <deque>
#include <span>
#include <string>
#include <vector>

#include "config/schema.hpp"
#include "perception/geometry/joint_angles.hpp"
#include "perception/geometry/pose.hpp"
#include "rt/result.hpp"

namespace perception {

struct Capsule {
  Vec3 a = Vec3::Zero(), b = Vec3::Zero();  // ends of the axis
  double radius = 0;
};

struct CapsuleConfig {
  std::array<double, 3> from_m{}, to_m{};
  double radius_m = 0.05;
  void describe(config::Section& s);
};

struct LinkConfig {
  std::string name, parent;  // parent empty: B itself
  std::string joint = "fixed";
  std::array<double, 3> origin_m{}, rpy_deg{};  // of the joint in the parent, at q = zero
  std::array<double, 3> axis{0, 0, 1};          // in the joint's frame
  double lower = 0, upper = 0;                  // rad, prismatic m
  double zero = 0;                              // q at which the link stands as origin and rpy say
  double max_speed = 0;                         // rad/s, m/s
  double max_effort = 0;                        // N m, N; 0: not known
  double mass_kg = 0;                           // 0: not known
  std::deque<CapsuleConfig> capsules;
  void describe(config::Section& s);
};

struct BaseBoxConfig {
  std::string name;
  std::array<double, 3> centre_m{}, size_m{0.1, 0.1, 0.1};  // upright in B
  void describe(config::Section& s);
};

struct RobotDescription {
  std::string name;
  std::deque<LinkConfig> links;  // a parent stands before its children
  std::deque<BaseBoxConfig> base_boxes;
  std::string gripper;                              // the link that holds things; empty: none
  std::array<double, 3> camera_position_m{};        // of the lens in B
  double camera_yaw_deg = 0, camera_pitch_deg = 0;  // positive: to the left, down
  void describe(config::Section& s);
  // Checks across keys: names used twice, parents that come later, axes of length 0, lower limits
  // above upper ones. One line: key, value, what is allowed.
  [[nodiscard]] rt::Result<bool> check() const;
};

// Reads and checks one; an error is one line with file, key, value and range.
[[nodiscard]] rt::Result<RobotDescription> load_robot(const std::string& path);

class ArticulatedBody {
 public:
  static constexpr int kMostLinks = 24, kMostCapsules = 48;
  using Links = std::array<Pose, kMostLinks>;

  // Throws std::invalid_argument where check() refuses, or for more than there is room for.
  explicit ArticulatedBody(const RobotDescription& description);

  struct Joint {
    enum class Kind : std::uint8_t { kRevolute, kPrismatic };
    Kind kind = Kind::kRevolute;
    int link = 0;
    std::string name;  // of its link
    double lower = 0, upper = 0, max_speed = 0;
  };
  [[nodiscard]] std::span<const Joint> joints() const noexcept { return joints_; }
  [[nodiscard]] int links() const noexcept { return static_cast<int>(links_.size()); }
  [[nodiscard]] int capsules() const noexcept { return static_cast<int>(capsules_.size()); }
  [[nodiscard]] int find(std::string_view link) const noexcept;    // -1: none
  [[nodiscard]] int gripper() const noexcept { return gripper_; }  // -1: none
  [[nodiscard]] int link_of(int capsule) const noexcept {
    return capsules_[static_cast<std::size_t>(capsule)].link;
  }

  // Every joint at its zero; the other parts of the state stay.
  void rest(std::span<double> q) const noexcept;

  // Computes X_BL of every link. q holds one value for each of joints(), in order; further values
  // are ignored, joints without a value stand at their zero.
  void forward(std::span<const double> q, Links& X_BL) const noexcept;
  // Capsule i in B.
  [[nodiscard]] Capsule capsule_B(int i, const Links& X_BL) const noexcept;
  // Largest distance of a point of a capsule (given in B, carried by `link`) from its computed
  // place, if each joint is off by up to `error` (the levers summed up) and has moved for `age_s`
  // at `speed`.
  [[nodiscard]] double reach_of_error(const Capsule& c_B, int link, const Links& X_BL,
                                      std::span<const double> speed, double error,
                                      double age_s) const noexcept;

 private:
  struct Link {
    std::string name;
    int parent = -1, joint = -1;
    Pose X_PJ = Pose::Identity();
    Vec3 axis = Vec3::UnitZ();
    double zero = 0;
    bool prismatic = false;
  };
  struct LinkCapsule {
    int link;
    Capsule c;
  };
  std::vector<Link> links_;
  std::vector<Joint> joints_;
  std::vector<LinkCapsule> capsules_;
  int gripper_ = -1;
};

}  // namespace perception
