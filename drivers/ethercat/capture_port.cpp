#include "drivers/ethercat/capture_port.hpp"

#include <array>
#include <cerrno>
#include <cstring>

#include "drivers/ethercat/bytes.hpp"
#include "drivers/ethercat/frame.hpp"

namespace drivers::ethercat {

namespace {

constexpr std::uint32_t kPcapNanoseconds = 0xA1B23C4D, kPcapEthernet = 1;

}  // namespace

rt::Result<std::unique_ptr<CapturePort>> CapturePort::open(rt::NonRealtime&, Port& inner,
                                                           const std::string& file) {
  std::FILE* f = std::fopen(file.c_str(), "wb");
  if (f == nullptr) return rt::Error{file + ": " + std::strerror(errno)};
  std::array<std::uint8_t, 24> head{};
  store_u32(head, 0, kPcapNanoseconds);
  store_u16(head, 4, 2);
  store_u16(head, 6, 4);
  store_u32(head, 16, 65535);
  store_u32(head, 20, kPcapEthernet);
  std::unique_ptr<CapturePort> port(new CapturePort(inner, f));
  if (std::fwrite(head.data(), head.size(), 1, f) != 1)
    return rt::Error{file + ": can not be written"};
  return port;
}

CapturePort::~CapturePort() { (void)close(); }

bool CapturePort::send(std::span<const std::uint8_t> frame) noexcept {
  write(frame);
  return inner_.send(frame);
}

std::size_t CapturePort::receive(std::span<std::uint8_t> into, rt::Time deadline) noexcept {
  const std::size_t n = inner_.receive(into, deadline);
  if (n > 0) write(into.first(n));
  return n;
}

bool CapturePort::close() noexcept {
  if (file_ != nullptr && std::fclose(file_) != 0) failed_ = true;
  file_ = nullptr;
  return !failed_;
}

void CapturePort::write(std::span<const std::uint8_t> frame) noexcept {
  if (file_ == nullptr) return;
  const std::int64_t ns = rt::ns_of(inner_.now());
  std::array<std::uint8_t, 16> head{};
  store_u32(head, 0, static_cast<std::uint32_t>(ns / 1'000'000'000));
  store_u32(head, 4, static_cast<std::uint32_t>(ns % 1'000'000'000));
  store_u32(head, 8, static_cast<std::uint32_t>(frame.size()));
  store_u32(head, 12, static_cast<std::uint32_t>(frame.size()));
  failed_ |= std::fwrite(head.data(), head.size(), 1, file_) != 1 ||
             std::fwrite(frame.data(), 1, frame.size(), file_) != frame.size();
  ++frames_;
}

}  // namespace drivers::ethercat
