#include "tasks/graph/capture_node.hpp"

#include "tasks/edges/output_hash.hpp"
#include "tasks/graph/node_parts.hpp"

namespace tasks {

CaptureNode::CaptureNode(rt::NonRealtime& nrt, const GraphConfig& config, const RobotSetup& setup,
                         RobotCells& cells)
    : task_(nrt, config.capture, rt::Box::kRobot, setup.camera->intrinsics()),
      camera_(*setup.camera),
      cells_(cells),
      twin_cpu_(setup.camera_twin_cpu),
      hash_(setup.hash_outputs),
      frame_(std::make_unique<perception::RgbdFrame>()),
      limits_(config, cells.logs.get()) {
  in_.frame = frame_.get();
}

void CaptureNode::latch(const rt::Tick& tick, rt::JobRecord& record) noexcept {
  const auto status = camera_.poll(tick.start, *frame_);
  in_.fresh = status == drivers::CameraStatus::kFrame;
  out_.slot = &cells_.begin_write<EdgeId::kFrame>();
  out_.written = false;
  record.input_seq[sensed_input(TaskId::kCapture)] = frame_->seq;
  in_.demand = nullptr;
  if (!cells_.has<EdgeId::kDemand>()) return;
  const auto demand = cells_.take<EdgeId::kDemand, TaskId::kCapture>(record);
  if (!demand) return;
  latched_ = {demand.seq, demand.at, *demand};
  if (limits_.of<EdgeId::kDemand>().within(demand, tick.start)) in_.demand = &latched_.demand;
}

rt::Health CaptureNode::step(const rt::Tick& tick, rt::JobRecord& record) noexcept {
  health_ = task_.step(tick, in_, out_);
  record.work = out_.written ? out_.slot->depth_size + out_.slot->colour_size : 0;
  return health_;
}

void CaptureNode::commit(const rt::Tick& tick, rt::JobRecord& record) noexcept {
  if (out_.written) {
    if (hash_) {
      rt::Hash64 h;
      hash_output(h, *out_.slot);
      record.output_hash = h.digest();
    }
    cells_.publish<EdgeId::kFrame>(tick.start);
    in_.answered = out_.slot->demand;
  }
  publish_health(health_of(cells_, TaskId::kCapture), tick.start, health_);
  log_level(*cells_.logs, TaskId::kCapture, tick, logged_level_);
}

void CaptureNode::abandon(const rt::Tick&) noexcept {
  if (out_.written) task_.lost();
}

}  // namespace tasks
