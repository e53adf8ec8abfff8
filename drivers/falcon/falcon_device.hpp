// Novint Falcon, frame by frame over its FTDI chip.
//
// Exchange  The transport's event thread sends a frame whenever one has come (the device only
//           answers), with the newest torque there is; sense() and act() touch two lock-free cells
//           and compute the kinematics: no system call, no allocation, no wait.
// Delay     A sample is one frame period old when it comes (latency timer, 1 ms); the force
//           computed from it in between goes with the next frame: two periods, 2.0 ms on the twin
//           at every phase of the tick. Stated as delay_s = 2.5 ms and part of the limit 0.8 b /
//           (T/2 + t_d).
// States    RESET until all three encoders have met their index marks (the hand moves the grip once
//           out and in; the ring glows red), IDLE, FORCE, BRAKE. The device has no brakes and no
//           watchdog: BRAKE is torque zero, and the event thread sends zero when the owner's newest
//           command is 20 ms old. Over-speed brakes here too.
// Unplug    As the Omega: sense() false, an ordinary thread opens again; forces come with
//           request_enable() only. One made before the marks are met waits for them.
//
// The device's own axes F (drivers/falcon/falcon_kinematics.hpp): x right, y up, z toward the
// operator; so D = (-z, -x, y) about (0, 0, 125 mm). Directions and torque scale are libnifalcon's,
// seen on no hardware of ours. One owner thread for sense() and act(); the rest from any.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "config/schema.hpp"
#include "drivers/falcon/falcon_frame.hpp"
#include "drivers/falcon/falcon_kinematics.hpp"
#include "drivers/falcon/falcon_transport.hpp"
#include "drivers/haptic/device_minder.hpp"
#include "drivers/haptic/exchange_histogram.hpp"
#include "drivers/haptic/force_gate.hpp"
#include "drivers/haptic/haptic_device.hpp"
#include "rt/channel/latest.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/result.hpp"

namespace drivers {

// Section [device.falcon].
struct FalconConfig {
  std::string firmware;  // the vendor's file; needed once after power-on
  double force_limit_N = 8.9;
  double mass_kg = 0.2;
  double damping_N_s_per_m = 2.0;
  double coulomb_N = 0.3;
  double delay_s = 0.0025;
  double speed_limit_m_per_s = 1.0;
  double counts_per_N_m = 10000;
  int torque_limit_cnt = 4096;
  double watchdog_s = 0.020;
  double lost_after_s = 0.1;
  double retry_s = 0.5;
  int event_priority = 0;
  std::string measured;  // when mass, damping and friction were measured; empty: assumed

  void describe(config::Section& s) {
    s.text("firmware", firmware, {}, "the vendor's firmware file; needed once after power-on");
    s.number("force_limit_N", force_limit_N, 0.1, 8.9, "saturation of the force");
    s.number("mass_kg", mass_kg, 0.01, 5, "effective mass at the tip (assumed)");
    s.number("damping_N_s_per_m", damping_N_s_per_m, 0, 100, "viscous friction b (assumed)");
    s.number("coulomb_N", coulomb_N, 0, 5, "Coulomb friction c (assumed)");
    s.number("delay_s", delay_s, 0.001, 0.02, "sample to force, beyond the hold");
    s.number("speed_limit_m_per_s", speed_limit_m_per_s, 0.05, 5, "over it the driver brakes");
    s.number("counts_per_N_m", counts_per_N_m, 100, 1e6, "motor scale (not calibrated)");
    s.integer("torque_limit_cnt", torque_limit_cnt, 1, 32767,
              "largest motor value; all three scale");
    s.number("watchdog_s", watchdog_s, 0.002, 0.020, "no command for so long: zero is sent");
    s.number("lost_after_s", lost_after_s, 0.01, 5, "no frame for so long: the device is gone");
    s.number("retry_s", retry_s, 0.01, 60, "between two tries to open after an unplug");
    s.integer("event_priority", event_priority, 0, 97, "SCHED_FIFO of the USB thread; 0: ordinary");
    s.text("measured", measured, {}, "when teletact identify measured them; empty: assumed");
  }
};

struct FalconCounters {
  std::uint64_t frames = 0, damaged = 0, line_errors = 0, samples = 0, repeats = 0;
  std::uint64_t leaps = 0, unsolved = 0, saturated = 0, refused_commands = 0;
  std::uint64_t kicks = 0, starved = 0, losses = 0, reopened = 0;
};

class FalconDevice final : public HapticDevice, private FalconTransport::Listener {
 public:
  static constexpr std::uint8_t kClutchButton = 2;  // of the grip's four; the others mark
  // Opens the transport; the error is one line.
  using Opener = std::function<rt::Result<std::unique_ptr<FalconTransport>>()>;

  // Throws std::runtime_error with one line.
  FalconDevice(rt::NonRealtime&, const FalconConfig&, Opener open);
  ~FalconDevice() override;

  // What a configuration states of the device, without one.
  [[nodiscard]] static DeviceProperties properties_of(const FalconConfig&) noexcept;
  [[nodiscard]] DeviceProperties properties() const noexcept override {
    return properties_of(config_);
  }
  [[nodiscard]] bool sense(rt::Time now, StylusSample& out) noexcept override;
  void act(rt::Time now, const ForceCommand& command) noexcept override;
  void request_enable() noexcept override { gate_.ask(); }
  void make_safe() noexcept override { gate_.make_safe(); }

  [[nodiscard]] FalconCounters counters() const noexcept;
  // Frame out to frame in.
  [[nodiscard]] const ExchangeHistogram& round_trips() const noexcept { return round_trips_; }
  [[nodiscard]] ForceOffCause force_off_cause() const noexcept { return cause_.load(); }
  [[nodiscard]] bool connected() const noexcept { return link_.load() == Link::kLive; }
  [[nodiscard]] const std::string& description() const noexcept { return description_; }

  [[nodiscard]] static perception::Vec3 to_D(const perception::Vec3& p_F) noexcept {
    return {-(p_F.z() - FalconKinematics::kCentreZ_m), -p_F.x(), p_F.y()};
  }
  [[nodiscard]] static perception::Vec3 direction_to_F(const perception::Vec3& d_D) noexcept {
    return {-d_D.y(), d_D.z(), -d_D.x()};
  }
  [[nodiscard]] static perception::Vec3 to_F(const perception::Vec3& p_D) noexcept {
    return direction_to_F(p_D) + perception::Vec3(0, 0, FalconKinematics::kCentreZ_m);
  }

 private:
  enum class Link : std::uint8_t { kLive, kLost };
  struct Raw {
    FalconReport report;
    std::uint32_t session = 0;
  };
  struct Torque {
    std::array<std::int16_t, 3> counts{};
    bool forces = false;
  };
  using Count = std::atomic<std::uint64_t>;

  void on_packet(std::span<const std::uint8_t> packet, std::int64_t t_ns) noexcept override;
  void on_time(std::int64_t t_ns) noexcept override;
  void on_lost() noexcept override;
  void send_next(std::int64_t t_ns) noexcept;

  [[nodiscard]] std::string open();
  [[nodiscard]] std::string boot(FalconTransport&) const;
  [[nodiscard]] bool mind();
  [[nodiscard]] bool take(const FalconReport& report, rt::Time now) noexcept;
  [[nodiscard]] bool plausible(const std::array<std::int16_t, 3>& counts, rt::Time now) noexcept;
  void watch_speed(const perception::Vec3& p_D, rt::Time now) noexcept;
  void brake(ForceOffCause cause) noexcept;
  [[nodiscard]] DeviceState state() const noexcept;

  FalconConfig config_;
  Opener opener_;
  std::string description_;
  std::unique_ptr<FalconTransport> transport_;
  rt::Latest<Raw> raw_;        // event thread -> owner
  rt::Latest<Torque> torque_;  // owner -> event thread
  std::atomic<Link> link_{Link::kLost};
  ForceGate gate_;
  std::atomic<bool> braked_{false}, all_homed_{false};
  std::atomic<ForceOffCause> cause_{ForceOffCause::kNone};
  std::atomic<std::uint32_t> session_{0};  // one a successful open

  // The event thread's.
  FalconFramer framer_;
  std::int64_t sent_ns_ = 0, heard_ns_ = 0, command_ns_ = 0;
  std::uint64_t command_seq_ = 0;
  bool awaited_ = false;

  // The owner's.
  bool forces_ = false, have_counts_ = false, have_sample_ = false;
  int far_ = 0, fast_ = 0, unhomed_ = 0;
  bool button_before_ = false, clutch_before_ = false;
  std::uint64_t taken_seq_ = 0;
  std::array<std::int16_t, 3> counts_{}, far_counts_{};
  perception::Vec3 p_F_{0, 0, FalconKinematics::kCentreZ_m};
  perception::Vec3 theta_ = perception::Vec3::Zero();
  StylusSample last_;

  struct Counts {
    Count frames{0}, damaged{0}, line_errors{0}, samples{0}, repeats{0}, leaps{0}, unsolved{0};
    Count saturated{0}, refused{0}, kicks{0}, starved{0}, losses{0}, reopened{0};
  } n_;
  ExchangeHistogram round_trips_{2'000'000};

  DeviceMinder minder_;  // last: ends before what it works on
};

// Reads the firmware's file; the error is one line.
[[nodiscard]] rt::Result<std::vector<std::uint8_t>> read_falcon_firmware(const std::string& path);

}  // namespace drivers
