// Sync managers and FMMUs of every slave from its SII, and where its process data lies in the
// master's image.
// Source: ETG.1000.4, 6.6 (FMMU) and 6.7 (sync manager); ETG.2010, category 41; lengths of process
// data from the PDO categories 50 and 51, or from category 41 where there are none.
//
//   image      outputs of all slaves in bus order, then their inputs; byte 0 has logical address 0.
//              Whole bytes: a slave's data is rounded up to bytes.
//   one SM     for outputs and one for inputs a slave; a second one with data is refused.
#pragma once

#include <array>
#include <vector>

#include "drivers/ethercat/registers.hpp"
#include "drivers/ethercat/slave_info.hpp"
#include "rt/result.hpp"

namespace drivers::ethercat {

// With what else a cycle's frame carries (mapping.cpp) it stays below an Ethernet frame.
inline constexpr std::size_t kMostImage = 900, kMostMailbox = 512;

struct MailboxPlace {
  std::uint16_t out_start = 0, out_length = 0;  // master to slave, sync manager 0
  std::uint16_t in_start = 0, in_length = 0;    // slave to master, sync manager 1
  [[nodiscard]] bool usable() const noexcept { return out_length > 0 && in_length > 0; }
};

struct RegisterBlock {
  std::uint16_t reg = 0;
  std::uint8_t size = 0;
  std::array<std::uint8_t, 16> bytes{};
};

// What one slave gets written, and where it lies in the image.
struct SlaveMapping {
  std::uint16_t station = 0;
  MailboxPlace mailbox;
  std::size_t output_at = 0, output_bytes = 0;   // in the image
  std::size_t input_at = 0, input_bytes = 0;     // in the image, outputs counted
  bool watchdog = false;                         // its output sync manager feeds the watchdog
  std::array<RegisterBlock, 2> mailbox_setup{};  // in INIT
  int mailbox_blocks = 0;
  // In PREOP: a sync manager and an FMMU a direction, the watchdog's time.
  std::array<RegisterBlock, 6> data_setup{};
  int data_blocks = 0;
};

struct ProcessMapping {
  std::vector<SlaveMapping> slaves;
  std::size_t output_bytes = 0, input_bytes = 0;
  bool lrw = true;  // false: a slave forbids it, so LRD and LWR
  int with_outputs = 0, with_inputs = 0;

  // Working counters of a whole cycle (ETG.1000.4, 5.4): a read adds 1, a write 1, by LRW 2.
  [[nodiscard]] int expected_lrw() const noexcept { return 2 * with_outputs + with_inputs; }
  [[nodiscard]] int expected_lrd() const noexcept { return with_inputs; }
  [[nodiscard]] int expected_lwr() const noexcept { return with_outputs; }
};

// The error names the slave.
[[nodiscard]] rt::Result<ProcessMapping> map_process_data(const std::vector<SlaveInfo>&);

}  // namespace drivers::ethercat
