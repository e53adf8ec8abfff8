#include "tools/desk/desk_events.hpp"

#include <stdexcept>

#include "tools/desk/desk_words.hpp"
#include "tools/record/box_recorder.hpp"

namespace teletact {

DeskEvents::DeskEvents(rt::Time epoch, const std::string& path) : epoch_(epoch) {
  if (path.empty()) return;
  file_.reset(std::fopen(path.c_str(), "w"));
  if (!file_) throw std::runtime_error(path + ": can not be written");
}

void DeskEvents::add(rt::Time now, std::string kind, std::string text) {
  const double t_s = rt::seconds(now - epoch_);
  if (file_) {
    std::fprintf(file_.get(), "%.3f %s %s\n", t_s, kind.c_str(), text.c_str());
    std::fflush(file_.get());
  }
  ++all_;
  events_.push_back({t_s, std::move(kind), std::move(text)});
  if (events_.size() > kMost) events_.pop_front();
}

void DeskEvents::watch(const OperatorView& seen, rt::Time now) {
  const double t_s = rt::seconds(now - epoch_);
  if (seen.mode.seq != 0 && (seen.mode.mode != mode_ || seen.mode.cause != cause_)) {
    mode_ = seen.mode.mode;
    cause_ = seen.mode.cause;
    mode_since_s_ = t_s;
    std::string text = mode_text(mode_);
    if (cause_ != rt::kNoFault) text += ": " + fault_text(cause_) + fault_advice(cause_);
    add(now, "mode", text);
  }
  if (seen.robot.fault != robot_fault_) {
    robot_fault_ = seen.robot.fault;
    robot_fault_since_s_ = t_s;
    if (robot_fault_ != rt::kNoFault) add(now, "robot", fault_text(robot_fault_));
  }
  if (seen.task.phase != phase_) {
    phase_ = seen.task.phase;
    const std::string goal = goal_text(seen.task);
    add(now, "task", phase_text(phase_) + (goal.empty() ? "" : ", " + goal));
  }
  if (seen.camera.tracking != tracking_) {
    tracking_ = seen.camera.tracking;
    add(now, "tracking", tracking_text(tracking_));
  }
  if (seen.objects_named != named_) {
    named_ = seen.objects_named;
    add(now, "object", "object " + std::to_string(named_));
  }
}

}  // namespace teletact
