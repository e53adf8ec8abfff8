// What both versions of the chip's lines share.
#pragma once

#include <cstdint>
#include <string>

#include "rt/time.hpp"

namespace drivers::gpio {

[[nodiscard]] std::string chip_path(const std::string& name);

// One line for a failed call: what, errno in words, and what to do.
[[nodiscard]] std::string chip_problem(const std::string& what, int error);

// A kernel's time of an edge as the caller's, whose `now` is this instant. A few microseconds pass
// between `now` and this call: the edge seems that much older. Kernels before 5.7 stamp by the wall
// clock: seen by a time that lies far in the future.
[[nodiscard]] rt::Time edge_time(std::int64_t kernel_ns, rt::Time now) noexcept;

}  // namespace drivers::gpio
