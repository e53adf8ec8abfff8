#include "tasks/graph/haptic_node.hpp"

#include "tasks/edges/output_hash.hpp"
#include "tasks/graph/node_parts.hpp"

namespace tasks {

HapticNode::HapticNode(rt::NonRealtime& nrt, const GraphConfig& config, const OperatorSetup& setup,
                       OperatorCells& cells, double period_s)
    : task_(nrt, config.haptic, setup.device->properties(), period_s,
            0.5 * config.fusion.tsdf.voxel_size_m * config.fusion.patch_nodes),
      device_(*setup.device),
      cells_(cells),
      twin_cpu_(setup.device_twin_cpu),
      hash_(setup.hash_outputs),
      limits_(config, cells.logs.get()) {}

void HapticNode::latch(const rt::Tick& tick, rt::JobRecord& record) noexcept {
  in_.stylus_ok = device_.sense(tick.start, in_.stylus);
  in_.patch_newest = nullptr;
  if (task_.wants_patch()) {
    const auto patch = cells_.take<EdgeId::kPatch, TaskId::kHaptic>(record);
    in_.patch_newest = patch.value;
    // Only logged here: the task ramps the force down, because it may first have to finish a blend.
    static_cast<void>(limits_.of<EdgeId::kPatch>().within(patch, tick.start));
  }
  if (cells_.has<EdgeId::kSurface>()) {
    // Read in place: the one that is latched stays as it is until the next latch.
    const auto surface = cells_.take<EdgeId::kSurface, TaskId::kHaptic>(record);
    in_.surface = surface.value;
    static_cast<void>(limits_.of<EdgeId::kSurface>().within(surface, tick.start));
    in_.surface_stale = limits_.of<EdgeId::kSurface>().state() == LimitWatch::State::kSilent;
  }
  const auto mode = cells_.take<EdgeId::kMode, TaskId::kHaptic>(record);
  if (mode) in_.mode = *mode;
  const bool may_push = in_.mode.mode == Mode::kHold || in_.mode.mode == Mode::kEngaged;
  if (!limits_.of<EdgeId::kMode>().within(mode, tick.start) && may_push)
    in_.mode.mode = Mode::kRampDown;
  // While the clutch is held the workspace turns to where the camera looks, of which the operator
  // sees the image.
  const auto camera = cells_.take<EdgeId::kCameraPose, TaskId::kHaptic>(record);
  in_.clutch = in_.stylus_ok && in_.stylus.clutch;
  if (!limits_.of<EdgeId::kCameraPose>().within(camera, tick.start))
    in_.view_yaw_rad.reset();
  else if (camera->claimed)
    in_.view_yaw_rad = yaw_of_view(camera->X_WC.linear());
  // A hold that a ramp down led to has its cause. The hand stays limp until the next engage: force
  // does not come back by a timeout.
  if (in_.mode.mode == Mode::kHold && in_.mode.cause != rt::kNoFault)
    in_.mode.mode = Mode::kRampDown;
  record.input_seq[sensed_input(TaskId::kHaptic)] = in_.stylus.seq;
}

rt::Health HapticNode::step(const rt::Tick& tick, rt::JobRecord& record) noexcept {
  health_ = task_.step(tick, in_, out_);
  record.work = out_.telemetry.work;
  return health_;
}

void HapticNode::commit(const rt::Tick& tick, rt::JobRecord& record) noexcept {
  device_.act(tick.start, out_.force);
  HapticState& hand = cells_.begin_write<EdgeId::kHand>();
  hand = out_.state;
  const bool hand_out = cells_.publish<EdgeId::kHand>(tick.start);
  for (int i = 0; i < out_.event_count; ++i) send(tick, out_.events[static_cast<std::size_t>(i)]);
  publish_health(health_of(cells_, TaskId::kHaptic), tick.start, health_);
  const auto& t = out_.telemetry;
  HapticSample s;
  s.stamp = tick.start;
  s.p_WH = to_floats(out_.state.p_WH);
  s.p_WP = to_floats(out_.state.p_WP);
  s.f_W = to_floats(out_.state.f_H_W);
  s.penetration_m = static_cast<float>(t.penetration_m);
  s.force_N = static_cast<float>(out_.force.f_H_D.norm());
  s.step_raw_N = static_cast<float>(t.step_raw_N);
  s.step_N = static_cast<float>(t.step_N);
  s.gain = static_cast<float>(t.gain);
  s.energy_J = static_cast<float>(t.energy_J);
  s.booked_J = static_cast<float>(t.booked_J);
  s.patch_age_s = static_cast<float>(t.patch_age_s);
  s.reach = static_cast<float>(t.reach);
  s.work = t.work;
  s.contacts = out_.state.contacts;
  s.in_contact = t.in_contact;
  s.guard_active = t.guard_active;
  s.guard_use = t.guard_use;
  s.stale = t.stale;
  s.held = t.held;
  s.button = out_.state.button;
  s.clutched = t.clutched;
  s.device_state = static_cast<std::uint8_t>(in_.stylus.state);
  s.finite = out_.force.f_H_D.allFinite();
  cells_.haptic_samples.try_push(s);
  if (!hash_) return;
  rt::Hash64 h;
  hash_output(h, out_.force.f_H_D);
  if (hand_out) hash_output(h, hand);
  for (int i = 0; i < out_.event_count; ++i)
    hash_output(h, out_.events[static_cast<std::size_t>(i)]);
  record.output_hash = h.digest();
}

void HapticNode::send(const rt::Tick& tick, const TouchEvent& event) noexcept {
  cells_.push<EdgeId::kTouch>(event, touch_gap_);
  auto& logs = *cells_.logs;
  auto& log = logs.of(TaskId::kHaptic);
  if (touch_gap_) log.write(logs.events_lost, tick.start, event.seq);
  if (event.kind == TouchEvent::Kind::kContactBegin) {
    log.write(logs.contact, tick.start, event.p_W.x(), event.p_W.y(), event.p_W.z(), event.force_N);
  }
  if (event.kind == TouchEvent::Kind::kSurfaceLeft)
    log.write(logs.surface_left, tick.start, event.p_W.x(), event.p_W.y(), event.p_W.z());
}

}  // namespace tasks
