#include "drivers/tmcl/tmcl_frame.hpp"

#include <algorithm>

namespace drivers::tmcl {

namespace {

void put_value(MailboxFrame& f, std::int32_t value) noexcept {
  const auto bits = static_cast<std::uint32_t>(value);
  for (std::size_t i = 0; i < 4; ++i) f[4 + i] = static_cast<std::uint8_t>(bits >> (24 - 8 * i));
}

std::int32_t value_of(std::span<const std::uint8_t> b) noexcept {
  std::uint32_t bits = 0;
  for (std::size_t i = 4; i < 8; ++i) bits = bits << 8U | b[i];
  return static_cast<std::int32_t>(bits);
}

bool is_digit(std::uint8_t c) noexcept { return c >= '0' && c <= '9'; }

bool sets_value(std::uint8_t command) noexcept {
  return command == static_cast<std::uint8_t>(Command::kSetAxisParameter) ||
         command == static_cast<std::uint8_t>(Command::kSetGlobal);
}

}  // namespace

std::uint8_t checksum(std::span<const std::uint8_t, kMailboxBytes> bytes) noexcept {
  unsigned sum = 0;
  for (const auto b : bytes) sum += b;
  return static_cast<std::uint8_t>(sum);
}

MailboxFrame encode(const Request& r) noexcept {
  MailboxFrame f{r.module, r.command, r.type, r.motor};
  put_value(f, r.value);
  return f;
}

MailboxFrame encode(const Reply& r) noexcept {
  MailboxFrame f{r.host, r.module, r.status, r.command};
  put_value(f, r.value);
  return f;
}

SerialFrame to_serial(const MailboxFrame& f) noexcept {
  SerialFrame out{};
  std::copy(f.begin(), f.end(), out.begin());
  out.back() = checksum(f);
  return out;
}

bool decode(std::span<const std::uint8_t> b, Request& out) noexcept {
  if (b.size() < kMailboxBytes) return false;
  out = {b[0], b[1], b[2], b[3], value_of(b)};
  return true;
}

bool decode(std::span<const std::uint8_t> b, Reply& out) noexcept {
  if (b.size() < kMailboxBytes) return false;
  out = {b[0], b[1], b[2], b[3], value_of(b)};
  return true;
}

bool from_serial(std::span<const std::uint8_t> b, MailboxFrame& out) noexcept {
  if (b.size() != kSerialBytes) return false;
  if (checksum(b.first<kMailboxBytes>()) != b[kMailboxBytes]) return false;
  std::copy_n(b.begin(), kMailboxBytes, out.begin());
  return true;
}

bool answers(const Reply& reply, const Request& request) noexcept {
  if (reply.status != 100 || reply.command != request.command) return false;
  return !sets_value(request.command) || reply.value == request.value;
}

std::optional<Firmware> firmware_of(std::span<const std::uint8_t> b) noexcept {
  if (b.size() < kMailboxBytes) return std::nullopt;
  Firmware f;
  std::size_t i = 0;
  for (; i < kMailboxBytes && is_digit(b[i]); ++i) f.controller = 10 * f.controller + b[i] - '0';
  if (i == 0 || i + 1 >= kMailboxBytes || b[i] != 'V' || !is_digit(b[i + 1])) return std::nullopt;
  for (++i; i < kMailboxBytes && (is_digit(b[i]) || b[i] == '.'); ++i) {
    if (b[i] != '.') f.version = 10 * f.version + b[i] - '0';
  }
  for (; i < kMailboxBytes; ++i) {
    if (b[i] != ' ' && b[i] != 0) return std::nullopt;
  }
  return f;
}

}  // namespace drivers::tmcl
