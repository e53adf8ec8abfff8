#include "tools/host/replay_feeds.hpp"

namespace teletact {

void set_words(tasks::LinkStatus& link, tasks::OperatorRequests& requests, const StatusInput& s) {
  link.last_heard_ns.store(s.last_heard_ns);
  link.round_trip_ns.store(s.round_trip_ns);
  link.uncertainty_ns.store(s.uncertainty_ns);
  link.refused.store(s.refused != 0);
  link.expected.store(s.expected != 0);
  link.closed.store(s.closed != 0);
  link.session.store(s.session);
  requests.engage.store(s.engage);
  requests.ramp_down.store(s.ramp_down != 0);
  requests.stop.store(s.stop != 0);
  requests.clear.store(s.clear != 0);
  requests.watchdog_bit.store(s.watchdog_bit != 0);
}

void set_scene(tasks::OperatorGraph& graph, const SceneInput& s, rt::Hash64& inputs) {
  graph.requests().mesh_taken.store(s.mesh_taken);
  inputs.word(s.taken);
  if (s.taken == 0) return;
  tasks::SceneEdit edit;
  edit.seq = s.seq;
  edit.stamp = rt::time_from_ns(s.stamp_ns);
  edit.kind = static_cast<tasks::SceneEdit::Kind>(s.kind);
  edit.id = s.id;
  edit.centre_W = s.centre_W;
  edit.half_m = s.half_m;
  edit.yaw_rad = s.yaw_rad;
  inputs.word(s.kind);
  for (const double x : s.centre_W) inputs.value(x);
  for (const double x : s.half_m) inputs.value(x);
  static_cast<void>(
      graph.cells().ring<tasks::EdgeId::kEdit, tasks::TaskId::kFusion>().try_push(edit));
}

void set_act(tasks::OperatorGraph& graph, const TouchInput& in, rt::Hash64& inputs) {
  inputs.word(in.acted);
  if (in.acted == 0) return;
  tasks::OperatorAct act;
  act.seq = in.seq;
  act.stamp = rt::time_from_ns(in.stamp_ns);
  act.kind = static_cast<tasks::OperatorAct::Kind>(in.kind);
  act.turns = in.turns != 0;
  act.p_W = {in.p_W[0], in.p_W[1], in.p_W[2]};
  act.normal_W = {in.normal_W[0], in.normal_W[1], in.normal_W[2]};
  act.yaw_rad = in.yaw_rad;
  inputs.word(in.kind);
  for (const double x : in.p_W) inputs.value(x);
  static_cast<void>(
      graph.cells().ring<tasks::EdgeId::kAct, tasks::TaskId::kPlanning>().try_push(act));
}

void set_drive(tasks::OperatorGraph& graph, const DriveInput& in, rt::Hash64& inputs) {
  using tasks::EdgeId;
  if (in.number == 0) return;
  inputs.word(in.seq);
  for (const double x : {in.vx, in.vy, in.wz}) inputs.value(x);
  auto& cell = graph.cells().of<EdgeId::kDrive>().cell;  // past its gate: it has been through it
  while (cell.latest_seq() < in.number) {
    cell.begin_write() = {in.seq, rt::time_from_ns(in.stamp_ns), in.held != 0, in.vx, in.vy, in.wz};
    cell.publish(rt::time_from_ns(in.published_ns));
  }
}

void set_demand(tasks::RobotGraph& graph, const CameraInput& in, rt::Hash64& inputs) {
  using tasks::EdgeId;
  if (in.number == 0 || !graph.cells().has<EdgeId::kDemand>()) return;
  inputs.word(in.seq);
  inputs.word(in.key);
  auto& cell = graph.cells().of<EdgeId::kDemand>().cell;  // past its gate: it has been through it
  while (cell.latest_seq() < in.number) {
    cell.begin_write() = {in.seq, rt::time_from_ns(in.made_ns), in.rate_kbit_per_s, in.coarser,
                          in.key};
    cell.publish(rt::time_from_ns(in.published_ns));
  }
}

}  // namespace teletact
