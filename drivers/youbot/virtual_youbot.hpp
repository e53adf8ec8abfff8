// Twin of the youBot's motor bus: MotorBus in front of a RobotPlant.
//
// Watchdog  no cycle for 100 ms: the motors stop and flag bit 16 latches on every wheel;
//           setpoints have no effect until rearm() (SAP 158 on the real boards). It is armed by the
//           first cycle.
// Safe      make_safe() may come from any thread; it holds from the last cycle on and stays until
//           rearm(), which only the owner calls (an operator's act).
// Faults    planned by time in config or set by the owner: frame lost, bus down, stuck wheel,
//           not-a-number angle.
// History   every sense() publishes the true state; the camera twin and the console read it from
//           their own threads without waiting.
#pragma once

#include <atomic>
#include <cstdint>

#include "drivers/youbot/motor_bus.hpp"
#include "drivers/youbot/motor_flags.hpp"
#include "drivers/youbot/robot_plant.hpp"

namespace drivers {

struct BusFaults {
  std::uint32_t lose_frames = 0;  // this many cycles from now are lost, both ways
  bool down = false;
  int stuck_wheel = -1;
  bool nan_angle = false;  // wheel 0 reports NaN
};

// True poses of the last second: one writer, any number of readers, nobody waits. All fields are
// atomics, each entry carries its own sequence number (odd while written); readers retry elsewhere.
class PoseHistory {
 public:
  struct Sample {
    rt::Time time{};
    perception::Pose2 X_WB;
    perception::Twist2 v_B;
    std::uint32_t collisions = 0;
    double path_m = 0;
  };
  void publish(const Sample& s) noexcept;
  // The pose at `t`: between two samples on the arc of the earlier one's twist; after the newest
  // sample on its twist for at most `extrapolate`. False: not that old, not that new, or never.
  [[nodiscard]] bool at(rt::Time t, Sample& out,
                        rt::Nanos extrapolate = std::chrono::milliseconds{50}) const noexcept;
  [[nodiscard]] bool newest(Sample& out) const noexcept;

 private:
  static constexpr std::size_t kSlots = 1024;        // a second at 1 kHz
  static constexpr std::size_t kKept = kSlots - 24;  // of these a reader asks for
  struct Slot {
    std::atomic<std::uint64_t> sequence{0};
    std::atomic<std::int64_t> ns{0};
    std::array<std::atomic<double>, 7> value{};
    std::atomic<std::uint32_t> collisions{0};
  };
  [[nodiscard]] bool read(std::uint64_t index, Sample& out) const noexcept;
  std::array<Slot, kSlots> slots_{};
  std::atomic<std::uint64_t> count_{0};
};

struct VirtualYoubotConfig {
  int watchdog_ms = 100;

  void describe(config::Section& s) {
    s.integer("watchdog_ms", watchdog_ms, 1, 60000, "motors stop after this pause in bus traffic");
  }
};

class VirtualYoubot final : public MotorBus {
 public:
  // The plant's owner from now on.
  VirtualYoubot(rt::NonRealtime&, const VirtualYoubotConfig&, RobotPlant plant);

  [[nodiscard]] BusStatus sense(rt::Time now, MotorStates& states) noexcept override;
  [[nodiscard]] BusStatus act(rt::Time now, const MotorSetpoints& setpoints) noexcept override;
  [[nodiscard]] BusDetail detail() const noexcept override {
    return {.trouble = safe() ? BusTrouble::kMadeSafe : BusTrouble::kNone};
  }
  void make_safe() noexcept override { safe_.store(true, std::memory_order_release); }

  // Owner's thread only, from here on.
  void rearm() noexcept override {
    timeout_ = false;
    safe_.store(false, std::memory_order_release);
  }
  [[nodiscard]] BusFaults& faults() noexcept { return faults_; }
  [[nodiscard]] const RobotPlant& plant() const noexcept { return plant_; }
  [[nodiscard]] bool timed_out() const noexcept { return timeout_; }
  // Thread CPU spent in the simulation, if a CPU clock was given (twin time is no part of a
  // budget).
  using CpuClock = std::int64_t (*)() noexcept;
  void set_cpu_clock(CpuClock clock) noexcept { cpu_clock_ = clock; }
  [[nodiscard]] std::int64_t twin_cpu_ns() const noexcept { return twin_cpu_ns_; }

  [[nodiscard]] const PoseHistory& history() const noexcept { return history_; }
  [[nodiscard]] bool safe() const noexcept { return safe_.load(std::memory_order_acquire); }

 private:
  void simulate(rt::Time now) noexcept;

  VirtualYoubotConfig config_;
  RobotPlant plant_;
  BusFaults faults_;
  std::atomic<bool> safe_{false};
  bool started_ = false, timeout_ = false;
  bool losing_ = false;   // this cycle
  bool powered_ = false;  // by the last act()
  rt::Time last_exchange_{};
  std::uint64_t seq_ = 0;
  PoseHistory history_;
  CpuClock cpu_clock_ = nullptr;
  std::int64_t twin_cpu_ns_ = 0;
};

}  // namespace drivers
