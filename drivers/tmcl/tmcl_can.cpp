#include "drivers/tmcl/tmcl_can.hpp"

#include <algorithm>

namespace drivers::tmcl {

namespace {

// What both directions share with the mailbox form: three bytes and a value, or the address first.
template <class Message>
CanPayload without_head(const Message& m) noexcept {
  const MailboxFrame frame = encode(m);
  CanPayload out{};
  std::copy(frame.begin() + 1, frame.end(), out.begin());
  return out;
}

template <class Message>
bool with_head(std::span<const std::uint8_t> bytes, Message& out) noexcept {
  if (bytes.size() != kCanBytes) return false;
  MailboxFrame frame{};
  std::copy(bytes.begin(), bytes.end(), frame.begin() + 1);
  return decode(frame, out);
}

}  // namespace

CanPayload to_can(const Request& r) noexcept { return without_head(r); }
CanPayload to_can(const Reply& r) noexcept { return without_head(r); }
bool from_can(std::span<const std::uint8_t> b, Request& out) noexcept { return with_head(b, out); }
bool from_can(std::span<const std::uint8_t> b, Reply& out) noexcept { return with_head(b, out); }

int can_rate_kbit_per_s(std::int32_t parameter_69) noexcept {
  constexpr std::array kRates{10, 20, 50, 100, 125, 250, 500, 1000};
  if (parameter_69 < 1 || parameter_69 > static_cast<std::int32_t>(kRates.size())) return 0;
  return kRates[static_cast<std::size_t>(parameter_69 - 1)];
}

}  // namespace drivers::tmcl
