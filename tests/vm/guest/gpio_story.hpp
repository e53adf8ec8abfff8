// A person at the switches of the guest's robot, a supervision that is the case, and what is seen
// on the wire meanwhile.
#pragma once

#include <unistd.h>

#include <string>
#include <vector>

#include "rt/clock/box_time.hpp"
#include "tests/vm/guest/robot_job.hpp"
#include "tests/vm/guest/say.hpp"
#include "tests/vm/guest/sim_lines.hpp"
#include "tests/vm/guest/wire_tap.hpp"

namespace vm {

// Offsets on the chip.
inline constexpr int kEstop = 0, kEstop2 = 1, kEnable = 2, kBeat = 3, kLamp = 4;
inline constexpr double kDebounce_ms = 4, kDisagree_ms = 20, kBeat_ms = 2;
inline constexpr std::int64_t kPeriod_ns = 1'000'000;
// From an edge to the wire: a period, and what a job begins late.
inline constexpr std::int64_t kLimit_ns = kPeriod_ns + 300'000;

class GpioStory {
 public:
  GpioStory(RobotJob& job, WireTap& tap, SimLines lines, std::int64_t epoch_ns, int chain_pid,
            std::string live)
      : job_(job),
        tap_(tap),
        lines_(std::move(lines)),
        epoch_ns_(epoch_ns),
        chain_pid_(chain_pid),
        live_(std::move(live)) {}

  void tell_all(int presses);
  // Not while two frames a job are waited for in vain beside the chain, which is this processor's
  // load too; nor while the kernel takes the chip away, and whoever asks it for a line waits.
  [[nodiscard]] static bool timed() noexcept { return timed_.load(); }

 private:
  void taped_switch();
  void presses(int n);
  void short_presses();
  void contacts_differ();
  void enable_let_go();
  void heartbeat();
  void bus_lost();
  void chip_gone();

  // Each: true, it came to that in time.
  bool drive_on(bool with_switch = true);
  template <class Is>
  bool until(Is is, int ms) const {
    for (int i = 0; i < ms; ++i) {
      if (is()) return true;
      ::usleep(1000);
    }
    return is();
  }
  void close_estop() const {
    lines_.close(kEstop);
    lines_.close(kEstop2);
  }
  void open_estop() const {
    lines_.open(kEstop);
    lines_.open(kEstop2);
  }
  // Frames from this one on that are no motor stop.
  [[nodiscard]] std::size_t driving_from(std::size_t frame) const;
  [[nodiscard]] int beats(int ms) const;

  struct Press {
    std::int64_t before_ns, after_ns;  // around what made the edge
    std::int64_t edge_ns;              // the kernel's time of it, as the driver says
    std::int64_t wire_ns;              // of the first frame with motor stop; 0: none
    std::size_t driving_after = 0;     // frames behind that one that let a wheel turn
    bool drove = false;                // until then the wheels were driven
  };
  [[nodiscard]] Press press(std::int64_t phase_ns, bool shortly);
  void judge(const std::string& what, const std::vector<Press>&) const;

  static inline std::atomic<bool> timed_{true};
  RobotJob& job_;
  WireTap& tap_;
  SimLines lines_;
  std::int64_t epoch_ns_;
  int chain_pid_;
  std::string live_;
};

}  // namespace vm
