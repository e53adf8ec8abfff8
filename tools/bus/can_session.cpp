#include "tools/bus/can_session.hpp"

#include <array>
#include <chrono>
#include <stdexcept>
#include <thread>

#include "drivers/can/can_motor_bus.hpp"
#include "drivers/can/socket_port.hpp"
#include "rt/clock/box_time.hpp"
#include "tools/bus/ethercat_session.hpp"

namespace teletact {

namespace can = drivers::can;

CanSession::CanSession(const CanChoice& o) : real_(!o.twin) {
  if (o.iface.empty() != o.twin) throw std::runtime_error("exactly one of --iface IF and --twin");
  if (real_) {
    port_ = can::open_socket_port(startup_.token(), {o.iface, {}, 1 << 18});
    now_ = rt::time_from_ns(rt::monotonic_ns());
    return;
  }
  const can::CanMotorConfig config;
  std::vector<can::TmclModule> modules(config.request_ids.size());
  for (std::size_t i = 0; i < modules.size(); ++i) {
    modules[i].id = static_cast<std::uint32_t>(config.request_ids[i]);
    modules[i].address = static_cast<std::uint8_t>(config.module_addresses[i]);
  }
  port_ = std::make_unique<can::CanTwinPort>(startup_.token(), std::move(modules));
}

std::vector<can::Received> CanSession::wait_1ms() {
  if (real_) std::this_thread::sleep_for(std::chrono::milliseconds{1});
  now_ = real_ ? rt::time_from_ns(rt::monotonic_ns()) : now_ + std::chrono::milliseconds{1};
  std::array<can::Received, 64> in{};
  const int n = port_->receive(now_, in);
  return {in.begin(), in.begin() + n};
}

bool CanSession::ask(const can::CanFrame& f, int ms, const Take& take) {
  int tries = 0;
  while (port_->send(now_, {&f, 1}) != 1) {
    if (++tries > ms)
      throw CouldNotDo(std::string("the frame is not taken: ") + to_text(port_->state()) +
                       "; is a module powered, and the bit rate right?");
    (void)wait_1ms();
  }
  for (int i = 0; i < ms; ++i) {
    for (const auto& r : wait_1ms())
      if (take(r)) return true;
  }
  return false;
}

}  // namespace teletact
