// The check sequence behind every Ethernet frame (CRC-32, IEEE 802.3), which a veth pair lacks: a
// card refuses a damaged frame by it, and so does the port of an EtherCAT slave, before anybody
// reads a byte. Here it is put behind each frame that leaves, and held against each that comes.
//
//   none      frames pass as they are
//   refuse    as hardware does: a frame with a wrong one never came
//   count     it is counted and passed on: what the EtherCAT heads alone make of it
#pragma once

#include <algorithm>
#include <array>
#include <string>

#include "drivers/ethercat/frame.hpp"
#include "drivers/ethercat/port.hpp"

namespace vm {

class CheckedPort final : public drivers::ethercat::Port {
 public:
  CheckedPort(drivers::ethercat::Port& inner, const std::string& how)
      : inner_(inner), used_(how != "none"), refuses_(how == "refuse") {
    for (std::uint32_t i = 0; i < table_.size(); ++i) {
      std::uint32_t c = i;
      for (int bit = 0; bit < 8; ++bit) c = (c & 1U) != 0 ? 0xEDB88320U ^ c >> 1U : c >> 1U;
      table_[i] = c;
    }
  }
  bool send(std::span<const std::uint8_t> frame) noexcept override {
    if (!used_ || frame.size() > out_.size() - kBytes) return inner_.send(frame);
    std::copy(frame.begin(), frame.end(), out_.begin());
    const std::uint32_t c = sequence(frame);
    for (std::size_t i = 0; i < kBytes; ++i)
      out_[frame.size() + i] = static_cast<std::uint8_t>(c >> 8U * i);
    return inner_.send(std::span(out_).first(frame.size() + kBytes));
  }
  std::size_t receive(std::span<std::uint8_t> into, rt::Time deadline) noexcept override {
    for (;;) {
      const std::size_t bytes = inner_.receive(into, deadline);
      if (!used_ || bytes == 0) return bytes;
      if (bytes > kBytes && good(into.first(bytes))) return bytes - kBytes;
      ++wrong_;
      if (!refuses_ && bytes > kBytes) return bytes - kBytes;
    }
  }
  bool link_up() noexcept override { return inner_.link_up(); }
  [[nodiscard]] rt::Time now() const noexcept override { return inner_.now(); }
  void sleep_until(rt::Time t) noexcept override { inner_.sleep_until(t); }
  // Frames that came with a wrong one.
  [[nodiscard]] std::uint64_t wrong() const noexcept { return wrong_; }

 private:
  static constexpr std::size_t kBytes = 4;
  [[nodiscard]] std::uint32_t sequence(std::span<const std::uint8_t> bytes) const noexcept {
    std::uint32_t c = 0xFFFFFFFFU;
    for (const std::uint8_t b : bytes) c = table_[(c ^ b) & 0xFFU] ^ c >> 8U;
    return ~c;
  }
  [[nodiscard]] bool good(std::span<const std::uint8_t> bytes) const noexcept {
    const std::size_t at = bytes.size() - kBytes;
    std::uint32_t came = 0;
    for (std::size_t i = kBytes; i-- > 0;) came = came << 8U | bytes[at + i];
    return came == sequence(bytes.first(at));
  }

  drivers::ethercat::Port& inner_;
  bool used_, refuses_;
  std::uint64_t wrong_ = 0;
  std::array<std::uint32_t, 256> table_{};
  std::array<std::uint8_t, drivers::ethercat::kMaxFrame + kBytes> out_{};
};

}  // namespace vm
