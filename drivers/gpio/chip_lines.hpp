// The lines of a GPIO chip through libgpiod: version 1.6 (Debian 12) or 2.x, whichever header is
// there at compile time. Opening may wait and throws; what a job calls does neither and allocates
// nothing: one non-blocking read a line (1.6) or a request (2.x) for edges, one ioctl for levels,
// one for each output that is set. Lines are given back when the object ends; what level an output
// has then is the chip's own affair.
//
//                        1.6                              2.x
//   time of an edge      kernel from 5.7 on: monotonic    monotonic, asked for
//   lost edges seen      a full queue of 16 a line        sequence numbers
#pragma once

#include <memory>

#include "drivers/gpio/gpio_config.hpp"
#include "drivers/gpio/gpio_lines.hpp"
#include "rt/memory/non_realtime.hpp"

namespace drivers::gpio {

// Throws std::runtime_error with one line that says what to do.
[[nodiscard]] std::unique_ptr<GpioLines> open_chip_lines(rt::NonRealtime&, const GpioConfig&);

// "1.6" or "2".
[[nodiscard]] const char* libgpiod_version() noexcept;

}  // namespace drivers::gpio
