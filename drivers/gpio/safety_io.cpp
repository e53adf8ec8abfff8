#include "drivers/gpio/safety_io.hpp"

namespace drivers {

std::uint8_t to_byte(const SafetyInputs& in) noexcept {
  const bool bits[] = {in.fitted,        in.readable,    in.estop_open, in.estop_disagrees,
                       in.enable_fitted, in.enable_held, in.edges_lost, in.outputs_failed};
  unsigned byte = 0;
  for (unsigned i = 0; i < 8; ++i) byte |= bits[i] ? 1U << i : 0U;
  return static_cast<std::uint8_t>(byte);
}

SafetyInputs safety_inputs_of(std::uint8_t byte) noexcept {
  const auto bit = [byte](unsigned i) { return (byte >> i & 1U) != 0; };
  SafetyInputs in;
  in.fitted = bit(0);
  in.readable = bit(1);
  in.estop_open = bit(2);
  in.estop_disagrees = bit(3);
  in.enable_fitted = bit(4);
  in.enable_held = bit(5);
  in.edges_lost = bit(6);
  in.outputs_failed = bit(7);
  return in;
}

}  // namespace drivers
