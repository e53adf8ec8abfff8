// The address at which browsers find this server through a tunnel or a proxy, as a person states
// it.
#pragma once

#include <string>
#include <string_view>

#include "rt/result.hpp"

namespace teletact {

struct PublicAddress {
  std::string host;    // as browsers send it: lower case, the port only where it is not usual
  std::string origin;  // scheme and host
  std::string path;    // "/", or "/robots/rover/": begins and ends with '/'
  bool secure = false;

  // Of "https://NAME[:PORT]/[PATH/]". Plain http only to this machine's own names, where a tunnel
  // ends: else whoever listens on the network could act.
  [[nodiscard]] static rt::Result<PublicAddress> parse(std::string_view url);
};

// Letters of ASCII alone, as hosts and schemes are compared.
[[nodiscard]] std::string ascii_lower(std::string_view text);

}  // namespace teletact
