// The road between two network namespaces: two tun devices, two PacketRoads, one thread. Real TCP
// of both hosts meets the network that is asked for.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <string>

#include "rt/result.hpp"
#include "tools/measure/tun_road/packet_road.hpp"

namespace teletact {

struct TunRoadOptions {
  // Namespaces, as of `ip netns add`; left is the operator's side.
  std::string left = "road-left", right = "road-right";
  std::string left_address = "10.77.0.1", right_address = "10.77.0.2";
  std::string device = "road0";
  RoadConfig road;
  double seconds = 0;  // 0: until asked to end
};

struct TunRoadResult {
  PacketRoad::Stats to_right, to_left;
  // How late a packet left the road, against its plan: the machine's doing. Of all packets.
  double late_p50_us = 0, late_p95_us = 0, late_max_us = 0;
  std::uint64_t not_written = 0;  // the host took no more
  double seconds = 0;
};

// Runs until `stop`, or for the seconds asked for. `ready` is called when both devices are up. The
// calling thread gets a real-time priority where the rights are there. An error is one line.
[[nodiscard]] rt::Result<TunRoadResult> run_tun_road(const TunRoadOptions& options,
                                                     const std::atomic<bool>& stop,
                                                     const std::function<void()>& ready = {});
// As JSON: {"to_right": {...}, "to_left": {...}, "late_us": {...}, "seconds": ...}.
[[nodiscard]] std::string road_json(const TunRoadResult& r);

}  // namespace teletact
