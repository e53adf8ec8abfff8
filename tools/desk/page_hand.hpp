// A hand at a page in place of the one at the device: between the haptic task and its device. While
// somebody at the page holds it, the task is given where the page wants the hand, approached at a
// hand's speed; the device gets no force. When it is let go, or `until` has passed, the hand goes
// back to where the device is. A recorder outside of it records what the task was given.
//
// want(): the console's thread. sense(), act(): the haptic task's. Nothing allocates or waits.
// Frames: W world, D haptic base, H stylus tip.
#pragma once

#include <algorithm>
#include <atomic>

#include "drivers/haptic/haptic_device.hpp"
#include "rt/channel/latest.hpp"
#include "tasks/haptic/haptic_task.hpp"

namespace teletact {

class PageHand final : public drivers::HapticDevice {
 public:
  struct Target {
    bool held = false;
    perception::Vec3 p_W{0, 0, 0};
    bool button = false, clutch = false;
    rt::Time until{};  // no longer held beyond it
  };
  static constexpr double kSpeed_m_per_s = 0.15;  // at the device

  PageHand(rt::NonRealtime& nrt, drivers::HapticDevice& inner)
      : inner_(inner), reach_m_(inner.properties().workspace_radius_m), wanted_(nrt, {1}) {}
  // Before the first job: whose mapping places the hand.
  void bind(const tasks::HapticTask& task) noexcept { task_ = &task; }

  // As a clutch of the device that is held, until it is said otherwise. Any thread.
  void hold_clutch(bool held) noexcept { clutch_.store(held, std::memory_order_relaxed); }

  void want(const Target& target, rt::Time now) noexcept {
    wanted_.begin_write() = target;
    wanted_.publish(now);
  }

  [[nodiscard]] drivers::DeviceProperties properties() const noexcept override {
    return inner_.properties();
  }
  [[nodiscard]] bool sense(rt::Time now, drivers::StylusSample& out) noexcept override {
    if (!inner_.sense(now, out)) return false;
    const auto target = wanted_.acquire_if_new(0);
    const bool held = task_ != nullptr && target && target->held && now <= target->until;
    const bool clutch = clutch_.load(std::memory_order_relaxed);
    out.clutch = out.clutch || clutch;
    if (!held && !away_) return true;
    if (!away_) p_DH_ = out.p_DH;
    perception::Vec3 goal_D = out.p_DH;
    if (held) goal_D = task_->workspace().to_device(target->p_W);
    // Beyond its reach the workspace itself moves there (tasks/haptic/workspace.hpp, border).
    if (const double far_m = goal_D.norm(); far_m > reach_m_) goal_D *= reach_m_ / far_m;
    const double step = kSpeed_m_per_s * std::clamp(rt::seconds(now - last_), 0.0, 0.005);
    const perception::Vec3 way = goal_D - p_DH_;
    p_DH_ += way.norm() > step ? perception::Vec3(way * (step / way.norm())) : way;
    away_ = held || (out.p_DH - p_DH_).norm() > 1e-5;
    last_ = now;
    out.p_DH = p_DH_;
    out.button = held && target->button;
    out.clutch = clutch || (held && target->clutch);
    out.repeated = false;
    return true;
  }
  void act(rt::Time now, const drivers::ForceCommand& command) noexcept override {
    inner_.act(now, away_ ? drivers::ForceCommand{} : command);
  }
  void request_enable() noexcept override { inner_.request_enable(); }
  void make_safe() noexcept override { inner_.make_safe(); }

 private:
  drivers::HapticDevice& inner_;
  double reach_m_;
  rt::Latest<Target> wanted_;
  const tasks::HapticTask* task_ = nullptr;
  std::atomic<bool> clutch_{false};
  perception::Vec3 p_DH_{0, 0, 0};
  rt::Time last_{};
  bool away_ = false;  // not where the device is
};

}  // namespace teletact
