// What the haptic task tells of a tick beside its force: for recording and figures; not a message
// of another task.
#pragma once

#include <cstdint>

#include "perception/geometry/pose.hpp"

namespace tasks {

struct HapticTelemetry {
  perception::Vec3 f_raw_D =
      perception::Vec3::Zero();  // spring, faded and limited, before the guard
  double step_raw_N = 0;         // |F_raw(k) - F_raw(k-1)|
  double step_N = 0;             // the same after all guards
  double penetration_m = 0;      // |p_WP - p_WH| in contact, scene metres
  double gain = 0;               // fade and ramps, 0..1
  double friction_N = 0;         // K |proxy with friction - frictionless proxy|
  double controller_N = 0;       // of the passivity controller
  double blend = 1;              // s of the running blend; 1 = settled
  double energy_J = 0;           // observer E
  double booked_J = 0;           // injections booked apart
  double credit_J = 0;           // dissipated by the device's own damping
  double patch_age_s = 0;
  double reach = 0;        // |p_DH| over the radius of the device's workspace; 1: at its edge
  std::uint32_t work = 0;  // field samples of this tick
  bool in_contact = false;
  bool guard_active = false;  // the slew guard changed the force
  bool guard_use = false;     // contact tick with |dF_raw| > K |dh| + 0.1 N
  bool limit_active = false;  // the force limit cut
  bool held = false;          // held contact frame in use
  bool unresolved = false;    // less than a voxel of solid is under the proxy or beside the hand
  bool near_edge = false;     // hand or proxy within two voxels of the window's edge
  bool stale = false;
  bool clutched = false;  // the hand in the scene stands while the device moves
  bool beyond = false;    // the hand is beyond the border: the workspace moves
  bool leaving =
      false;  // the surface under the hand went, or came too fast: the hand is being let go
};

}  // namespace tasks
