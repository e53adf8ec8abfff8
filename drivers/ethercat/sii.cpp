#include "drivers/ethercat/sii.hpp"

#include <array>
#include <cstdio>

#include "drivers/ethercat/bytes.hpp"

namespace drivers::ethercat {

namespace {

using Bytes = std::span<const std::uint8_t>;

constexpr std::size_t kSmEntry = 8, kPdoHead = 8, kPdoEntry = 8;

rt::Error sii_error(std::size_t byte, const char* what) {
  std::array<char, 96> text{};
  std::snprintf(text.data(), text.size(), "SII word 0x%04zX: %s", byte / 2, what);
  return {text.data()};
}

// An empty text: read. Else what is wrong with the category.
const char* read_strings(Bytes data, SiiContent& out) {
  if (data.empty()) return "strings without a count";
  std::size_t at = 1;
  out.strings.clear();
  for (unsigned i = 0; i < data[0]; ++i) {
    if (at >= data.size() || data.size() - at - 1 < data[at])
      return "a string reaches behind its category";
    const std::size_t length = data[at];
    // Text for tables and JSON: what is not printable ASCII is a dot.
    std::string text;
    for (const auto c : data.subspan(at + 1, length))
      text.push_back(c >= 0x20 && c < 0x7F ? static_cast<char>(c) : '.');
    out.strings.push_back(std::move(text));
    at += 1 + length;
  }
  return "";
}

const char* read_sync_managers(Bytes data, SiiContent& out) {
  out.sync_managers.clear();
  for (; data.size() >= kSmEntry; data = data.subspan(kSmEntry))
    out.sync_managers.push_back({load_u16(data), load_u16(data, 2), data[4], data[6], data[7]});
  return "";
}

const char* read_pdos(Bytes data, std::vector<SiiPdo>& out) {
  while (data.size() >= kPdoHead) {
    SiiPdo pdo{load_u16(data), data[3], 0};
    const std::size_t entries = data[2];
    data = data.subspan(kPdoHead);
    if (data.size() < entries * kPdoEntry) return "a PDO reaches behind its category";
    for (std::size_t i = 0; i < entries; ++i) pdo.bits += data[i * kPdoEntry + 5];
    data = data.subspan(entries * kPdoEntry);
    out.push_back(pdo);
  }
  return "";
}

const char* read_category(unsigned type, Bytes data, SiiContent& out, unsigned& name_index) {
  switch (type) {
    case sii_category::kStrings:
      return read_strings(data, out);
    case sii_category::kGeneral:
      if (data.size() < 12) return "general category of less than 12 bytes";
      name_index = data[3];
      out.general_flags = data[11];
      return "";
    case sii_category::kFmmu:
      out.fmmus.assign(data.begin(), data.end());
      return "";
    case sii_category::kSyncManagers:
      return read_sync_managers(data, out);
    case sii_category::kTxPdo:
      return read_pdos(data, out.tx_pdos);
    case sii_category::kRxPdo:
      return read_pdos(data, out.rx_pdos);
    default:
      return "";
  }
}

void read_head(Bytes image, SiiContent& out) {
  const auto word = [&](std::size_t w) { return load_u16(image, 2 * w); };
  const auto two = [&](std::size_t w) { return load_u32(image, 2 * w); };
  out.checksum_good = sii_checksum(image.first<14>()) == (word(sii_word::kChecksum) & 0xFFU);
  out.alias = word(sii_word::kAlias);
  out.vendor = two(sii_word::kVendor);
  out.product = two(sii_word::kProduct);
  out.revision = two(sii_word::kRevision);
  out.serial = two(sii_word::kSerial);
  out.mailbox_out_start = word(sii_word::kMailbox);
  out.mailbox_out_length = word(sii_word::kMailbox + 1);
  out.mailbox_in_start = word(sii_word::kMailbox + 2);
  out.mailbox_in_length = word(sii_word::kMailbox + 3);
  out.protocols = word(sii_word::kProtocols);
}

}  // namespace

std::uint8_t sii_checksum(std::span<const std::uint8_t, 14> bytes) noexcept {
  unsigned crc = 0xFF;
  for (const auto b : bytes) {
    crc ^= b;
    for (int bit = 0; bit < 8; ++bit) crc = crc & 0x80U ? (crc << 1U ^ 0x07U) & 0xFFU : crc << 1U;
  }
  return static_cast<std::uint8_t>(crc);
}

rt::Result<SiiContent> parse_sii(std::span<const std::uint8_t> image) {
  std::size_t at = 2 * sii_word::kCategories;
  if (image.size() < at) return sii_error(image.size(), "the first 64 words are not complete");
  SiiContent out;
  read_head(image, out);
  unsigned name_index = 0;
  for (;;) {
    if (image.size() - at < 2) return sii_error(at, "no end of the categories");
    const unsigned type = load_u16(image, at);
    if (type == sii_category::kEnd) break;
    if (image.size() - at < 4) return sii_error(at, "a category without a size");
    const std::size_t size = 2 * static_cast<std::size_t>(load_u16(image, at + 2));
    if (image.size() - at - 4 < size) return sii_error(at, "a category reaches behind the end");
    const char* wrong = read_category(type, image.subspan(at + 4, size), out, name_index);
    if (*wrong != 0) return sii_error(at, wrong);
    at += 4 + size;
  }
  if (!out.strings.empty()) {
    out.name = out.strings.front();
    if (out.name.empty() && name_index > 0 && name_index <= out.strings.size())
      out.name = out.strings[name_index - 1];
  }
  return out;
}

}  // namespace drivers::ethercat
