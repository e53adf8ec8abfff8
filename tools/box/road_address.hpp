// Where a box waits for the other one, or where it finds it: HOST:PORT on the command line.
#pragma once

#include <string>

#include "rt/result.hpp"

namespace teletact {

// Where a box waits unless it is told otherwise. Not registered with anybody.
inline constexpr int kRoadPort = 47110;

struct RoadAddress {
  std::string host;  // an address or a name; of "[::1]:5" without the brackets
  int port = 0;
};

// "HOST:PORT", "[IPv6]:PORT". Port 1..65535, and 0 (the kernel chooses) where a box listens. The
// error names the option and what is allowed.
[[nodiscard]] rt::Result<RoadAddress> parse_road_address(const std::string& option,
                                                         const std::string& text, bool listens);

// 127.0.0.0/8, "localhost" or "::1": both boxes are on this machine.
[[nodiscard]] bool is_loopback(const std::string& host);

}  // namespace teletact
