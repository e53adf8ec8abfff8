#include "drivers/ethercat/mailbox_client.hpp"

namespace drivers::ethercat {

namespace {

constexpr int kMostOtherMessages = 8;  // before the reply that was asked for

MailboxPlace place_of(const SlaveInfo& s) {
  return {s.sii.mailbox_out_start, s.sii.mailbox_out_length, s.sii.mailbox_in_start,
          s.sii.mailbox_in_length};
}

rt::Error mailbox_problem(const SlaveInfo& s, const std::string& what) {
  return {s.label() + ": mailbox: " + what};
}

}  // namespace

TransferState MailboxClient::wait_for(MailboxTransfer& t) {
  while (t.busy()) {
    frames_.begin();
    if (!t.add_to(frames_)) break;
    if (frames_.run(frames_.port().now() + timeout_)) {
      t.on_reply(frames_.reply(0));
    } else {
      t.on_lost();
    }
    if (t.busy()) frames_.port().sleep_until(frames_.port().now() + kPoll / 4);
  }
  return t.state();
}

rt::Result<std::vector<std::uint8_t>> MailboxClient::raw(const SlaveInfo& s,
                                                         std::span<const std::uint8_t> request) {
  transfer_.start(s.station, place_of(s), request, 4 * kPolls);
  const TransferState end = wait_for(transfer_);
  if (end != TransferState::kDone) return mailbox_problem(s, to_text(end));
  const auto reply = transfer_.reply();
  return std::vector<std::uint8_t>(reply.begin(), reply.end());
}

std::uint8_t MailboxClient::count_up(const SlaveInfo& s) noexcept {
  auto& c = counter_[static_cast<std::size_t>(s.position) % counter_.size()];
  return c = next_counter(c);
}

rt::Result<SdoReply> MailboxClient::sdo(const SlaveInfo& s, SdoAddress address,
                                        std::span<const std::uint8_t> request, bool upload) {
  transfer_.start(s.station, place_of(s), request, 4 * kPolls);
  for (int i = 0; i < kMostOtherMessages; ++i) {
    const TransferState end = wait_for(transfer_);
    if (end != TransferState::kDone) return mailbox_problem(s, to_text(end));
    auto reply = decode_sdo_reply(transfer_.reply(), address, upload);
    if (!reply) return mailbox_problem(s, reply.error());
    if (!reply.value().other) return reply;
    transfer_.start_read(s.station, place_of(s), 4 * kPolls);
  }
  return mailbox_problem(s, "only messages that were not asked for");
}

rt::Result<std::vector<std::uint8_t>> MailboxClient::sdo_upload(const SlaveInfo& s, SdoAddress a) {
  if (!s.sii.has_coe()) return mailbox_problem(s, "no CoE by its SII");
  auto reply = sdo(s, a, encode_sdo_upload(a, count_up(s)), true);
  if (!reply) return rt::Error{reply.error()};
  return std::move(reply.value().data);
}

rt::Result<bool> MailboxClient::sdo_download(const SlaveInfo& s, SdoAddress a,
                                             std::span<const std::uint8_t> data) {
  if (!s.sii.has_coe()) return mailbox_problem(s, "no CoE by its SII");
  const auto request = encode_sdo_download(a, data, count_up(s), s.sii.mailbox_out_length);
  if (!request) return mailbox_problem(s, request.error());
  auto reply = sdo(s, a, request.value(), false);
  if (!reply) return rt::Error{reply.error()};
  return true;
}

}  // namespace drivers::ethercat
