// robot_io of the robot's box in the guest: the product's task with its safety chain and its bus,
// one job a millisecond. Supervision and the operator are the case's: a mode and a clear.
#pragma once

#include <array>
#include <atomic>

#include "drivers/gpio/safety_chain.hpp"
#include "drivers/youbot_bus/ethercat_motor_bus.hpp"
#include "rt/sched/executor.hpp"
#include "rt/sched/task.hpp"
#include "tasks/robot_io/robot_io_task.hpp"

namespace vm {

class RobotJob final : public rt::TaskBody {
 public:
  RobotJob(rt::NonRealtime& nrt, drivers::gpio::SafetyChain& chain,
           drivers::youbot_bus::EtherCatMotorBus& bus)
      : task_(nrt, {}), chain_(chain), bus_(bus) {}

  std::atomic<tasks::Mode> mode{tasks::Mode::kInit};
  std::atomic<bool> clear{false};

  void latch(const rt::Tick& tick, rt::JobRecord&) noexcept override {
    chain_.sense(tick.start, in_.safety);
    in_.sent = sent_;
    in_.bus = bus_.sense(tick.start, in_.motors);
    in_.bus_detail = bus_.detail();
    if (tick.k % 20 == 0) {
      goal_.seq = ++goals_;
      goal_.made = tick.start;
      goal_.valid_until = tick.start + std::chrono::milliseconds{300};
      goal_.x_m = 1000;
      goal_.speed_limit_m_per_s = 0.5;
      goal_.engaged = goal_.operator_engaged = 1;
    }
    in_.goal = &goal_;
    mode_.mode = mode.load();
    mode_.clear = clear.load();
    in_.mode = &mode_;
    in_.link_heard = true;
    in_.link_heard_at = tick.start;
  }
  rt::Health step(const rt::Tick& tick, rt::JobRecord&) noexcept override {
    return health_ = task_.step(tick, in_, out_);
  }
  void commit(const rt::Tick& tick, rt::JobRecord&) noexcept override {
    if (out_.rearm_motors) bus_.rearm();
    sent_ = bus_.act(tick.start, out_.setpoints);
    if (out_.rearm_motors) chain_.allow_again();
    chain_.act(tick.start, out_.safety);
    if (tick.k % 10 == 5) supervise();
    if (in_.safety.estop_opened != rt::Time{}) opened_ns_ = rt::ns_of(in_.safety.estop_opened);
    if (health_.fault >= 500 && health_.fault < 600) ++faults_[health_.fault - 500U];
    fault_ = health_.fault;
    rearming_ = bus_.rearming();
    ++jobs_;
  }
  void make_safe() noexcept override { bus_.make_safe(); }

  // The kernel's time of the newest edge to open, as the driver tells it.
  [[nodiscard]] std::int64_t opened_ns() const noexcept { return opened_ns_.load(); }
  // Jobs that reported this fault, and the fault of the newest job.
  [[nodiscard]] std::uint64_t faults(rt::FaultId id) const { return faults_.at(id - 500U).load(); }
  [[nodiscard]] rt::FaultId fault() const noexcept { return fault_.load(); }
  [[nodiscard]] bool rearming() const noexcept { return rearming_.load(); }
  [[nodiscard]] std::uint64_t jobs() const noexcept { return jobs_.load(); }

 private:
  // As supervision does, every tenth job: a stop is latched, and ends by a clear that is pressed
  // when its cause is gone.
  void supervise() noexcept {
    if (health_.severity == rt::Severity::kSafeStop) {
      mode = tasks::Mode::kSafeStop;
    } else if (mode == tasks::Mode::kSafeStop && clear) {
      mode = tasks::Mode::kHold;
    }
  }

  tasks::RobotIoTask task_;
  drivers::gpio::SafetyChain& chain_;
  drivers::youbot_bus::EtherCatMotorBus& bus_;
  tasks::RobotIoTask::In in_;
  tasks::RobotIoTask::Out out_;
  tasks::ModeMsg mode_;
  drivers::RobotGoal goal_;
  std::uint64_t goals_ = 0;
  drivers::BusStatus sent_ = drivers::BusStatus::kOk;
  rt::Health health_;
  std::atomic<std::int64_t> opened_ns_{0};
  std::array<std::atomic<std::uint64_t>, 100> faults_{};
  std::atomic<rt::FaultId> fault_{0};
  std::atomic<bool> rearming_{false};
  std::atomic<std::uint64_t> jobs_{0};
};

}  // namespace vm
