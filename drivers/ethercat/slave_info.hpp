// What the master knows of a slave after the scan: from its registers and from its SII.
#pragma once

#include <cstdint>
#include <string>

#include "drivers/ethercat/al_state.hpp"
#include "drivers/ethercat/sii.hpp"

namespace drivers::ethercat {

// Station addresses that the master gives: 0x1001 to the first slave.
inline constexpr std::uint16_t kFirstStation = 0x1001;

struct SlaveInfo {
  int position = 0;  // 0: next to the master
  std::uint16_t station = 0;
  std::uint8_t type = 0, fmmus = 0, sync_managers = 0;  // registers 0x0000, 0x0004, 0x0005
  std::uint16_t features = 0;                           // register 0x0008
  std::uint16_t dl_status = 0;                          // register 0x0110
  AlStatus al;
  SiiContent sii;
  std::string problem;  // one line: why it can not be driven; empty: it can

  [[nodiscard]] bool forbids_lrw() const noexcept;
  // Ports with a link and with communication: 1 at the end of the line, 2 in it.
  [[nodiscard]] int open_ports() const noexcept;
  // "slave 3 'TMCM-1632'"; slaves are counted from 1 for a person.
  [[nodiscard]] std::string label() const;
};

}  // namespace drivers::ethercat
