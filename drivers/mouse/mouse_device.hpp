// A mouse in place of a haptic device: a position at the mouse's own low rate, and no force. The
// person moves the point to the left and right (D's y), away and back (D's x), with the wheel up
// and down (z); the left button is the stylus button, the right one the clutch.
//
// Source    /dev/input/mice with the wheel's protocol (ImPS/2: four bytes a packet, asked for by
//           six sample-rate bytes), or any source that writes such packets. push() moves it too:
//           the console feeds it so.
// Real time sense() is one read() that does not wait, of at most 64 packets; act() does nothing.
// State     FORCE from the first read, so that it touches and marks; its force limit is zero. One
//           owner thread; push() from any one other.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <string>

#include "config/schema.hpp"
#include "drivers/haptic/haptic_device.hpp"
#include "rt/channel/ring.hpp"
#include "rt/memory/non_realtime.hpp"

namespace drivers {

// Section [device.mouse].
struct MouseConfig {
  std::string path = "/dev/input/mice";  // empty: push() only
  double metres_per_count = 5e-5;
  double metres_per_notch = 0.002;
  double workspace_radius_m = 0.075;

  void describe(config::Section& s) {
    s.text("path", path, {}, "where the packets come from; empty: the console only");
    s.number("metres_per_count", metres_per_count, 1e-7, 0.01, "hand metres a step of the mouse");
    s.number("metres_per_notch", metres_per_notch, 1e-6, 0.1, "hand metres a notch of the wheel");
    s.number("workspace_radius_m", workspace_radius_m, 0.01, 1, "reach from the centre");
  }
};

struct MouseMove {
  std::int32_t right = 0, up = 0, wheel = 0;  // counts; wheel: away from the hand is positive
  bool button = false, clutch = false;        // left, right
};

// ImPS/2 packets out of a byte stream that may begin anywhere.
class MouseParser {
 public:
  // True: this byte ended a packet; move() is it.
  [[nodiscard]] bool push(std::uint8_t byte) noexcept;
  [[nodiscard]] const MouseMove& move() const noexcept { return move_; }
  [[nodiscard]] std::uint64_t skipped() const noexcept { return skipped_; }

 private:
  std::array<std::uint8_t, 4> packet_{};
  std::size_t size_ = 0;
  MouseMove move_;
  std::uint64_t skipped_ = 0;
};

class MouseDevice final : public HapticDevice {
 public:
  // Throws std::runtime_error with one line: not there, no permission.
  MouseDevice(rt::NonRealtime&, const MouseConfig&);
  ~MouseDevice() override;

  // What a configuration states of the device, without one.
  [[nodiscard]] static DeviceProperties properties_of(const MouseConfig&) noexcept;
  [[nodiscard]] DeviceProperties properties() const noexcept override {
    return properties_of(config_);
  }
  [[nodiscard]] bool sense(rt::Time now, StylusSample& out) noexcept override;
  void act(rt::Time, const ForceCommand&) noexcept override {}
  void make_safe() noexcept override {}

  // One thread beside the owner. False: the queue is full, the motion is lost and counted there.
  bool push(const MouseMove& move) noexcept { return pushed_.try_push(move); }
  // The source ended (unplugged): the position stays.
  [[nodiscard]] bool source_lost() const noexcept { return lost_.load(); }

 private:
  void apply(const MouseMove& move) noexcept;
  void read_source() noexcept;

  MouseConfig config_;
  int fd_ = -1;
  MouseParser parser_;
  rt::Ring<MouseMove, 256> pushed_;
  std::atomic<bool> lost_{false};
  bool moved_ = true, button_ = false, clutch_ = false;
  perception::Vec3 p_ = perception::Vec3::Zero();
  StylusSample last_;
};

}  // namespace drivers
