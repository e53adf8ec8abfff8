// Brings a Falcon from power-on to frames: the boot monitor's greeting, the firmware (a file of the
// vendor that the user supplies), normal mode. Facts: libnifalcon. Set-up code, blocking.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "drivers/falcon/falcon_transport.hpp"

namespace drivers {

// 1.5 Mbaud, latency timer 1 ms, both buffers empty.
[[nodiscard]] bool falcon_normal_mode(FalconTransport&);
// Does a frame out bring a frame in? (The firmware stays loaded until the power is cut.)
[[nodiscard]] bool falcon_answers(FalconTransport&);
// Empty, or in one line what went wrong. Each piece is read back and compared.
[[nodiscard]] std::string falcon_load_firmware(FalconTransport&,
                                               const std::vector<std::uint8_t>& firmware);

}  // namespace drivers
