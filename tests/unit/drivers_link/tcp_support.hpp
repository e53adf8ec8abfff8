// One end of a TCP link in this process.
#pragma once

#include <atomic>
#include <functional>
#include <memory>
#include <optional>
#include <thread>

#include "drivers/link/tcp_link.hpp"
#include "tests/unit/drivers_link/support.hpp"

namespace link_test {

inline constexpr std::int64_t kSecond = 1'000'000'000;

inline bool wait_for(const std::function<bool()>& done, int seconds = 20) {
  for (int i = 0; i < seconds * 500; ++i) {
    if (done()) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  return false;
}

// One end: an endpoint with a clock, counting what arrives.
struct End {
  rt::Startup startup;
  drivers::LinkEndpoint endpoint;
  rt::BoxTime clock;
  std::unique_ptr<drivers::TcpLink> link;
  std::atomic<std::int64_t> got{0}, bad{0}, worst_stamp{0}, offset{0};
  std::uint64_t made = 0;
  rt::Random random{11};

  End(rt::Box box, rt::BoxTime time) : endpoint(startup.token(), box), clock(time) {}
  rt::Time now() const { return clock.from_host(rt::monotonic_ns()); }
  void note(rt::Time sent) {
    const std::int64_t age = (now() - sent).count();
    worst_stamp = std::max(worst_stamp.load(), std::abs(age));
    ++got;
  }
  void start(const std::optional<drivers::LinkShapeConfig>& shape = {}) {
    link->start(
        endpoint, [this] { return now(); }, shape,
        [this] { offset = endpoint.clock().offset().count(); });
  }
};

}  // namespace link_test
