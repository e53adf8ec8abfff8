// What the console, the recorder and the report see of a run: one small record a job, by Ring, read
// by an ordinary thread. Watching changes nothing: a full ring drops and counts.
#pragma once

#include <cstdint>

#include "drivers/link/encoded_frame.hpp"
#include "rt/channel/ring.hpp"
#include "tasks/contract/messages.hpp"

namespace tasks {

struct HapticSample {
  rt::Time stamp{};
  std::array<float, 3> p_WH{}, p_WP{}, f_W{};
  float penetration_m = 0, force_N = 0, step_raw_N = 0, step_N = 0, gain = 0;
  float energy_J = 0, booked_J = 0, patch_age_s = 0;
  float reach = 0;  // of the hand at the device, over its workspace's radius
  std::uint32_t work = 0;
  std::int32_t contacts = 0;
  bool in_contact = false, guard_active = false, guard_use = false, stale = false, held = false;
  bool button = false, clutched = false, finite = true;
  std::uint8_t device_state = 0;  // drivers::DeviceState
};

struct FusionSample {
  rt::Time stamp{};
  rt::Time exposure{};
  std::array<float, 3> p_WC{};
  std::array<float, 4> q_WC{};  // x y z w
  std::uint64_t work = 0;
  std::uint32_t blocks = 0;
  std::uint32_t moving_cells = 0;  // of the ground, that something moves in
  float moving_share = 0;          // of the image, of its readings
  bool consumed = false, tracked = false, claimed = false, integrated = false;
};

struct RobotSample {
  rt::Time stamp{};
  float x_m = 0, y_m = 0, yaw_rad = 0;  // odometry
  float tracking_error_m = 0, goal_distance_m = 0, speed_m_per_s = 0;
  std::uint64_t goal_seq = 0, path_seq = 0;
  bool driving = false;
  std::uint8_t mode = 0;
};

// A picture or a robot state that arrived, by the link's thread.
struct LinkSample {
  rt::Time stamp{};                 // of the arrival
  rt::Time made{};                  // middle of the exposure, or when the state was taken
  std::int64_t made_remote_ns = 0;  // the same on the clock of the robot's box
  std::uint32_t bytes = 0;          // on the link, header included
  bool picture = false, key = false;
  drivers::Spared spared{};
};

using HapticSamples = rt::Ring<HapticSample, 8192>;
using FusionSamples = rt::Ring<FusionSample, 512>;
using LinkSamples = rt::Ring<LinkSample, 4096>;
using RobotSamples = rt::Ring<RobotSample, 8192>;

}  // namespace tasks
