// The virtual youBot on a network interface of the guest: each frame that comes passes the chain
// and goes back. It stands for hardware, so its thread is above all others.
//
//   vm_chain --iface IF [--kind base+arm] [--gap-ms MS] [--long-gap-ms MS] [--check none]
//
// SIGUSR1, SIGUSR2: all frames are swallowed for the gap, for the long one. SIGTERM: prints what it
// saw and ends. --check: checked_port.hpp.
#include <csignal>
#include <cstdint>

#include "drivers/ethercat/frame.hpp"
#include "drivers/ethercat/raw_port.hpp"
#include "drivers/youbot_bus/twin/youbot_chain.hpp"
#include "tests/vm/guest/checked_port.hpp"
#include "tests/vm/guest/say.hpp"

namespace {

constexpr int kPriority = 90;

volatile std::sig_atomic_t gap_wanted = 0, end_wanted = 0;
void on_signal(int number) { (number == SIGTERM ? end_wanted : gap_wanted) = number; }

// Motors turn on without a frame; what is not done now would be done at the next frame, all at
// once.
void idle(drivers::youbot_bus::YoubotChain& chain, rt::Time now) {
  for (std::size_t i = 0; i < chain.boards().size(); ++i) {
    if (chain.drive(i) != nullptr) (void)chain.drive(i)->flags(now);
  }
}

rt::Nanos milliseconds(double ms) { return rt::Nanos{static_cast<std::int64_t>(1e6 * ms)}; }

}  // namespace

int main(int argc, char** argv) {
  using namespace drivers;
  rt::Startup startup;
  const auto kind =
      youbot_bus::chain_kind_of(vm::option(argc, argv, "kind", std::string("base+arm")));
  auto port =
      ethercat::RawPort::open(startup.token(), vm::option(argc, argv, "iface", std::string("lo")));
  if (!kind || !port) {
    std::fprintf(stderr, "%s\n", port ? "--kind: no such chain" : port.error().c_str());
    return 2;
  }
  vm::CheckedPort wire(*port.value(), vm::option(argc, argv, "check", std::string("none")));
  youbot_bus::YoubotChainConfig config;
  config.kind = *kind;
  config.initialised = true;
  // Boards that stood without a frame for 100 ms before the master's first cycle take outputs on: a
  // frame that is short here is one that the road damaged.
  config.esc.error_closes_outputs = false;
  youbot_bus::YoubotChain chain(startup.token(), config);
  const rt::Nanos gap = milliseconds(vm::option(argc, argv, "gap-ms", 0.0));
  const rt::Nanos long_gap = milliseconds(vm::option(argc, argv, "long-gap-ms", 0.0));
  for (const int number : {SIGUSR1, SIGUSR2, SIGTERM}) {
    struct sigaction action {};
    action.sa_handler = on_signal;
    ::sigaction(number, &action, nullptr);
  }
  vm::become_real_time(kPriority);

  std::array<std::uint8_t, ethercat::kMaxFrame + 4> frame{};
  std::uint64_t passed = 0, swallowed = 0, refused = 0;
  rt::Time gap_until{};
  while (end_wanted == 0) {
    const rt::Time until = wire.now() + std::chrono::milliseconds{2};
    const std::size_t bytes = wire.receive(frame, until);
    const rt::Time now = wire.now();
    if (gap_wanted != 0) {
      gap_until = now + (gap_wanted == SIGUSR1 ? gap : long_gap);
      gap_wanted = 0;
    }
    if (bytes == 0 || now < gap_until) {
      swallowed += bytes > 0 ? 1 : 0;
      idle(chain, now);
      continue;
    }
    const auto used = std::span(frame).first(bytes);
    chain.wire().pass(used, now);
    ++(wire.send(used) ? passed : refused);
  }
  vm::figure("chain.passed", static_cast<double>(passed), "1");
  vm::figure("chain.swallowed", static_cast<double>(swallowed), "1");
  vm::figure("chain.refused", static_cast<double>(refused), "1");
  vm::figure("chain.wrong_sequence", static_cast<double>(wire.wrong()), "1");
  return 0;
}
