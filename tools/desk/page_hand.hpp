// A page beside the haptic device: between the haptic task and its device.
//
//   want()   a hand at the page in place of the one at the device. While somebody holds it, the
//            task is given where the page wants the hand, approached at a hand's speed; the device
//            gets no force. When it is let go, or `until` has passed, the hand goes back to where
//            the device is.
//   hold_clutch()   as a clutch of the device. With the forces off a press of the clutch would ask
//            for them again (tools/touch/force_act.hpp): that is for the person at the device
//            alone, so no press from here begins while they are off.
//   map()    the device's motion made smaller and turned before the task sees it:
//
//              p_DH = share R_z(yaw) p_device,   f_device = R_z(-yaw) f_H_D
//
//            `share` is at most 1: the spring that the device feels is softer by it and its force
//            as large as before, so what is stable at the scene's scale stays so. It is taken over
//            while the hand is free: the clutch is held, the force has faded out, and the task is
//            given the new place at a hand's speed. So neither the hand in the scene nor the force
//            jumps. What it is beyond that: docs/desk.md, Scale and turn.
//
// A recorder outside of it records what the task was given.
// want(), map(): the console's thread. sense(), act(): the haptic task's. Nothing allocates or
// waits. Frames: W world, D haptic base, H stylus tip.
#pragma once

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <numbers>
#include <optional>

#include "drivers/haptic/haptic_device.hpp"
#include "perception/geometry/pose.hpp"
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
  struct Mapping {
    double share = 1;                 // of the scene's scale, kLeastShare to 1
    std::optional<double> yaw_W_rad;  // "away from the operator" looks there; none: as before
  };
  static constexpr double kSpeed_m_per_s = 0.15;  // at the device
  static constexpr double kLeastShare = 0.125;

  // `takes_over` false: the device's own hand is never replaced by the page's.
  PageHand(rt::NonRealtime& nrt, drivers::HapticDevice& inner, bool takes_over = true)
      : inner_(inner),
        reach_m_(inner.properties().workspace_radius_m),
        takes_over_(takes_over),
        wanted_(nrt, {1}),
        mappings_(nrt, {1}) {}
  // Before the first job: whose mapping places the hand.
  void bind(const tasks::HapticTask& task) noexcept { task_ = &task; }

  [[nodiscard]] bool takes_over() const noexcept { return takes_over_; }
  // As a clutch of the device that is held, until it is said otherwise. Any thread.
  void hold_clutch(bool held) noexcept { clutch_.store(held, std::memory_order_relaxed); }

  void want(const Target& target, rt::Time now) noexcept {
    wanted_.begin_write() = target;
    wanted_.publish(now);
  }
  // False: out of range, nothing changes.
  [[nodiscard]] bool map(const Mapping& mapping, rt::Time now) noexcept {
    const bool good = mapping.share >= kLeastShare && mapping.share <= 1 &&
                      (!mapping.yaw_W_rad || std::isfinite(*mapping.yaw_W_rad));
    if (!good) return false;
    mappings_.begin_write() = mapping;
    mappings_.publish(now);
    return true;
  }
  // In force now. Any thread.
  [[nodiscard]] double share() const noexcept { return share_.load(std::memory_order_relaxed); }

  [[nodiscard]] drivers::DeviceProperties properties() const noexcept override {
    return inner_.properties();
  }
  [[nodiscard]] bool sense(rt::Time now, drivers::StylusSample& out) noexcept override {
    if (!inner_.sense(now, out)) return false;
    const auto target = wanted_.acquire_if_new(0);
    const bool held = task_ != nullptr && target && target->held && now <= target->until;
    const bool forces = out.state == drivers::DeviceState::kForce;
    pressed_ = clutch_.load(std::memory_order_relaxed) && (pressed_ || forces);
    const bool clutch = mind_mapping(now, held, forces, out.p_DH) || pressed_;
    out.clutch = out.clutch || clutch;
    out.p_DH = mapped(out.p_DH);
    const double step = kSpeed_m_per_s * std::clamp(rt::seconds(now - last_), 0.0, 0.005);
    last_ = now;
    if (!held && !away_) return true;
    if (!away_) p_DH_ = out.p_DH;
    perception::Vec3 goal_D = out.p_DH;
    if (held) goal_D = task_->workspace().to_device(target->p_W);
    // Beyond its reach the workspace itself moves there (tasks/haptic/workspace.hpp, border).
    if (const double far_m = goal_D.norm(); far_m > reach_m_) goal_D *= reach_m_ / far_m;
    const perception::Vec3 way = goal_D - p_DH_;
    const bool there = way.norm() <= step;
    p_DH_ = there ? goal_D : perception::Vec3(p_DH_ + way * (step / way.norm()));
    away_ = held || !there || (out.p_DH - goal_D).norm() > 1e-5;
    out.p_DH = p_DH_;
    out.button = held && target->button;
    out.clutch = clutch || (held && target->clutch);
    out.repeated = false;
    return true;
  }
  void act(rt::Time now, const drivers::ForceCommand& command) noexcept override {
    force_N_ = command.f_H_D.norm();
    if (away_) return inner_.act(now, drivers::ForceCommand{});
    if (yaw_rad_ == 0) return inner_.act(now, command);
    inner_.act(now, {turn(-yaw_rad_) * command.f_H_D});
  }
  void request_enable() noexcept override { inner_.request_enable(); }
  void make_safe() noexcept override { inner_.make_safe(); }

 private:
  static constexpr double kNoForce_N = 0.01;
  // A force that is not gone by then does not go: the old mapping stays.
  static constexpr rt::Nanos kPatience = std::chrono::seconds{1};

  [[nodiscard]] static perception::Mat3 turn(double yaw_rad) noexcept {
    return perception::rotation_about_z(yaw_rad);
  }
  // The same bits where nothing was ever asked for.
  [[nodiscard]] perception::Vec3 mapped(const perception::Vec3& p_D) const noexcept {
    if (share() == 1 && yaw_rad_ == 0) return p_D;
    return share() * (turn(yaw_rad_) * p_D);
  }
  // True: the clutch is held for a mapping that is taken over. `p_D`: of the device.
  [[nodiscard]] bool mind_mapping(rt::Time now, bool held, bool forces,
                                  const perception::Vec3& p_D) noexcept {
    if (task_ == nullptr) return false;
    const auto wanted = mappings_.acquire_if_new(0);
    if (wanted && wanted.seq != mapping_seq_ && !asked_ && forces) asked_ = now;
    if (asked_) {
      const rt::Nanos waited = now - *asked_;
      const bool faded =
          waited >= rt::nanos_from_seconds(task_->config().ramp_s + 0.01) && force_N_ < kNoForce_N;
      if (!away_ && !held && !faded && waited < kPatience) return true;
      mapping_seq_ = wanted.seq;
      asked_.reset();
      if (away_ || held || faded) take(*wanted, p_D);
      settles_ = !held && away_;
    }
    settles_ = settles_ && !held && away_;
    return settles_;
  }
  // From here on the hand is on its way from where it was to where this mapping has it.
  void take(const Mapping& mapping, const perception::Vec3& p_D) noexcept {
    if (!away_) p_DH_ = mapped(p_D);
    away_ = true;
    share_.store(mapping.share, std::memory_order_relaxed);
    if (!mapping.yaw_W_rad) return;
    const perception::Mat3& R_WD = task_->workspace().R_WD();
    yaw_rad_ = std::remainder(*mapping.yaw_W_rad - std::atan2(R_WD(1, 0), R_WD(0, 0)), kTurn_rad);
  }
  static constexpr double kTurn_rad = 2 * std::numbers::pi;

  drivers::HapticDevice& inner_;
  double reach_m_;
  bool takes_over_;
  rt::Latest<Target> wanted_;
  rt::Latest<Mapping> mappings_;
  const tasks::HapticTask* task_ = nullptr;
  std::atomic<bool> clutch_{false};
  std::atomic<double> share_{1};
  // All below by the haptic task's thread.
  bool pressed_ = false;  // the clutch, at the page
  double yaw_rad_ = 0;    // of what the task is given against the device
  std::uint64_t mapping_seq_ = 0;
  std::optional<rt::Time> asked_;  // a mapping waits for the force to fade
  bool settles_ = false;           // the hand goes over to a new mapping
  double force_N_ = 0;             // asked for last
  perception::Vec3 p_DH_{0, 0, 0};
  rt::Time last_{};
  bool away_ = false;  // not where the device is
};

}  // namespace teletact
