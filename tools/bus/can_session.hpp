// The bus that `teletact can` works on: a CAN interface, or simulated TMCL modules in this process.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "drivers/can/twin/can_twin_port.hpp"

namespace teletact {

struct CanChoice {
  std::string iface;
  bool twin = false;
};

class CanSession {
 public:
  // Throws std::runtime_error with one line.
  explicit CanSession(const CanChoice&);
  [[nodiscard]] drivers::can::CanPort& port() { return *port_; }
  [[nodiscard]] rt::Time now() const noexcept { return now_; }
  // A millisecond passes: on a real bus in a sleep, else at once. What has arrived in it.
  [[nodiscard]] std::vector<drivers::can::Received> wait_1ms();
  // Sends, and waits for frames until `take` says true or `ms` have passed. False: it never did.
  // Throws CouldNotDo if the frame can not be sent.
  using Take = std::function<bool(const drivers::can::Received&)>;
  [[nodiscard]] bool ask(const drivers::can::CanFrame&, int ms, const Take& take);

 private:
  rt::Startup startup_;
  bool real_ = false;
  rt::Time now_ = rt::time_from_ns(1'000'000'000);
  std::unique_ptr<drivers::can::CanPort> port_;
};

}  // namespace teletact
