// Writes down every frame that passes another port, as a pcap file (the classic format, version
// 2.4, nanosecond stamps, link type 1): for Wireshark and tshark. For the bench: it writes to a
// file, so it has no place in a hard cycle.
#pragma once

#include <cstdio>
#include <memory>
#include <string>

#include "drivers/ethercat/port.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/result.hpp"

namespace drivers::ethercat {

class CapturePort final : public Port {
 public:
  [[nodiscard]] static rt::Result<std::unique_ptr<CapturePort>> open(rt::NonRealtime&, Port& inner,
                                                                     const std::string& file);
  ~CapturePort() override;
  CapturePort(const CapturePort&) = delete;
  CapturePort& operator=(const CapturePort&) = delete;

  [[nodiscard]] bool send(std::span<const std::uint8_t> frame) noexcept override;
  [[nodiscard]] std::size_t receive(std::span<std::uint8_t> into,
                                    rt::Time deadline) noexcept override;
  [[nodiscard]] bool link_up() noexcept override { return inner_.link_up(); }
  [[nodiscard]] rt::Time now() const noexcept override { return inner_.now(); }
  void sleep_until(rt::Time t) noexcept override { inner_.sleep_until(t); }
  // False: the disk took not all of it.
  [[nodiscard]] bool close() noexcept;
  [[nodiscard]] std::uint64_t frames() const noexcept { return frames_; }

 private:
  CapturePort(Port& inner, std::FILE* file) noexcept : inner_(inner), file_(file) {}
  void write(std::span<const std::uint8_t> frame) noexcept;

  Port& inner_;
  std::FILE* file_;
  std::uint64_t frames_ = 0;
  bool failed_ = false;
};

}  // namespace drivers::ethercat
