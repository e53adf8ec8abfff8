// The product's CAN driver in a thread of 1 kHz, with a note of each job: what the bus said, and
// whether the states are what the motors truly do.
#pragma once

#include <atomic>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "drivers/can/can_motor_bus.hpp"
#include "drivers/can/socket_port.hpp"
#include "tests/vm/guest/can_modules.hpp"

namespace vm {

class CanDriver {
 public:
  struct Job {
    std::int64_t start_ns = 0, cpu_ns = 0, age_ns = 0;  // age: of the states
    drivers::BusStatus in{}, out{};
    drivers::can::PortState port{};
    drivers::can::BusState bus{};
    bool wrong = false;  // states that no motor had
    [[nodiscard]] bool down() const noexcept {
      return in == drivers::BusStatus::kDown || out == drivers::BusStatus::kDown;
    }
    [[nodiscard]] bool lost() const noexcept { return in == drivers::BusStatus::kFrameLost; }
    [[nodiscard]] bool good() const noexcept {
      return in == drivers::BusStatus::kOk && out == drivers::BusStatus::kOk;
    }
  };
  CanDriver(rt::NonRealtime&, const std::string& iface, const CanModules&);
  ~CanDriver();
  CanDriver(const CanDriver&) = delete;
  CanDriver& operator=(const CanDriver&) = delete;

  void wait(int jobs) const;  // until as many more have ended
  void rearm() { rearm_ = true; }
  void hang(bool on) { hangs_ = on; }
  void make_safe() { bus_.make_safe(); }  // from the caller's thread
  [[nodiscard]] std::size_t count() const noexcept { return count_.load(); }
  // Those that have ended stay as they are.
  [[nodiscard]] const Job& job(std::size_t i) const { return jobs_[i]; }
  template <class Is>
  [[nodiscard]] int how_many(std::size_t from, Is is) const {
    int n = 0;
    for (std::size_t i = from; i < count(); ++i) n += is(jobs_[i]) ? 1 : 0;
    return n;
  }
  // The first that begins at or after the instant; count(): none.
  [[nodiscard]] std::size_t first_after(std::int64_t ns) const;
  template <class Is>
  [[nodiscard]] std::size_t first(std::size_t from, Is is) const {
    while (from < count() && !is(jobs_[from])) ++from;
    return from;
  }
  // Read between jobs or with some of the last one's changes.
  [[nodiscard]] const drivers::can::PortCounters& port() const { return port_->counters(); }
  [[nodiscard]] const drivers::can::CanMotorBus::Counters& bus() const { return bus_.counters(); }

 private:
  void live();
  void one(Job&);
  [[nodiscard]] bool wrong(std::int64_t now, std::int64_t age_ns) const;

  const CanModules& modules_;
  std::unique_ptr<drivers::can::CanPort> port_;
  drivers::can::CanMotorBus bus_;
  drivers::MotorSetpoints setpoints_;
  drivers::MotorStates states_;
  std::vector<Job> jobs_;
  std::atomic<std::size_t> count_{0};
  std::atomic<bool> rearm_{false}, hangs_{false}, ends_{false};
  std::thread thread_;
};

}  // namespace vm
