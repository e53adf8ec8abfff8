#include "drivers/youbot_bus/process_data.hpp"

#include "drivers/ethercat/bytes.hpp"

namespace drivers::youbot_bus {

namespace {

using ethercat::load_u16;
using ethercat::load_u32;
using ethercat::store_u16;
using ethercat::store_u32;

constexpr std::uint8_t kLastMode = 7;

std::int32_t load_i32(std::span<const std::uint8_t> b, std::size_t at) noexcept {
  return static_cast<std::int32_t>(load_u32(b, at));
}
void store_i32(std::span<std::uint8_t> b, std::size_t at, std::int32_t v) noexcept {
  store_u32(b, at, static_cast<std::uint32_t>(v));
}

}  // namespace

bool encode(const DriveOutputs& o, std::span<std::uint8_t> into) noexcept {
  if (into.size() != kOutputBytes) return false;
  store_i32(into, 0, o.value);
  into[4] = static_cast<std::uint8_t>(o.mode);
  return true;
}

bool decode(std::span<const std::uint8_t> b, DriveOutputs& out) noexcept {
  if (b.size() != kOutputBytes || b[4] > kLastMode) return false;
  out = {load_i32(b, 0), static_cast<ControllerMode>(b[4])};
  return true;
}

bool encode(const DriveInputs& in, std::span<std::uint8_t> into) noexcept {
  if (!known_input_size(into.size())) return false;
  store_i32(into, 0, in.position_ticks);
  store_i32(into, 4, in.current_mA);
  store_i32(into, 8, in.velocity_rpm);
  if (into.size() == 16) {
    store_u16(into, 12, in.flags & 0xFFFFU);
    store_u16(into, 14, static_cast<std::uint32_t>(in.temperature_adc) & 0xFFFFU);
    return true;
  }
  store_u32(into, 12, in.flags);
  if (into.size() == 18)
    store_u16(into, 16, static_cast<std::uint32_t>(in.temperature_adc) & 0xFFFFU);
  if (into.size() == 20) store_i32(into, 16, in.pwm);
  if (into.size() != 32) return true;
  store_i32(into, 16, in.target_position_ticks);
  store_i32(into, 20, in.target_current_mA);
  store_i32(into, 24, in.target_velocity_rpm);
  store_i32(into, 28, in.ramp_velocity_rpm);
  return true;
}

bool decode(std::span<const std::uint8_t> b, DriveInputs& out) noexcept {
  if (!known_input_size(b.size())) return false;
  DriveInputs in;
  in.position_ticks = load_i32(b, 0);
  in.current_mA = load_i32(b, 4);
  in.velocity_rpm = load_i32(b, 8);
  in.flags = b.size() == 16 ? load_u16(b, 12) : load_u32(b, 12);
  if (b.size() == 16) in.temperature_adc = load_u16(b, 14);
  if (b.size() == 18) in.temperature_adc = load_u16(b, 16);
  if (b.size() == 20) in.pwm = load_i32(b, 16);
  if (b.size() == 32) {
    in.target_position_ticks = load_i32(b, 16);
    in.target_current_mA = load_i32(b, 20);
    in.target_velocity_rpm = load_i32(b, 24);
    in.ramp_velocity_rpm = load_i32(b, 28);
  }
  out = in;
  return true;
}

}  // namespace drivers::youbot_bus
