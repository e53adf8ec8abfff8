#include "drivers/ethercat/coe.hpp"

#include <algorithm>
#include <array>
#include <cstdio>

namespace drivers::ethercat {

namespace {

constexpr std::size_t kSdoBytes = 8, kCoeHead = 2;
constexpr unsigned kSdoRequest = 2, kSdoResponse = 3;
constexpr std::uint8_t kUploadRequest = 0x40, kDownloadExpedited = 0x23, kDownloadNormal = 0x21,
                       kDownloadResponse = 0x60, kAbort = 0x80;

// Head, CoE head and the eight bytes of the service; `extra` behind them.
std::vector<std::uint8_t> sdo_message(std::uint8_t command, SdoAddress a, std::uint8_t counter,
                                      std::size_t extra) {
  std::vector<std::uint8_t> m(kMailboxHead + kCoeHead + kSdoBytes + extra);
  encode(MailboxHead{static_cast<std::uint16_t>(m.size() - kMailboxHead), 0, 0, MailboxType::kCoe,
                     counter},
         m);
  store_u16(m, kMailboxHead, kSdoRequest << 12U);
  m[8] = command;
  store_u16(m, 9, a.index);
  m[11] = a.subindex;
  return m;
}

rt::Error sdo_error(SdoAddress a, const char* what) {
  std::array<char, 128> text{};
  std::snprintf(text.data(), text.size(), "object 0x%04X:%u: %s", a.index, a.subindex, what);
  return {text.data()};
}

rt::Result<SdoReply> upload_data(std::span<const std::uint8_t> sdo, SdoAddress asked) {
  SdoReply out;
  const std::uint8_t command = sdo[0];
  if ((command & 0xE0U) != 0x40) return sdo_error(asked, "not the answer to a read");
  if ((command & 0x02U) != 0) {  // expedited: up to four bytes, their number where bit 0 says so
    const std::size_t n = (command & 0x01U) != 0 ? 4U - (command >> 2U & 3U) : 4U;
    out.data.assign(sdo.begin() + 4, sdo.begin() + 4 + static_cast<std::ptrdiff_t>(n));
    return out;
  }
  const std::size_t size = load_u32(sdo, 4);
  if (size > sdo.size() - kSdoBytes)
    return sdo_error(asked, "larger than the mailbox: segments are not served");
  out.data.assign(sdo.begin() + kSdoBytes,
                  sdo.begin() + static_cast<std::ptrdiff_t>(kSdoBytes + size));
  return out;
}

}  // namespace

std::vector<std::uint8_t> encode_sdo_upload(SdoAddress a, std::uint8_t counter) {
  return sdo_message(kUploadRequest, a, counter, 0);
}

rt::Result<std::vector<std::uint8_t>> encode_sdo_download(SdoAddress a,
                                                          std::span<const std::uint8_t> data,
                                                          std::uint8_t counter,
                                                          std::size_t mailbox) {
  if (data.empty()) return sdo_error(a, "no data to write");
  if (data.size() <= 4) {
    auto m = sdo_message(kDownloadExpedited, a, counter, 0);
    m[8] = static_cast<std::uint8_t>(m[8] | (4 - data.size()) << 2U);
    std::copy(data.begin(), data.end(), m.begin() + 12);
    return m;
  }
  auto m = sdo_message(kDownloadNormal, a, counter, data.size());
  if (m.size() > mailbox) return sdo_error(a, "larger than the mailbox: segments are not served");
  store_u32(m, 12, static_cast<std::uint32_t>(data.size()));
  std::copy(data.begin(), data.end(), m.begin() + 16);
  return m;
}

rt::Result<SdoReply> decode_sdo_reply(std::span<const std::uint8_t> mailbox, SdoAddress asked,
                                      bool upload) {
  MailboxHead head;
  if (!decode(mailbox, head)) return sdo_error(asked, "the reply has no mailbox head");
  const auto body = mailbox.subspan(kMailboxHead, head.length);
  if (head.type == MailboxType::kError)
    return sdo_error(asked, mailbox_error_text(body.size() >= 4 ? load_u16(body, 2) : 0));
  SdoReply other;
  other.other = true;
  if (head.type != MailboxType::kCoe || body.size() < kCoeHead) return other;
  const auto sdo = body.subspan(kCoeHead);
  const unsigned service = load_u16(body) >> 12U;
  // An abort is sent as a request or as a response.
  const bool abort =
      (service == kSdoResponse || service == kSdoRequest) && !sdo.empty() && sdo[0] == kAbort;
  if (service != kSdoResponse && !abort) return other;
  if (sdo.size() < kSdoBytes) return sdo_error(asked, "the reply is cut short");
  if (load_u16(sdo, 1) != asked.index || sdo[3] != asked.subindex)
    return sdo_error(asked, "the reply is of another object");
  if (abort) return sdo_error(asked, sdo_abort_text(load_u32(sdo, 4)));
  if (upload) return upload_data(sdo, asked);
  if (sdo[0] != kDownloadResponse) return sdo_error(asked, "not the answer to a write");
  return SdoReply{};
}

const char* sdo_abort_text(std::uint32_t code) noexcept {
  switch (code) {
    case 0x05030000:
      return "toggle bit not changed";
    case 0x05040000:
      return "SDO protocol timed out";
    case 0x05040001:
      return "command not valid or unknown";
    case 0x05040005:
      return "out of memory";
    case 0x06010000:
      return "unsupported access";
    case 0x06010001:
      return "object is write only";
    case 0x06010002:
      return "object is read only";
    case 0x06020000:
      return "object does not exist";
    case 0x06070010:
      return "length of the data does not match";
    case 0x06090011:
      return "subindex does not exist";
    case 0x06090030:
      return "value out of range";
    case 0x08000000:
      return "general error";
    case 0x08000022:
      return "not possible in the present state";
    default:
      return "aborted for another reason";
  }
}

}  // namespace drivers::ethercat
