// SDO services of CANopen over EtherCAT: one object read or written, expedited (up to four bytes)
// or normal (as much as the mailbox holds). Segments are not served, and said so.
// Source: ETG.1000.6, 5.6.1 (CoE header), 5.6.2 (SDO); abort codes table "SDO abort codes".
//
//   mailbox head 6   CoE head 2: bits 12-15 service (2 request, 3 response, 1 emergency)
//   command 1   index 2   subindex 1   data 4, or the whole size 4 and then the data
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "drivers/ethercat/mailbox.hpp"
#include "rt/result.hpp"

namespace drivers::ethercat {

struct SdoAddress {
  std::uint16_t index = 0;
  std::uint8_t subindex = 0;
};

// The mailbox bytes of a request. The download's error: more data than the mailbox holds.
[[nodiscard]] std::vector<std::uint8_t> encode_sdo_upload(SdoAddress, std::uint8_t counter);
[[nodiscard]] rt::Result<std::vector<std::uint8_t>> encode_sdo_download(
    SdoAddress, std::span<const std::uint8_t> data, std::uint8_t counter, std::size_t mailbox);

struct SdoReply {
  bool other = false;  // an emergency or another protocol's message: read the mailbox once more
  std::vector<std::uint8_t> data;  // of an upload
};
// Reads any bytes. An error: an abort (its code as text), a mailbox error, or not what was asked.
[[nodiscard]] rt::Result<SdoReply> decode_sdo_reply(std::span<const std::uint8_t> mailbox,
                                                    SdoAddress asked, bool upload);

[[nodiscard]] const char* sdo_abort_text(std::uint32_t code) noexcept;

}  // namespace drivers::ethercat
