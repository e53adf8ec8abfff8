// Switches, lamp and watchdog relay at simulated GPIO lines. What people and faults do to them are
// verbs, by the owner's thread, each at an instant of the caller's clock; edges carry that instant.
// At the start both contacts of the emergency stop are closed and the enable switch is held.
#pragma once

#include <array>
#include <vector>

#include "drivers/gpio/gpio_config.hpp"
#include "drivers/gpio/gpio_lines.hpp"
#include "rt/memory/non_realtime.hpp"

namespace drivers::gpio {

// [[robot.gpio.event]] of a scene.
struct TwinEvent {
  double at_s = 0;
  std::string what = "press";
  void describe(config::Section& s);
};

class GpioTwin final : public GpioLines {
 public:
  GpioTwin(rt::NonRealtime&, const GpioConfig::Lines& lines);

  [[nodiscard]] Drained drain(rt::Time now, std::span<LineEdge>) noexcept override;
  [[nodiscard]] bool levels(rt::Time now, std::uint32_t& active) noexcept override;
  [[nodiscard]] bool set(rt::Time now, int output, bool active) noexcept override;

  // ---- people
  void press(rt::Time at) noexcept;    // the emergency stop
  void release(rt::Time at) noexcept;  // of it
  void hold(rt::Time at) noexcept;     // the enable switch
  void let_go(rt::Time at) noexcept;
  // ---- faults
  void break_wire(rt::Time at) noexcept;  // of the first contact: open until mended
  void mend_wire(rt::Time at) noexcept;
  void weld_second(bool welded) noexcept { welded_ = welded; }  // the contact no longer opens
  // The switch closes with `edges` bounces, `gap` apart, from `at` on.
  void bounce(rt::Time at, int edges, rt::Nanos gap) noexcept;
  void lose_edges(bool on) noexcept { lose_ = on; }  // they never come; levels are right
  void unreadable(bool on) noexcept { unreadable_ = on; }
  void unwritable(bool on) noexcept { unwritable_ = on; }
  // ---- a scene's script, executed lazily at the next access; `epoch`: second 0
  void follow(rt::NonRealtime&, const std::vector<TwinEvent>& script, rt::Time epoch);

  // ---- what stands at the outputs
  [[nodiscard]] bool output(int i) const noexcept { return output_[static_cast<std::size_t>(i)]; }
  [[nodiscard]] std::uint64_t beats() const noexcept { return beats_; }
  // The relay: closed while edges came within `limit`.
  [[nodiscard]] bool relay_closed(rt::Time now, rt::Nanos limit) const noexcept {
    return beats_ > 0 && now - last_beat_ <= limit;
  }
  [[nodiscard]] std::uint64_t edges_lost() const noexcept { return lost_; }

 private:
  struct Move {
    int input;
    bool active;
    rt::Time at;
  };
  void advance(rt::Time now) noexcept;
  void act_on(const TwinEvent&, rt::Time at) noexcept;
  void move(int input, bool active, rt::Time at) noexcept;
  void take_place(const Move&) noexcept;
  void move_estop(bool closed, rt::Time at) noexcept;

  static constexpr std::size_t kMoves = 128;
  static constexpr std::size_t kQueue = 48;  // 16 a line, as in the kernel
  GpioConfig::Lines lines_;
  std::array<bool, kMostLines> level_{}, output_{};
  std::array<Move, kMoves> move_{};  // not yet taken place, in order of time
  std::size_t moves_ = 0;
  std::array<LineEdge, kQueue> queue_{};
  std::size_t queued_ = 0;
  bool overflow_ = false;
  bool pressed_ = false, broken_ = false, welded_ = false;
  bool lose_ = false, unreadable_ = false, unwritable_ = false;
  std::vector<TwinEvent> script_;
  std::size_t next_ = 0;
  rt::Time epoch_{};
  std::uint64_t beats_ = 0, lost_ = 0;
  rt::Time last_beat_{};
};

}  // namespace drivers::gpio
