// Bodies of the views, from what the console has seen: docs/console_protocol.md, Views. Pure: a
// value in, bytes out. Frame W, SI.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "perception/geometry/planar.hpp"
#include "perception/geometry/rgbd_frame.hpp"
#include "perception/ground/cost_map.hpp"
#include "tools/desk/click_worker.hpp"
#include "tools/host/console.hpp"

namespace teletact {

struct PoseView {
  enum Flag : std::uint32_t {
    kHandValid = 1U << 0U,
    kContact = 1U << 1U,
    kButton = 1U << 2U,
    kClutch = 1U << 3U,
    kRobotValid = 1U << 4U,
    kCameraClaimed = 1U << 5U,
    kCameraValid = 1U << 6U,
    kGoalEngaged = 1U << 7U,
    kRendersForce = 1U << 8U,
  };
  std::array<float, 3> hand{}, proxy{}, force_N{}, normal{};
  std::uint32_t flags = 0;
  float reach_m = 0;
  perception::Pose2 robot, predicted;  // in W
  perception::Twist2 v_B;
  std::array<double, 4> wheel_rad{};
  double error_m = 0;
  perception::Pose X_WC = perception::Pose::Identity();
  perception::Pose2 goal;
  std::uint8_t mode = 0, robot_mode = 0, phase = 0, tracking = 0;
  std::uint32_t path_seq = 0;
};
inline constexpr std::size_t kPoseViewBytes = 12 * 4 + 4 + 4 + 9 * 4 + 16 + 4 + 28 + 12 + 4 + 4;

[[nodiscard]] std::vector<std::uint8_t> pose_body(const PoseView& view);
[[nodiscard]] std::vector<std::uint8_t> cost_map_body(const perception::CostMap& map);
[[nodiscard]] std::vector<std::uint8_t> moving_body(const perception::CostMap& map);
[[nodiscard]] std::vector<std::uint8_t> selection_body(const Proposal& proposal);

// Where a camera is `s` seconds after it was at X_WC, carried by a base that is at base_W somewhere
// on the way and keeps its velocity v_B (of its own frame).
[[nodiscard]] perception::Pose carried(const perception::Pose& X_WC,
                                       const perception::Pose2& base_W,
                                       const perception::Twist2& v_B, double s);

// A camera's picture: depth as it is, colour as JPEG. Not thread-safe; allocates.
class PictureMaker {
 public:
  PictureMaker();
  ~PictureMaker();
  PictureMaker(const PictureMaker&) = delete;
  PictureMaker& operator=(const PictureMaker&) = delete;
  [[nodiscard]] std::vector<std::uint8_t> body(const perception::RgbdFrame& frame,
                                               const perception::Pose& X_WC);

 private:
  void* jpeg_;
};

}  // namespace teletact
