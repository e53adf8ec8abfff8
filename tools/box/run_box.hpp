// One box as a program of its own (teletact robot, teletact operator): its own epoch, admission,
// registry rows, report and black box; a link that lasts. It runs until it is stopped, or for
// --seconds, in this process.
//
// Admission: with the other box on loopback both share this host, and the answer is that of the
// union of both, as for the demo: two commands with one scene and one calibration are given places
// that fit together, and each enters its own rows. With the other box elsewhere only this box's
// tasks are asked for.
#pragma once

#include "tools/box/road_address.hpp"
#include "tools/host/run_options.hpp"

namespace teletact {

struct BoxCommand {
  rt::Box box = rt::Box::kRobot;
  bool listens = true;
  RoadAddress road;
  bool plain = false;  // no TLS: loopback alone
  // The other box is on this host too, though its address does not say so (another network
  // namespace).
  bool one_host = false;
  // With TLS (drivers/road/road_options.hpp): the folder of this box's keys, who must answer
  // (empty: any box of the other role that the lab's CA vouches for), what the road carries.
  std::string keys, peer;
  double rate_Mbit_per_s = 10;
  bool shape = false;  // with TLS: the scene's link.shape is applied all the same
  std::string json;    // file for the figures; empty: none

  [[nodiscard]] const char* name() const noexcept {
    return box == rt::Box::kRobot ? "robot" : "operator";
  }
};

// Before anything is measured or written: throws CouldNotStart with one line where the address or
// the keys are no good.
void check_link(const BoxCommand& command);

// The other box is here too: both are admitted together.
[[nodiscard]] bool both_on_this_host(const BoxCommand& command);

// Exit code: 0 orderly, 1 with problems, 3 could not start, 4 stopped by a fault. `info` holds what
// the report says of the command; options.seconds 0: until stopped.
[[nodiscard]] int run_box(rt::NonRealtime&, Scene&, const DemoOptions&, const BoxCommand&,
                          const tasks::Calibration&, RunInfo& info);

}  // namespace teletact
