// Twin of a youBot motor controller behind its slave controller: process data, TMCL over the
// mailbox, flags, the firmware's own watchdog.
//
// Flags     bits 4, 8 to 11, 14, 15 follow what the motor does. Bit 16 (EtherCAT timeout) latches
//           when no process data or mailbox came for global parameter 90 (100 ms unless set; the
//           real default is not published) and at power-up; the motor stands and takes nothing
//           until SAP 158. Bit 17 (I2t) latches by request, or when the motor says that its winding
//           is too hot; SAP 29 clears it once the winding's time constant is over.
// Init      mode 7, or on firmware 2.00 mode 2 too, finds the commutation within `initialise_time`;
//           then bit 15. Other modes do nothing before.
// Mailbox   raw TMCL, no head. Behind joint 5 there is a gripper as module 1: two bars that are
//           where they were sent at once.
// Faults    stuck encoder, I2t trip, a timeout of this board alone, lost commutation, and any fault
//           bits of the status word: while there are some the motor has no current.
// One owner; nothing allocates after construction.
#pragma once

#include <array>
#include <memory>

#include "drivers/ethercat/twin/esc.hpp"
#include "drivers/tmcl/tmcl_frame.hpp"
#include "drivers/youbot_bus/twin/drive_motor.hpp"

namespace drivers::youbot_bus {

struct DriveBoardConfig {
  int controller = 1632;  // 174 or 1632 wheels, 841 or 1610 joints
  int firmware = 200;     // 148: text "1.48", PWM in the inputs; 200: targets in the inputs
  bool has_gripper = false;
  bool initialised = false;  // commutation known from the start
  int timeout_ms = 100;      // global parameter 90
  rt::Nanos initialise_time = std::chrono::milliseconds{200};
  // Axis parameters 6, 25 and 26 at power-up. What 26 and 27 (the sum) count is not published: here
  // the current that a winding bears, and the root of its mean of current squared.
  std::int32_t max_current_mA = 8000, thermal_ms = 1000, rated_mA = 0;
  std::int32_t password = 1234;  // of protected parameters; the real one is not published
};

class DriveBoard final : public ethercat::EscApplication {
 public:
  DriveBoard(rt::NonRealtime&, const DriveBoardConfig&, std::unique_ptr<DriveMotor> motor);

  void on_outputs(std::span<const std::uint8_t>, rt::Time) noexcept override;
  void fill_inputs(std::span<std::uint8_t>, rt::Time) noexcept override;
  [[nodiscard]] bool on_mailbox(std::span<const std::uint8_t> request,
                                std::span<std::uint8_t> reply, rt::Time) noexcept override;
  void on_state(ethercat::AlState, rt::Time) noexcept override;
  void on_traffic(rt::Time) noexcept override;

  // ---- faults
  void stick_encoder(bool on) noexcept { stuck_ = on; }
  void trip_i2t(rt::Time now) noexcept { trip_i2t(now, now); }
  void time_out(rt::Time now) noexcept;
  // A firmware without the parameter that clears I2t: it answers "wrong type".
  void knows_i2t_clear(bool yes) noexcept { i2t_clear_ = yes; }
  // Its mailbox, as boards of firmware 1.48 were seen to answer.
  struct MailboxFaults {
    int empty_versions = 0;  // so many answers of zeros to a question for the firmware
    int refuses = -1;        // this axis parameter is not told: wrong type
    int silent = -1;         // this one has no answer at all
    bool dead = false;       // nothing has
  };
  void set_mailbox_faults(const MailboxFaults& f) noexcept { mailbox_ = f; }
  void set_commutated(bool known, rt::Time now) noexcept;
  void set_faults(std::uint32_t bits, rt::Time now) noexcept;  // all that there are; 0: none

  [[nodiscard]] std::uint32_t flags(rt::Time now) noexcept;
  [[nodiscard]] DriveMotor& motor() noexcept { return *motor_; }
  [[nodiscard]] const MotorCommand& command() const noexcept { return command_; }

 private:
  struct Gripper {
    std::array<std::int32_t, 2> counts{};
    std::array<std::int32_t, 256> parameters{};
    std::int32_t calibrated = 0;
  };
  void power_up(rt::Time now) noexcept;
  void advance(rt::Time now) noexcept;
  void obey(const DriveOutputs&, rt::Time now) noexcept;
  void stop(rt::Time now) noexcept;
  void trip_i2t(rt::Time when, rt::Time now) noexcept;
  [[nodiscard]] std::int32_t position(rt::Time now) noexcept;
  // drive_tmcl.cpp
  [[nodiscard]] tmcl::Reply serve(const tmcl::Request&, rt::Time now) noexcept;
  [[nodiscard]] tmcl::Reply serve_gripper(const tmcl::Request&) noexcept;
  [[nodiscard]] std::uint8_t set_axis(int number, std::int32_t value, rt::Time now) noexcept;
  [[nodiscard]] std::uint8_t get_axis(int number, std::int32_t& value, rt::Time now) noexcept;
  [[nodiscard]] std::uint8_t global(const tmcl::Request&, std::int32_t& value) noexcept;
  [[nodiscard]] tmcl::MailboxFrame version_text() const noexcept;

  DriveBoardConfig config_;
  std::unique_ptr<DriveMotor> motor_;
  MotorCommand command_;
  std::array<std::int32_t, 256> parameters_{};
  std::array<std::int32_t, 64> user_{};  // bank 2
  std::int32_t timeout_ms_ = 100;
  Gripper gripper_;
  MailboxFaults mailbox_;
  bool timeout_ = true, i2t_ = false, initialised_ = false, initialising_ = false, stuck_ = false;
  bool unlocked_ = false, i2t_clear_ = true;
  rt::Time last_traffic_{}, initialised_at_{}, tripped_at_{};
  std::uint32_t faults_ = 0;
  double encoder_offset_ticks_ = 0;
  std::int32_t stuck_ticks_ = 0;
};

}  // namespace drivers::youbot_bus
