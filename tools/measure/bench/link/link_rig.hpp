// The built `robot` and `operator` in two network namespaces of this machine, with the road of
// tools/measure/tun_road between them: TLS, keys of a lab of their own, one report folder each.
//
// Needs root and /dev/net/tun. Everything that it makes (namespaces, keys, folders, processes) goes
// with it.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "tasks/graph/calibration.hpp"
#include "tools/host/run_results.hpp"

namespace teletact {

// Why no such road can be made here, in one line; empty: it can.
[[nodiscard]] std::string link_rig_refusal();

struct RigRun {
  std::string name;                                 // of the folder, and for people
  std::string scene;                                // of config/scenes
  std::vector<std::string> keys;                    // section.key=value, for both boxes
  std::vector<std::string> road;                    // keys of teletact-road
  double seconds = 20;                              // of each box
  double rate_Mbit_per_s = 10;                      // that the boxes are told of the road
  bool record = false;                              // the operator's inputs
  std::optional<tasks::Calibration> calibration{};  // that both are admitted with; none: reference
};

struct RigResult {
  std::string problem;  // empty: both boxes ran to their end
  OperatorHalf op;
  RobotHalf robot;
  std::int64_t road_epoch_ns = 0;  // of the road's instants, on this machine's clock
  std::string robot_congestion, operator_congestion;  // as each box read it back
  std::string folder;                                 // operator/, robot/: reports
  double others_cores = 0;  // what other work took of this machine meanwhile
  double road_busy_Mbit_per_s = 0, road_late_p95_us = 0;
};

class LinkRig {
 public:
  // `programs`: folder of `teletact` and `teletact-road`; empty: this program's own. Throws
  // std::runtime_error with one line.
  explicit LinkRig(const std::string& programs = {});
  ~LinkRig();
  LinkRig(const LinkRig&) = delete;
  LinkRig& operator=(const LinkRig&) = delete;

  [[nodiscard]] RigResult run(const RigRun& what) const;

 private:
  std::string left_, right_, folder_, program_, road_program_;
};

}  // namespace teletact
