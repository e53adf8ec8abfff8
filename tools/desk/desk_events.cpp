#include "tools/desk/desk_events.hpp"

#include <algorithm>
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

void DeskEvents::note(rt::Time now, std::string_view kind, std::string_view text) {
  if (!file_ || logged_bytes_ > kMostLogged) return;
  const int n = std::fprintf(file_.get(), "%.3f %.*s %.*s\n", rt::seconds(now - epoch_),
                             static_cast<int>(kind.size()), kind.data(),
                             static_cast<int>(text.size()), text.data());
  std::fflush(file_.get());
  logged_bytes_ += static_cast<std::uint64_t>(std::max(0, n));
  if (logged_bytes_ > kMostLogged)
    std::fprintf(file_.get(), "acts and answers are not logged from here on: too many\n");
}

void DeskEvents::watch(const OperatorView& seen, rt::Time now) {
  const double t_s = rt::seconds(now - epoch_);
  if (seen.mode.seq != 0 && (seen.mode.mode != mode_ || seen.mode.cause != cause_)) {
    mode_ = seen.mode.mode;
    cause_ = seen.mode.cause;
    mode_since_s_ = t_s;
    std::string text = mode_text(mode_);
    if (cause_ != rt::kNoFault)
      text += ": " + cause_text(cause_, seen.robot) + fault_advice(cause_);
    add(now, "mode", text);
  }
  // Of its modes only this one is news: the others follow what this box says itself.
  if (seen.robot.mode != robot_mode_ || seen.robot.mode_cause != robot_cause_) {
    robot_mode_ = seen.robot.mode;
    robot_cause_ = seen.robot.mode_cause;
    robot_mode_since_s_ = t_s;
    if (static_cast<tasks::Mode>(robot_mode_) == tasks::Mode::kSafeStop)
      add(now, "robot", "the robot's box: safe stop: " + fault_text(robot_cause_));
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
