// How a box finds its other half over a network, and how the two prove who they are.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "rt/result.hpp"
#include "rt/time.hpp"

namespace drivers {

// The numeric addresses of a host name, or why there are none. It may block.
using RoadLookup = std::function<rt::Result<std::vector<std::string>>(const std::string& host)>;

struct RoadOptions {
  rt::Box role = rt::Box::kRobot;  // this box; the peer's certificate must name the other role
  // True: waits at address:port for the other box (port 0: the kernel chooses). False: dials it,
  // again and again. Either box may do either.
  bool listen = false;
  std::string address;  // listening: a numeric IPv4 or IPv6 address; dialling: also a host name
  int port = 0;
  // Folder with box.key, box.crt, ca.crt and ca.crl, as `teletact keys issue` writes it.
  std::string keys;
  // Folder that is this box's own: the newest list of revoked certificates is kept there, so that
  // an older one changes nothing after a restart either. Empty: none is kept.
  std::string state;
  // Who must answer: a box name of the certificate, or "sha256:" and 64 hex digits of the peer's
  // public key (`teletact keys show`). Empty: any box of the other role that the lab CA vouches
  // for.
  std::string expected_peer;
  // What the slowest part of the road carries. Images are paced below it; 0: not paced.
  double rate_Mbit_per_s = 10;

  rt::Nanos handshake_limit = std::chrono::seconds{5};  // from connecting to a session
  // Nothing heard for so long: the session is over. An end of the link says something every 20 ms.
  rt::Nanos silence_limit = std::chrono::seconds{5};
  // Between two attempts to dial: from the first, doubled up to the second.
  rt::Nanos redial_first = std::chrono::milliseconds{100};
  rt::Nanos redial_most = std::chrono::seconds{2};
  rt::Nanos reread_period = std::chrono::seconds{1};  // of the list of revoked certificates
  std::function<std::int64_t()> wall_clock_s{};       // seconds since 1970; empty: the system's
  RoadLookup lookup{};                                // of names that are dialled; likewise
};

// What a peer's certificate says.
struct RoadPeer {
  std::string name;
  rt::Box role = rt::Box::kRobot;
  std::string serial;              // hex
  std::string key_sha256;          // hex, of the public key
  std::int64_t valid_until_s = 0;  // seconds since 1970
};

// What a road has seen since it was opened.
struct RoadCounts {
  std::uint64_t sessions = 0;      // connections of both kinds that stood
  std::uint64_t refused = 0;       // by this box: connections that it did not let in
  std::uint64_t failed = 0;        // dialling: attempts that led to no session
  std::uint64_t crowded = 0;       // arrivals that were dropped for newer ones
  std::uint64_t revoked_live = 0;  // sessions closed because their certificate was revoked
};

}  // namespace drivers
