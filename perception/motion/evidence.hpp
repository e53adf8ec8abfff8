// What a pixel of the coarse image says of motion.
#pragma once

#include <cstdint>

namespace perception {

// From kFree on it speaks for motion; kUnasked: it may.
enum Evidence : std::uint8_t { kNone, kAgrees, kRested, kFree, kOff, kYoung, kOld, kUnasked };

}  // namespace perception
