#include "tools/record/latched_inputs.hpp"

namespace teletact {

StatusInput status_input(const tasks::LatchedStatus& s) noexcept {
  StatusInput in;
  in.last_heard_ns = s.last_heard_ns;
  in.round_trip_ns = s.round_trip_ns;
  in.uncertainty_ns = s.uncertainty_ns;
  in.engage = s.engage;
  in.refused = s.refused;
  in.expected = s.expected;
  in.closed = s.closed;
  in.session = s.session;
  in.ramp_down = s.ramp_down;
  in.stop = s.stop;
  in.clear = s.clear;
  in.watchdog_bit = s.watchdog_bit;
  return in;
}

TouchInput touch_input(std::uint64_t taken, const tasks::LatchedStatus& s) noexcept {
  TouchInput in;
  in.taken = taken;
  in.full = s.events_full;
  if (!s.act) return in;
  in.acted = 1;
  in.kind = static_cast<std::uint8_t>(s.act->kind);
  in.turns = s.act->turns;
  in.seq = s.act->seq;
  in.stamp_ns = rt::ns_of(s.act->stamp);
  in.p_W = {s.act->p_W.x(), s.act->p_W.y(), s.act->p_W.z()};
  in.normal_W = {s.act->normal_W.x(), s.act->normal_W.y(), s.act->normal_W.z()};
  in.yaw_rad = s.act->yaw_rad;
  return in;
}

DriveInput drive_input(const tasks::LatchedStatus& s) noexcept {
  DriveInput in;
  in.status = status_input(s);
  in.number = s.drive_number;
  in.seq = s.drive.seq;
  in.stamp_ns = rt::ns_of(s.drive.stamp);
  in.published_ns = rt::ns_of(s.drive_at);
  in.vx = s.drive.vx;
  in.vy = s.drive.vy;
  in.wz = s.drive.wz;
  in.held = s.drive.held;
  return in;
}

SceneInput scene_input(const tasks::LatchedStatus& s) noexcept {
  SceneInput in;
  in.mesh_taken = s.mesh_taken;
  if (!s.edit) return in;
  in.seq = s.edit->seq;
  in.stamp_ns = rt::ns_of(s.edit->stamp);
  in.centre_W = s.edit->centre_W;
  in.half_m = s.edit->half_m;
  in.yaw_rad = s.edit->yaw_rad;
  in.id = s.edit->id;
  in.kind = static_cast<std::uint8_t>(s.edit->kind);
  in.taken = 1;
  return in;
}

CameraInput camera_input(std::uint8_t status, const tasks::LatchedDemand& d) noexcept {
  CameraInput in;
  in.status = status;
  in.coarser = d.demand.coarser;
  in.key = d.demand.key;
  in.rate_kbit_per_s = d.demand.rate_kbit_per_s;
  in.number = d.number;
  in.seq = d.demand.seq;
  in.made_ns = rt::ns_of(d.demand.made);
  in.published_ns = rt::ns_of(d.at);
  return in;
}

}  // namespace teletact
