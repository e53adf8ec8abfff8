// Twin of a Falcon at the wire: the FTDI chip (baud rate, line, modem lines, latency timer, packets
// with two status bytes), the boot monitor that takes the firmware, and the firmware that answers a
// frame with a frame; behind it the geometry, encoders with index marks, motors, and the mass,
// friction and hand of StylusPlant. Time is an argument; one thread.
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <span>
#include <vector>

#include "drivers/falcon/falcon_frame.hpp"
#include "drivers/falcon/falcon_kinematics.hpp"
#include "drivers/falcon/falcon_transport.hpp"
#include "drivers/haptic/stylus_plant.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/random.hpp"

namespace drivers {

struct FalconTwinConfig {
  StylusPlantConfig plant;             // the weight of its arm is not simulated
  std::vector<std::uint8_t> firmware;  // what the upload must be
  bool loaded = false;                 // the firmware is still there from before
  bool homed = false;
  double counts_per_N_m = 10000;
  std::int64_t process_ns = 200'000;  // frame in to answer on the line
  std::uint64_t seed = 1;             // of damaged bytes
};

struct FalconTwinFaults {
  bool unplugged = false;
  bool silent = false;                     // takes frames, answers none
  std::uint32_t lose_answers = 0;          // that many next answers are lost
  std::uint32_t damage_answers = 0;        // one byte of each is changed at random
  std::uint32_t noise_bytes = 0;           // that many random bytes before the next answer
  std::uint32_t double_answers = 0;        // sent twice
  std::uint32_t line_errors = 0;           // that many packets carry an overrun flag
  std::array<std::int16_t, 3> slip_cnt{};  // encoders that slipped
  bool wrong_echo = false;                 // the upload comes back changed
  bool deaf_monitor = false;               // the boot monitor never answers
  bool refuse_control = false;             // control requests fail
};

class FalconTwin {
 public:
  FalconTwin(rt::NonRealtime&, const FalconTwinConfig&, HandScript* hand = nullptr,
             const perception::Vec3& start_p_D = perception::Vec3::Zero());

  // ---- the wire
  [[nodiscard]] bool control(std::uint8_t request, std::uint16_t value, std::int64_t t_ns);
  [[nodiscard]] bool write(std::span<const std::uint8_t> bytes, std::int64_t t_ns);
  // One packet if the chip would send one by now, else 0; never more than 64 bytes. -1: unplugged.
  [[nodiscard]] int read(std::span<std::uint8_t> packet, std::int64_t t_ns);

  // ---- behind it
  [[nodiscard]] StylusPlant& plant() noexcept { return plant_; }
  [[nodiscard]] FalconTwinFaults& faults() noexcept { return faults_; }
  [[nodiscard]] bool running() const noexcept { return mode_ == Mode::kRunning; }
  [[nodiscard]] const FalconCommand& last_command() const noexcept { return command_; }
  [[nodiscard]] const perception::Vec3& motor_force_D() const noexcept { return force_D_; }
  // When the encoders were read for the last answer, and the torques of the last frame were set.
  [[nodiscard]] std::int64_t exchange_ns() const noexcept { return exchange_ns_; }
  [[nodiscard]] std::uint64_t frames() const noexcept { return frames_; }
  [[nodiscard]] std::uint64_t bad_frames() const noexcept { return bad_frames_; }
  void power_cycle();  // firmware and index marks are lost

 private:
  enum class Mode : std::uint8_t { kDead, kMonitor, kGreeted, kUpload, kRunning };
  void reset_processor();
  void monitor(std::uint8_t byte, std::int64_t t_ns);
  void exchange(const FalconFrame& frame, std::int64_t t_ns);
  void reply(std::span<const std::uint8_t> bytes, std::int64_t t_ns);
  [[nodiscard]] std::array<std::int16_t, 3> encoders();

  FalconTwinConfig config_;
  StylusPlant plant_;
  FalconTwinFaults faults_;
  rt::Random random_;
  Mode mode_ = Mode::kDead;
  std::uint16_t baud_ = 0, line_ = 0;
  bool dtr_ = false, rts_ = true;
  int latency_ms_ = 16;
  std::int64_t next_packet_ns_ = 0;
  std::deque<std::pair<std::int64_t, std::uint8_t>> line_out_;  // ready at, byte
  std::vector<std::uint8_t> heard_;                             // monitor: the bytes so far
  FalconFramer framer_;
  FalconCommand command_;
  perception::Vec3 force_D_ = perception::Vec3::Zero();
  std::int64_t exchange_ns_ = 0;
  std::uint64_t frames_ = 0, bad_frames_ = 0;
  std::uint8_t homed_ = 0;
  std::array<int, 3> offset_{}, before_{};
  bool have_before_ = false;
};

// The twin as the driver's transport, without a thread: pump() is the event thread, called by
// whoever moves the time. The blocking calls move the time themselves.
class FalconTwinTransport final : public FalconTransport {
 public:
  FalconTwinTransport(FalconTwin& twin, std::int64_t& now_ns) : twin_(twin), now_ns_(now_ns) {}

  [[nodiscard]] bool control(std::uint8_t request, std::uint16_t value) override;
  [[nodiscard]] bool write_wait(std::span<const std::uint8_t> bytes, int timeout_ms) override;
  [[nodiscard]] int read_wait(std::span<std::uint8_t> bytes, int timeout_ms) override;
  [[nodiscard]] bool start(Listener& listener) override;
  [[nodiscard]] bool send(const FalconFrame& frame) noexcept override;
  void stop() noexcept override { listener_ = nullptr; }

  // Everything that is due by now_ns.
  void pump() noexcept;

 private:
  FalconTwin& twin_;
  std::int64_t& now_ns_;
  Listener* listener_ = nullptr;
};

}  // namespace drivers
