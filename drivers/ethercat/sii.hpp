// The content of a slave's EEPROM (slave information interface, SII).
// Source: ETG.1000.6, 5.4 and ETG.2010: word map of the first 64 words, then categories of
// {type, size in words, data} until type 0xFFFF.
//
//   word 0-6   configuration, 4 of these the alias    7  checksum of words 0-6
//   8 vendor (2)   10 product (2)   12 revision (2)   14 serial (2)
//   0x18 standard mailbox: offset and size to the slave, offset and size from it
//   0x1C protocols   0x3E size in KiBit less 1   0x3F version   0x40 first category
//   categories: 10 strings, 30 general, 40 FMMU, 41 sync managers, 50 TxPDO, 51 RxPDO
//
// The checksum is CRC-8, polynomial x^8 + x^2 + x + 1, start 0xFF, over bytes 0 to 13, in the low
// byte of word 7. A wrong one is reported and no reason to refuse: devices with 0 there are in use.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "rt/result.hpp"

namespace drivers::ethercat {

namespace sii_word {
inline constexpr std::size_t kAlias = 4, kChecksum = 7, kVendor = 8, kProduct = 0xA,
                             kRevision = 0xC, kSerial = 0xE, kMailbox = 0x18, kProtocols = 0x1C,
                             kSize = 0x3E, kVersion = 0x3F, kCategories = 0x40;
}
namespace sii_category {
inline constexpr std::uint16_t kStrings = 10, kGeneral = 30, kFmmu = 40, kSyncManagers = 41,
                               kTxPdo = 50, kRxPdo = 51, kEnd = 0xFFFF;
}
namespace mailbox_protocol {
inline constexpr std::uint16_t kCoe = 4;
}

struct SiiSyncManager {
  std::uint16_t start = 0, length = 0;
  std::uint8_t control = 0, enable = 0;
  std::uint8_t type = 0;  // 1 mailbox out, 2 mailbox in, 3 outputs, 4 inputs, 0 not said
};

struct SiiPdo {
  std::uint16_t index = 0;
  std::uint8_t sync_manager = 0;  // 0xFF: assigned to none
  std::uint32_t bits = 0;
};

struct SiiContent {
  bool checksum_good = false;
  std::uint16_t alias = 0;
  std::uint32_t vendor = 0, product = 0, revision = 0, serial = 0;
  // Mailbox as words 0x18 to 0x1B have it; lengths of 0: none.
  std::uint16_t mailbox_out_start = 0, mailbox_out_length = 0;
  std::uint16_t mailbox_in_start = 0, mailbox_in_length = 0;
  std::uint16_t protocols = 0;
  std::vector<std::string> strings;  // strings[i] has index i + 1
  std::string name;                  // string 1, by which youBot boards are known; or general's
  std::uint8_t general_flags = 0;    // category 30, byte 11
  std::vector<std::uint8_t> fmmus;   // category 40: 1 outputs, 2 inputs, 3 mailbox state
  std::vector<SiiSyncManager> sync_managers;
  std::vector<SiiPdo> tx_pdos, rx_pdos;

  [[nodiscard]] bool has_mailbox() const noexcept {
    return mailbox_out_length > 0 && mailbox_in_length > 0;
  }
  [[nodiscard]] bool has_coe() const noexcept {
    return has_mailbox() && (protocols & mailbox_protocol::kCoe) != 0;
  }
  // Category 30, flags bit 1: the slave has no LRW.
  [[nodiscard]] bool forbids_lrw() const noexcept { return (general_flags & 0x02U) != 0; }
};

// Of bytes 0 to 13.
[[nodiscard]] std::uint8_t sii_checksum(std::span<const std::uint8_t, 14>) noexcept;

// Reads any bytes. The error names the word.
[[nodiscard]] rt::Result<SiiContent> parse_sii(std::span<const std::uint8_t> image);

}  // namespace drivers::ethercat
