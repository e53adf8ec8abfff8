// May forces flow? Who makes safe and who asks for forces are other threads than the owner who
// answers. A request carries the number of make_safe() that it had seen: one that comes later
// overtakes it, whenever the owner looks.
#pragma once

#include <atomic>
#include <cstdint>

namespace drivers {

class ForceGate {
 public:
  // Any thread.
  void make_safe() noexcept { made_safe_.fetch_add(1, std::memory_order_acq_rel); }
  void ask() noexcept {
    asked_.store(made_safe_.load(std::memory_order_acquire) + 1, std::memory_order_release);
  }
  void forget() noexcept { asked_.store(0, std::memory_order_release); }
  [[nodiscard]] bool safe() const noexcept {
    return made_safe_.load(std::memory_order_acquire) != answered_.load(std::memory_order_acquire);
  }
  // The owner. take() ends the request; false: none, or overtaken. There is no instant between the
  // look and the answer: what makes safe in between is newer than what was answered.
  [[nodiscard]] bool asked() const noexcept { return asked_.load(std::memory_order_acquire) != 0; }
  [[nodiscard]] bool take() noexcept {
    const std::uint64_t asked = asked_.exchange(0, std::memory_order_acq_rel);
    if (asked == 0 || asked - 1 != made_safe_.load(std::memory_order_acquire)) return false;
    answered_.store(asked - 1, std::memory_order_release);
    return true;
  }

 private:
  std::atomic<std::uint64_t> made_safe_{0}, answered_{0};
  std::atomic<std::uint64_t> asked_{0};  // 0: nobody; else what made_safe_ was, plus one
};

}  // namespace drivers
