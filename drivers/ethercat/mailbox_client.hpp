// Mailbox requests one after the other, waiting for each reply: set-up and bench. In a cycle the
// master carries them (master.hpp, post()).
#pragma once

#include <array>

#include "drivers/ethercat/coe.hpp"
#include "drivers/ethercat/mailbox.hpp"
#include "drivers/ethercat/slave_info.hpp"

namespace drivers::ethercat {

class MailboxClient {
 public:
  explicit MailboxClient(Port& port) noexcept : frames_(port) {}

  // Any bytes to the slave and the whole of its in mailbox back: raw TMCL.
  [[nodiscard]] rt::Result<std::vector<std::uint8_t>> raw(const SlaveInfo& slave,
                                                          std::span<const std::uint8_t> request);
  // Only where the SII offers CoE; the error says so else.
  [[nodiscard]] rt::Result<std::vector<std::uint8_t>> sdo_upload(const SlaveInfo&, SdoAddress);
  [[nodiscard]] rt::Result<bool> sdo_download(const SlaveInfo&, SdoAddress,
                                              std::span<const std::uint8_t> data);

 private:
  [[nodiscard]] TransferState wait_for(MailboxTransfer& transfer);
  [[nodiscard]] rt::Result<SdoReply> sdo(const SlaveInfo&, SdoAddress,
                                         std::span<const std::uint8_t> request, bool upload);
  [[nodiscard]] std::uint8_t count_up(const SlaveInfo&) noexcept;

  FrameExchange frames_;
  MailboxTransfer transfer_;
  std::array<std::uint8_t, 256> counter_{};  // of each slave's last CoE message, by position
  rt::Nanos timeout_ = std::chrono::milliseconds{2};
  // Between two polls, and how many of them: as the youBot's own driver waits for a joint's reply.
  static constexpr rt::Nanos kPoll = std::chrono::milliseconds{1};
  static constexpr int kPolls = 100;
};

}  // namespace drivers::ethercat
