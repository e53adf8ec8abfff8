#include "tools/box/road_address.hpp"

#include <arpa/inet.h>

#include <charconv>

namespace teletact {

rt::Result<RoadAddress> parse_road_address(const std::string& option, const std::string& text,
                                           bool listens) {
  const auto refuse = [&](const std::string& why) {
    return rt::Error{option + " " + text + ": " + why +
                     "; allowed: HOST:PORT or [IPv6]:PORT, port " + (listens ? "0" : "1") +
                     "..65535"};
  };
  const auto colon = text.rfind(':');
  if (colon == std::string::npos) return refuse("no port");
  RoadAddress a;
  a.host = text.substr(0, colon);
  const bool bracketed = a.host.size() > 2 && a.host.front() == '[' && a.host.back() == ']';
  if (bracketed) {
    a.host = a.host.substr(1, a.host.size() - 2);
  } else if (a.host.find(':') != std::string::npos) {
    return refuse("an IPv6 address needs brackets");
  }
  if (a.host.empty() || a.host.find_first_of("[] \t/") != std::string::npos)
    return refuse("no host");
  const char* first = text.data() + colon + 1;
  const char* last = text.data() + text.size();
  const auto [end, error] = std::from_chars(first, last, a.port);
  if (first == last || error != std::errc{} || end != last) return refuse("the port is no number");
  if (a.port < (listens ? 0 : 1) || a.port > 65535) return refuse("the port is out of range");
  return a;
}

bool is_loopback(const std::string& host) {
  in_addr v4{};
  if (inet_pton(AF_INET, host.c_str(), &v4) == 1) return (ntohl(v4.s_addr) >> 24U) == 127U;
  return host == "localhost" || host == "::1";
}

}  // namespace teletact
