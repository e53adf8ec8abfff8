// What homing measured on one robot, as a file: which robot it was, and where each joint's stop is.
//
//   version, date, chain
//   [[board]]   every slave by position: name, vendor, product, revision, serial of its EEPROM
//   [[joint]]   offset_ticks   the encoder's count at the stop before homing set it to 0 there:
//                              from power-up to the stop, or from an earlier homing to this one
//               direction      raw direction in which the stop was met
//               stop_mA        current there
//   # check     CRC-32 of all before it, in the last line: a damaged file is told from a good one
//
// An error has one line: file, key, value, range. Whose file it is, is told by the boards' names
// and identities. Whether real boards have serial numbers in their EEPROMs is not published: where
// all are 0, two robots of one kind can not be told apart (has_serials).
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/ethercat/slave_info.hpp"
#include "drivers/youbot_bus/chain_layout.hpp"
#include "rt/result.hpp"

namespace drivers::youbot_bus {

struct BoardIdentity {
  std::string name;
  std::uint32_t vendor = 0, product = 0, revision = 0, serial = 0;
  friend bool operator==(const BoardIdentity&, const BoardIdentity&) = default;
};

struct HomedJoint {
  int arm = 1, joint = 1;  // from 1
  std::int32_t offset_ticks = 0;
  int direction = 1;
  std::int32_t stop_mA = 0;
  friend bool operator==(const HomedJoint&, const HomedJoint&) = default;
};

struct Calibration {
  std::string date;  // 2026-01-31
  ChainKind chain = ChainKind::kBaseArm;
  std::vector<BoardIdentity> boards;  // by position
  std::vector<HomedJoint> joints;     // arm 1, joint 1 to 5, then arm 2
  [[nodiscard]] bool has_serials() const noexcept;
  friend bool operator==(const Calibration&, const Calibration&) = default;
};

[[nodiscard]] std::vector<BoardIdentity> identities(const std::vector<ethercat::SlaveInfo>&);
// What is wrong with it, one line; empty: nothing, and the text of it can be read again.
[[nodiscard]] std::string why_refused(const Calibration&);
[[nodiscard]] std::string calibration_text(const Calibration&);
// `content` and the line of its check.
[[nodiscard]] std::string with_check(std::string content);

[[nodiscard]] rt::Result<Calibration> read_calibration(const std::string& text,
                                                       const std::string& name);
[[nodiscard]] rt::Result<Calibration> load_calibration(const std::string& path);

// Empty: it is of this robot. Else what differs, one line.
[[nodiscard]] std::string other_robot(const Calibration&, const std::vector<ethercat::SlaveInfo>&);

}  // namespace drivers::youbot_bus
