// The robot's box without the rest: robot_io and supervision as they run in the graph, a virtual
// base, simulated safety lines, and an operator that is this test. Jobs every millisecond,
// supervision every tenth.
#pragma once

#include <array>
#include <vector>

#include "drivers/gpio/safety_chain.hpp"
#include "drivers/gpio/twin/gpio_twin.hpp"
#include "drivers/youbot/virtual_youbot.hpp"
#include "tasks/graph/robot_io_node.hpp"
#include "tasks/graph/supervision_nodes.hpp"

namespace tests {

using namespace std::chrono_literals;

// Keeps what passes, as the wire would.
class WatchedBus final : public drivers::MotorBus {
 public:
  explicit WatchedBus(drivers::MotorBus& inner) : inner_(inner) {}
  [[nodiscard]] drivers::BusStatus sense(rt::Time now,
                                         drivers::MotorStates& states) noexcept override {
    const auto status = down ? drivers::BusStatus::kDown : inner_.sense(now, states);
    before = states;
    return status;
  }
  [[nodiscard]] drivers::BusStatus act(rt::Time now,
                                       const drivers::MotorSetpoints& s) noexcept override {
    sent = s;
    sent_at = now;
    return down ? drivers::BusStatus::kDown : inner_.act(now, s);
  }
  [[nodiscard]] drivers::BusDetail detail() const noexcept override { return inner_.detail(); }
  void rearm() noexcept override { inner_.rearm(); }
  void make_safe() noexcept override { inner_.make_safe(); }
  drivers::MotorSetpoints sent;
  rt::Time sent_at{};
  drivers::MotorStates before;  // what the job that made `sent` had read
  bool down = false;

 private:
  drivers::MotorBus& inner_;
};

struct NoCamera final : drivers::Camera {
  [[nodiscard]] perception::Intrinsics intrinsics() const noexcept override {
    return {60, 60, 3.5, 2.5, 8, 6};
  }
  [[nodiscard]] double rate_hz() const noexcept override { return 30; }
  [[nodiscard]] drivers::CameraStatus poll(rt::Time, perception::RgbdFrame&) noexcept override {
    return drivers::CameraStatus::kNoFrame;
  }
};

inline drivers::gpio::GpioConfig safety_lines() {
  drivers::gpio::GpioConfig c;
  c.kind = "twin";
  c.estop_line = 0;
  c.estop_line_2 = 1;
  c.enable_line = 2;
  c.heartbeat_line = 3;
  c.lamp_line = 4;
  return c;
}

struct RobotRig {
  explicit RobotRig(drivers::gpio::GpioConfig lines = safety_lines(), bool fitted = true)
      : twin(startup.token(), lines.lines()), chain(startup.token(), lines, twin) {
    setup.bus = &bus;
    setup.camera = &camera;
    setup.safety = fitted ? &chain : nullptr;
    auto& nrt = startup.token();
    robot_io = std::make_unique<tasks::RobotIoNode>(nrt, config, setup, cells, link);
    supervision =
        std::make_unique<tasks::RobotSupervisionNode>(nrt, config, cells, link, requests, setup);
    link.expected = true;
  }

  // The operator's box renews the goal every 50 ms.
  void send_goal() {
    auto& g = cells.of<tasks::EdgeId::kGoal>().cell.begin_write();
    g = {};
    g.seq = ++goal_seq;
    g.made = now;
    g.valid_until = now + 300ms;
    g.x_m = goal_x_m;
    g.speed_limit_m_per_s = 0.5;
    g.engaged = drive ? 1 : 0;
    g.operator_engaged = engage ? 1 : 0;
    g.operator_clear = clear ? 1 : 0;
    cells.of<tasks::EdgeId::kGoal>().cell.publish(now, rt::Nanos{1000});
  }

  // One millisecond: the operator's message if due, a job of robot_io that begins `late` after its
  // release, and supervision.
  void job(rt::Nanos late = rt::Nanos{0}) {
    release += 1ms;
    now = release + late;
    link.last_heard_ns = rt::ns_of(now);
    if (k % 50 == 0 || say_now) send_goal();
    say_now = false;
    run(*robot_io, 1ms);
    if (k % 10 == 5) {
      tasks::publish_health(tasks::health_of(cells, tasks::TaskId::kCapture), now, {});
      run(*supervision, 10ms);
    }
    ++k;
  }
  void run(rt::TaskBody& body, rt::Nanos period) {
    rt::Tick t;
    t.k = k;
    t.release = release;
    t.start = now;
    t.period = period;
    record = {};
    body.latch(t, record);
    last_health = body.step(t, record);
    if (&body == robot_io.get()) health = last_health;
    body.commit(t, record);
  }
  void jobs(int n) {
    for (int i = 0; i < n; ++i) job();
  }
  [[nodiscard]] tasks::Mode mode() { return newest_mode().mode; }
  [[nodiscard]] tasks::ModeMsg newest_mode() {
    return robot_io->in().mode != nullptr ? *robot_io->in().mode : tasks::ModeMsg{};
  }
  // Each act must be seen as "no" before it counts.
  void press_clear() {
    clear = engage = false;
    say_now = true;
    jobs(12);
    clear = say_now = true;
    jobs(30);
    clear = false;
    say_now = true;
    jobs(12);
  }
  void press_engage() {
    engage = false;
    say_now = true;
    jobs(12);
    engage = say_now = true;
    jobs(25);
  }
  // From the start, or from a stop with its cause gone, to driving.
  void drive_on() {
    twin.let_go(now);
    jobs(30);
    twin.hold(now);
    jobs(30);
    press_clear();
    press_engage();
  }
  [[nodiscard]] double speed() const { return std::abs(robot.plant().state().v_B.vx); }

  rt::Startup startup;
  tasks::GraphConfig config;
  drivers::VirtualYoubot robot{
      startup.token(), {}, drivers::RobotPlant(startup.token(), {}, {}, {})};
  WatchedBus bus{robot};
  NoCamera camera;
  drivers::gpio::GpioTwin twin;
  drivers::gpio::SafetyChain chain;
  tasks::RobotSetup setup;
  tasks::RobotCells cells{startup.token()};
  tasks::LinkStatus link;
  tasks::OperatorRequests requests;
  std::unique_ptr<tasks::RobotIoNode> robot_io;
  std::unique_ptr<tasks::RobotSupervisionNode> supervision;
  rt::JobRecord record;
  rt::Health health, last_health;
  rt::Time release = rt::time_from_ns(1'000'000'000'000);
  rt::Time now = release;
  std::uint64_t k = 0, goal_seq = 0;
  double goal_x_m = 1000;
  bool engage = false, clear = false, drive = true, say_now = false;
};

}  // namespace tests
