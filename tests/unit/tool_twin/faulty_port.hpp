// `teletact twin youbot --fault` as a wire in this process, on a clock of its own.
#pragma once

#include <gtest/gtest.h>

#include "drivers/ethercat/port.hpp"
#include "tools/bus/twin_faults.hpp"

namespace tests {

class FaultyPort final : public drivers::ethercat::Port {
 public:
  FaultyPort(drivers::youbot_bus::YoubotChain& chain, const std::vector<std::string>& faults)
      : twin_(chain, parsed(faults)) {
    twin_.start(now_);
  }
  [[nodiscard]] bool send(std::span<const std::uint8_t> frame) noexcept override {
    twin_.act(now_);
    if (frame.size() > bytes_.size()) return false;
    std::copy(frame.begin(), frame.end(), bytes_.begin());
    twin_.take(std::span(bytes_).first(frame.size()), now_);
    ++frames_;
    return true;
  }
  [[nodiscard]] std::size_t receive(std::span<std::uint8_t> into,
                                    rt::Time deadline) noexcept override {
    for (;;) {
      if (const std::size_t n = twin_.give(into, now_); n > 0) return n;
      if (now_ >= deadline) return 0;
      now_ = std::min(deadline, std::max(twin_.next(deadline), now_ + rt::Nanos{1000}));
      twin_.act(now_);
    }
  }
  [[nodiscard]] rt::Time now() const noexcept override { return now_; }
  void sleep_until(rt::Time t) noexcept override {
    now_ = std::max(now_, t);
    twin_.act(now_);
  }
  [[nodiscard]] int frames() const noexcept { return frames_; }
  // What the frames meet is random with one seed: `n` frames on, it is something else.
  void draw(int n) noexcept {
    std::array<std::uint8_t, 60> nothing{};
    for (int i = 0; i < n; ++i) twin_.take(nothing, now_);
    while (twin_.give(bytes_, now_ + std::chrono::seconds{1}) > 0) {
    }
  }

 private:
  static std::vector<teletact::TwinFault> parsed(const std::vector<std::string>& texts) {
    std::vector<teletact::TwinFault> out;
    for (const auto& t : texts) out.push_back(teletact::parse_twin_fault(t));
    return out;
  }
  teletact::FaultyTwin twin_;
  rt::Time now_ = rt::time_from_ns(1'000'000'000);
  std::array<std::uint8_t, 1600> bytes_{};
  int frames_ = 0;
};

}  // namespace tests
