// TMCL of the virtual motor controller: which command does what, and which status it gives.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "drivers/tmcl/tmcl_status.hpp"
#include "drivers/tmcl/youbot_parameters.hpp"
#include "drivers/youbot_bus/twin/drive_board.hpp"

namespace drivers::youbot_bus {

namespace {

namespace axis = tmcl::axis;
namespace status = tmcl::status;
using tmcl::Command;

constexpr int kGripperType = 842, kGripperFirmware = 100;

// Wraps, as the board's registers do.
std::int32_t wrapped_sum(std::int32_t a, std::int32_t b) noexcept {
  return static_cast<std::int32_t>(static_cast<std::uint32_t>(a) + static_cast<std::uint32_t>(b));
}
std::int32_t negated(std::int32_t v) noexcept {
  return static_cast<std::int32_t>(0U - static_cast<std::uint32_t>(v));
}

bool is(const tmcl::Request& r, Command c) noexcept {
  return r.command == static_cast<std::uint8_t>(c);
}

}  // namespace

bool DriveBoard::on_mailbox(std::span<const std::uint8_t> request, std::span<std::uint8_t> reply,
                            rt::Time now) noexcept {
  tmcl::Request r;
  if (reply.size() < tmcl::kMailboxBytes || !tmcl::decode(request, r)) return false;
  std::fill(reply.begin(), reply.end(), std::uint8_t{0});
  const bool reads = is(r, Command::kGetAxisParameter) && r.module == 0;
  if (mailbox_.dead || (reads && r.type == mailbox_.silent)) return false;
  if (is(r, Command::kFirmwareVersion) && mailbox_.empty_versions > 0) {
    --mailbox_.empty_versions;
    return true;
  }
  tmcl::MailboxFrame bytes{};
  if (is(r, Command::kFirmwareVersion) && r.type == 0) {
    bytes = version_text();
    if (r.module == 1) {  // text from byte 1 on
      std::array<char, 12> text{};
      std::snprintf(text.data(), text.size(), "%dV%d", kGripperType, kGripperFirmware);
      std::copy_n(text.begin(), 7, bytes.begin() + 1);
    }
  } else {
    bytes = tmcl::encode(r.module == 1 ? serve_gripper(r) : serve(r, now));
  }
  std::copy(bytes.begin(), bytes.end(), reply.begin());
  return true;
}

// "1632V200", "841V1.48": the boards of firmware 1.48 write the dot.
tmcl::MailboxFrame DriveBoard::version_text() const noexcept {
  std::array<char, 16> text{};
  if (config_.firmware >= 200) {
    std::snprintf(text.data(), text.size(), "%dV%d", config_.controller, config_.firmware);
  } else {
    std::snprintf(text.data(), text.size(), "%dV%d.%02d", config_.controller,
                  config_.firmware / 100, config_.firmware % 100);
  }
  tmcl::MailboxFrame out{};
  std::copy_n(text.begin(), out.size(), out.begin());
  return out;
}

tmcl::Reply DriveBoard::serve(const tmcl::Request& r, rt::Time now) noexcept {
  tmcl::Reply reply{0, r.module, status::kOk, r.command, r.value};
  advance(now);
  if (r.module != 0) {
    reply.status = status::kInvalidCommand;
  } else if (is(r, Command::kGetAxisParameter) && r.type == mailbox_.refuses) {
    reply.status = status::kWrongType;
  } else if (is(r, Command::kSetAxisParameter)) {
    reply.status = set_axis(r.type, r.value, now);
  } else if (is(r, Command::kGetAxisParameter)) {
    reply.status = get_axis(r.type, reply.value, now);
  } else if (is(r, Command::kSetGlobal) || is(r, Command::kGetGlobal)) {
    reply.status = global(r, reply.value);
  } else if (is(r, Command::kMotorStop)) {
    stop(now);
  } else if (is(r, Command::kRotateRight) || is(r, Command::kRotateLeft)) {
    const auto rpm = is(r, Command::kRotateRight) ? r.value : negated(r.value);
    obey({rpm, ControllerMode::kVelocity}, now);
  } else if (is(r, Command::kMoveToPosition)) {
    if (r.type > 1) {
      reply.status = status::kWrongType;
    } else {
      const auto to = r.type == 0 ? r.value : wrapped_sum(position(now), r.value);
      obey({to, ControllerMode::kPosition}, now);
    }
  } else if (!is(r, Command::kStoreAxisParameter) && !is(r, Command::kRestoreAxisParameter) &&
             !is(r, Command::kStoreGlobal) && !is(r, Command::kRestoreGlobal)) {
    reply.status = status::kInvalidCommand;
  }
  return reply;
}

std::uint8_t DriveBoard::set_axis(int number, std::int32_t value, rt::Time now) noexcept {
  const tmcl::AxisParameter* p = tmcl::find_axis_parameter(number);
  if (p == nullptr || p->access == tmcl::Access::kRead) return status::kWrongType;
  if (p->access == tmcl::Access::kProtected && !unlocked_) return status::kPasswordProtected;
  const bool ranged = p->lowest != 0 || p->highest != 0;
  if (ranged && (value < p->lowest || value > p->highest)) return status::kInvalidValue;
  parameters_[static_cast<std::size_t>(number)] = value;
  switch (number) {
    case axis::kTargetPosition:
      obey({value, ControllerMode::kPosition}, now);
      break;
    case axis::kActualPosition:
      encoder_offset_ticks_ = motor_->motion(now).position_ticks - value;
      break;
    case axis::kTargetSpeed:
      obey({value, ControllerMode::kVelocity}, now);
      break;
    case axis::kTargetCurrent:
      obey({value, ControllerMode::kCurrent}, now);
      break;
    case axis::kInitialised:
      initialised_ = initialised_ && value != 0;
      if (value != 0) obey({0, ControllerMode::kInitialise}, now);
      break;
    case axis::kClearI2t:
      if (!i2t_clear_) return status::kWrongType;
      if (now - tripped_at_ >= std::chrono::milliseconds{parameters_[axis::kThermalTime]})
        i2t_ = false;
      break;
    case axis::kClearTimeout:
      timeout_ = false;
      break;
    case axis::kMaxCurrent:
      motor_->limit_current(1e-3 * value);
      break;
    case axis::kPassword:
      unlocked_ = value == config_.password;
      break;
    default:
      break;
  }
  return status::kOk;
}

std::uint8_t DriveBoard::get_axis(int number, std::int32_t& value, rt::Time now) noexcept {
  const tmcl::AxisParameter* p = tmcl::find_axis_parameter(number);
  if (p == nullptr || p->access == tmcl::Access::kWrite) return status::kWrongType;
  const MotorMotion m = motor_->motion(now);
  switch (number) {
    case axis::kActualPosition:
      value = position(now);
      break;
    case axis::kActualSpeed:
      value = stuck_ ? 0 : static_cast<std::int32_t>(m.velocity_rpm);
      break;
    case axis::kActualCurrent:
      value = static_cast<std::int32_t>(m.current_mA);
      break;
    case axis::kInitialised:
      value = initialised_ ? 1 : 0;
      break;
    case axis::kI2tSum:
      value = static_cast<std::int32_t>(1e3 * std::sqrt(motor_->heat_A2()));
      break;
    case axis::kFlags:
      value = static_cast<std::int32_t>(flags(now));
      break;
    default:
      value = parameters_[static_cast<std::size_t>(number)];
  }
  return status::kOk;
}

// SGP and GGP: bank 0 the timeout, bank 2 the user's variables (0 to 15 protected, 16 to 55 free).
std::uint8_t DriveBoard::global(const tmcl::Request& r, std::int32_t& value) noexcept {
  const bool set = is(r, Command::kSetGlobal);
  if (r.motor == tmcl::global::kTimeoutBank && r.type == tmcl::global::kTimeout_ms) {
    if (!set) {
      value = timeout_ms_;
      return status::kOk;
    }
    if (!unlocked_) return status::kPasswordProtected;
    if (r.value < 1 || r.value > 60000) return status::kInvalidValue;
    timeout_ms_ = r.value;
    return status::kOk;
  }
  if (r.motor != tmcl::global::kUserBank || r.type > tmcl::global::kLastUser)
    return status::kWrongType;
  if (!set) {
    value = user_[r.type];
    return status::kOk;
  }
  if (r.type < tmcl::global::kCalibrated && !unlocked_) return status::kPasswordProtected;
  user_[r.type] = r.value;
  return status::kOk;
}

tmcl::Reply DriveBoard::serve_gripper(const tmcl::Request& r) noexcept {
  tmcl::Reply reply{0, r.module, status::kOk, r.command, r.value};
  const bool user = (is(r, Command::kSetGlobal) || is(r, Command::kGetGlobal)) &&
                    r.motor == tmcl::global::kUserBank && r.type == tmcl::global::kCalibrated;
  if (!config_.has_gripper) {
    reply.status = status::kInvalidCommand;
  } else if (user) {
    if (is(r, Command::kSetGlobal)) gripper_.calibrated = r.value;
    reply.value = gripper_.calibrated;
  } else if (r.motor > 1) {
    reply.status = status::kWrongType;
  } else if (is(r, Command::kMoveToPosition) && r.type <= 1) {
    auto& at = gripper_.counts[r.motor];
    at = r.type == 0 ? r.value : wrapped_sum(at, r.value);
  } else if (is(r, Command::kSetAxisParameter)) {
    (r.type == 1 ? gripper_.counts[r.motor] : gripper_.parameters[r.type]) = r.value;
  } else if (is(r, Command::kGetAxisParameter)) {
    reply.value = r.type == 1   ? gripper_.counts[r.motor]
                  : r.type == 8 ? 1  // there, always
                                : gripper_.parameters[r.type];
  } else if (!is(r, Command::kMotorStop)) {
    reply.status = status::kInvalidCommand;
  }
  return reply;
}

}  // namespace drivers::youbot_bus
