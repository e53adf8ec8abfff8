// robot_io of the robot's box in the guest: the product's task with its safety chain and its bus,
// one job a millisecond. Supervision and the operator are the case's: a mode and a clear.
#pragma once

#include <unistd.h>

#include <array>
#include <atomic>
#include <thread>

#include "drivers/gpio/safety_io.hpp"
#include "drivers/youbot_bus/ethercat_motor_bus.hpp"
#include "rt/clock/box_time.hpp"
#include "rt/sched/admission.hpp"
#include "rt/sched/real_executor.hpp"
#include "tasks/robot_io/robot_io_task.hpp"
#include "tests/vm/guest/say.hpp"

namespace vm {

class RobotJob final : public rt::TaskBody {
 public:
  RobotJob(rt::NonRealtime& nrt, drivers::SafetyIo& chain,
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
    if (health_.fault >= 500 && health_.fault < 600) {
      ++faults_[health_.fault - 500U];
      if (health_.fault != fault_) began_ns_[health_.fault - 500U] = rt::ns_of(tick.start);
    }
    wheel_rad_ = in_.motors.wheel_rad[0];
    wheel_rad_per_s_ = in_.motors.wheel_rad_per_s[0];
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
  // When the first job began that reported it the last time; zero: none did.
  [[nodiscard]] std::int64_t began_ns(rt::FaultId id) const { return began_ns_.at(id - 500U); }
  // Of the first wheel, as the bus told it last.
  [[nodiscard]] double wheel_rad() const noexcept { return wheel_rad_.load(); }
  [[nodiscard]] double wheel_rad_per_s() const noexcept { return wheel_rad_per_s_.load(); }
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
  drivers::SafetyIo& chain_;
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
  std::array<std::atomic<std::int64_t>, 100> began_ns_{};
  std::atomic<double> wheel_rad_{0}, wheel_rad_per_s_{0};
  std::atomic<rt::FaultId> fault_{0};
  std::atomic<bool> rearming_{false};
  std::atomic<std::uint64_t> jobs_{0};
};

inline bool bring_up(rt::NonRealtime& nrt, drivers::ethercat::Master& master) {
  using drivers::ethercat::Master;
  for (const auto step : {&Master::find, &Master::configure, &Master::start}) {
    const auto done = (master.*step)(nrt);
    if (!done) return check("chain in OP", false, done.error());
  }
  return true;
}

// The job at 1 kHz, until person(epoch_ns) has told its story on a thread of its own: a hand is not
// held up by a program. Jobs that were missed while timed() are what it returns.
template <class Person, class Timed>
std::uint64_t run_robot(rt::NonRealtime& nrt, RobotJob& job, Person person, Timed timed) {
  constexpr int kHandPriority = 92;
  // While threads begin, and the slaves are brought to OP anew, jobs may be late.
  constexpr std::uint64_t kSettle = 400;
  rt::PlacedTask task;
  task.spec.name = "robot_io";
  task.spec.rate = {1000, 1};
  task.spec.budget = std::chrono::microseconds{200};
  task.body = &job;
  task.priority = rt::kTopTaskPriority;
  rt::RunPlan plan;
  plan.epoch_host_ns = rt::monotonic_ns() + 300'000'000;
  plan.duration = std::chrono::seconds{120};
  std::uint64_t missed = 0;
  rt::RealExecutor<rt::Plain> executor(
      nrt, {task}, rt::Plain{},
      [&](const rt::JobRecord& r) {
        if (r.k >= kSettle && r.missed() && timed()) ++missed;
      },
      [](const rt::SentinelRecord&) {});
  std::thread hand([&] {
    become_real_time(kHandPriority);
    while (job.jobs() == 0) ::usleep(1000);
    person(plan.epoch_host_ns);
    executor.request_stop();
  });
  executor.run(plan);
  hand.join();
  return missed;
}

}  // namespace vm
