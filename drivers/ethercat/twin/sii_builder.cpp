#include "drivers/ethercat/twin/sii_builder.hpp"

#include <algorithm>
#include <array>

namespace drivers::ethercat {

namespace {

// CRC-8 of x^8 + x^2 + x + 1 as a polynomial division, bit by bit over one long number: the start
// value 0xFF is the same as inverting the first eight bits.
std::uint8_t division_remainder(const std::vector<std::uint8_t>& bytes, std::size_t count) {
  std::vector<bool> bits;
  for (std::size_t i = 0; i < count; ++i)
    for (int b = 7; b >= 0; --b) bits.push_back(((bytes[i] >> b & 1) != 0) != (i == 0));
  bits.insert(bits.end(), 8, false);
  const std::array<int, 4> divisor{0, 6, 7, 8};  // places of the ones in 1'0000'0111
  for (std::size_t i = 0; i + 8 < bits.size(); ++i) {
    if (!bits[i]) continue;
    for (const int d : divisor) {
      const auto at = i + static_cast<std::size_t>(d);
      bits[at] = !bits[at];
    }
  }
  unsigned out = 0;
  for (std::size_t i = bits.size() - 8; i < bits.size(); ++i) out = out << 1U | (bits[i] ? 1U : 0U);
  return static_cast<std::uint8_t>(out);
}

void push_u16(std::vector<std::uint8_t>& to, unsigned v) {
  to.push_back(static_cast<std::uint8_t>(v));
  to.push_back(static_cast<std::uint8_t>(v >> 8U));
}

}  // namespace

SiiBuilder::SiiBuilder() : head_(0x80, 0) {
  put(0, 0x0C08);  // PDI: 16-bit asynchronous microcontroller
  put(0x3E, 0x000F);
  put(0x3F, 1);
}

void SiiBuilder::put(std::size_t word, unsigned value) {
  head_[2 * word] = static_cast<std::uint8_t>(value);
  head_[2 * word + 1] = static_cast<std::uint8_t>(value >> 8U);
}

void SiiBuilder::put_two(std::size_t word, std::uint32_t value) {
  put(word, value & 0xFFFFU);
  put(word + 1, value >> 16U);
}

SiiBuilder& SiiBuilder::identity(std::uint32_t vendor, std::uint32_t product,
                                 std::uint32_t revision, std::uint32_t serial) {
  put_two(0x08, vendor);
  put_two(0x0A, product);
  put_two(0x0C, revision);
  put_two(0x0E, serial);
  return *this;
}

SiiBuilder& SiiBuilder::alias(std::uint16_t value) {
  put(4, value);
  return *this;
}

SiiBuilder& SiiBuilder::mailbox(std::uint16_t out_start, std::uint16_t out_length,
                                std::uint16_t in_start, std::uint16_t in_length,
                                std::uint16_t protocols) {
  put(0x18, out_start);
  put(0x19, out_length);
  put(0x1A, in_start);
  put(0x1B, in_length);
  put(0x1C, protocols);
  return *this;
}

void SiiBuilder::category(unsigned type, std::vector<std::uint8_t> data) {
  if (data.size() % 2 != 0) data.push_back(0);
  push_u16(categories_, type);
  push_u16(categories_, static_cast<unsigned>(data.size() / 2));
  categories_.insert(categories_.end(), data.begin(), data.end());
}

SiiBuilder& SiiBuilder::strings(std::initializer_list<std::string> texts) {
  std::vector<std::uint8_t> data{static_cast<std::uint8_t>(texts.size())};
  for (const auto& t : texts) {
    data.push_back(static_cast<std::uint8_t>(t.size()));
    data.insert(data.end(), t.begin(), t.end());
  }
  category(10, std::move(data));
  return *this;
}

SiiBuilder& SiiBuilder::general(std::uint8_t group, std::uint8_t order, std::uint8_t name,
                                std::uint8_t flags) {
  std::vector<std::uint8_t> data(32, 0);
  data[0] = group;
  data[2] = order;
  data[3] = name;
  data[11] = flags;
  category(30, std::move(data));
  return *this;
}

SiiBuilder& SiiBuilder::fmmus(std::initializer_list<std::uint8_t> uses) {
  std::vector<std::uint8_t> data(uses);
  if (data.size() % 2 != 0) data.push_back(0xFF);
  category(40, std::move(data));
  return *this;
}

SiiBuilder& SiiBuilder::managers(std::initializer_list<Manager> list) {
  std::vector<std::uint8_t> data;
  for (const Manager& m : list) {
    push_u16(data, m.start);
    push_u16(data, m.length);
    data.insert(data.end(), {m.control, 0, m.enable, m.type});
  }
  category(41, std::move(data));
  return *this;
}

SiiBuilder& SiiBuilder::pdo(bool transmit, std::uint16_t index, std::uint8_t manager,
                            std::initializer_list<std::uint8_t> bits) {
  std::vector<std::uint8_t> data;
  push_u16(data, index);
  data.insert(data.end(), {static_cast<std::uint8_t>(bits.size()), manager, 0, 0, 0, 0});
  std::uint8_t sub = 0;
  for (const auto b : bits) {
    push_u16(data, transmit ? 0x6000U : 0x7000U);
    data.insert(data.end(), {++sub, 0, 0x07, b, 0, 0});
  }
  category(transmit ? 50 : 51, std::move(data));
  return *this;
}

std::vector<std::uint8_t> SiiBuilder::image(std::size_t bytes) const {
  std::vector<std::uint8_t> out = head_;
  out[14] = division_remainder(out, 14);
  out[15] = 0;
  out.insert(out.end(), categories_.begin(), categories_.end());
  push_u16(out, 0xFFFF);
  out.resize(std::max(bytes, out.size()), 0xFF);
  const std::size_t kibit = out.size() * 8 / 1024 - 1;
  out[2 * 0x3E] = static_cast<std::uint8_t>(kibit);
  return out;
}

}  // namespace drivers::ethercat
