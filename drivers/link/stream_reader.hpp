// Messages out of a stream of bytes that arrives in pieces of any size. It holds at most one
// message and what came with its end; a header that is none ends the stream.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "drivers/link/wire.hpp"

namespace drivers {

class StreamReader {
 public:
  // Calls `take(message)` for each message that is whole now, in order, until one returns false.
  // Returns kOk, or why the stream can not be read any further. False of `take` is kOk, and
  // stopped() from then on.
  template <class Take>
  [[nodiscard]] WireStatus feed(std::span<const std::uint8_t> bytes, const Take& take) {
    held_.insert(held_.end(), bytes.begin(), bytes.end());
    std::size_t at = 0;
    WireStatus status = WireStatus::kOk;
    while (status == WireStatus::kOk && !stopped_) {
      const auto rest = std::span<const std::uint8_t>(held_).subspan(at);
      Header h;
      status = read_header(rest, h);
      if (status != WireStatus::kOk) break;
      if (rest.size() < kHeaderSize + h.length) status = WireStatus::kIncomplete;
      if (status != WireStatus::kOk) break;
      stopped_ = !take(rest.first(kHeaderSize + h.length));
      at += kHeaderSize + h.length;
    }
    held_.erase(held_.begin(), held_.begin() + static_cast<std::ptrdiff_t>(at));
    return status == WireStatus::kIncomplete ? WireStatus::kOk : status;
  }
  [[nodiscard]] bool stopped() const noexcept { return stopped_; }
  [[nodiscard]] std::size_t held() const noexcept { return held_.size(); }
  void renew() {
    held_.clear();
    stopped_ = false;
  }

 private:
  std::vector<std::uint8_t> held_;
  bool stopped_ = false;
};

}  // namespace drivers
