// The virtual youBot behind a network card.
#include <net/if.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>

#include "drivers/ethercat/card_claim.hpp"
#include "drivers/ethercat/frame.hpp"
#include "drivers/ethercat/raw_port.hpp"
#include "drivers/youbot_bus/twin/youbot_chain.hpp"
#include "tools/bus/twin_faults.hpp"
#include "tools/bus/youbot_command.hpp"

namespace teletact {

namespace ec = drivers::ethercat;
namespace yb = drivers::youbot_bus;

namespace {

volatile std::sig_atomic_t stop_twin = 0;
void on_stop_twin(int) { stop_twin = 1; }

// The card itself, down and up again (netdevice(7)). Up when this object goes.
class CardSwitch {
 public:
  explicit CardSwitch(const std::string& card) : socket_(::socket(AF_INET, SOCK_DGRAM, 0)) {
    std::copy_n(card.begin(), std::min(card.size(), std::size_t{IFNAMSIZ - 1}), request_.ifr_name);
    if (socket_ >= 0 && ::ioctl(socket_, SIOCGIFFLAGS, &request_) == 0 && turn(false)) return;
    const int error = errno;
    if (socket_ >= 0) ::close(socket_);
    throw std::runtime_error("--fault link: " + card + ": " +
                             (error == EPERM ? "needs CAP_NET_ADMIN" : std::strerror(error)));
  }
  ~CardSwitch() {
    (void)turn(false);
    ::close(socket_);
  }
  CardSwitch(const CardSwitch&) = delete;
  CardSwitch& operator=(const CardSwitch&) = delete;
  bool turn(bool down) noexcept {
    const auto up = static_cast<short>(IFF_UP);
    const auto flags = static_cast<short>(request_.ifr_flags & ~up);
    request_.ifr_flags = down ? flags : static_cast<short>(flags | up);
    return ::ioctl(socket_, SIOCSIFFLAGS, &request_) == 0;
  }

 private:
  int socket_;
  ifreq request_{};
};

}  // namespace

int run_youbot_twin(const TwinOptions& o) {
  rt::Startup startup;
  const auto kind = yb::chain_kind_of(o.chain);
  if (!kind)
    throw std::runtime_error("--chain " + o.chain + ": not one of base, base+arm, base+2arms, arm");
  const yb::MotorEffects effects = motor_effects(o.effects);
  std::vector<TwinFault> faults;
  for (const std::string& f : o.faults) faults.push_back(parse_twin_fault(f));
  yb::YoubotChainConfig c;
  c.kind = *kind;
  c.generation = o.generation == "old" ? yb::Generation::kOld : yb::Generation::kNew;
  c.end_stops = true;
  c.initialised = o.ready;
  c.effects = effects;
  yb::YoubotChain chain(startup.token(), c);
  FaultyTwin twin(chain, std::move(faults));
  auto port = ec::RawPort::open(startup.token(), o.iface);
  if (!port) throw std::runtime_error(port.error());
  // It does not listen first: its master may be at work already.
  const auto claim = ec::CardClaim::take(startup.token(), o.iface);
  if (!claim) throw std::runtime_error(claim.error());
  std::optional<CardSwitch> card;
  if (twin.has(TwinFaultKind::kLink)) card.emplace(o.iface);
  std::signal(SIGINT, on_stop_twin);
  std::signal(SIGTERM, on_stop_twin);
  std::printf("virtual youBot %s on %s: %zu slaves\n", yb::to_text(*kind), o.iface.c_str(),
              chain.boards().size());
  if (effects.any()) std::printf("effects: %s\n", effects.names().c_str());
  std::fflush(stdout);

  ec::RawPort& wire = *port.value();
  const rt::Time begin = wire.now();
  const auto most = std::chrono::duration_cast<rt::Nanos>(std::chrono::duration<double>(o.seconds));
  std::array<std::uint8_t, 1600> bytes{};
  twin.start(begin);
  std::uint64_t frames = 0, refused = 0;
  bool down = false;
  while (stop_twin == 0 && (o.seconds <= 0 || wire.now() - begin < most)) {
    twin.act(wire.now());
    if (card && twin.link_down() != down) (void)card->turn(down = twin.link_down());
    std::size_t n = wire.receive(bytes, twin.next(wire.now() + std::chrono::milliseconds{100}));
    if (n > 0 && n <= ec::kMaxFrame) {
      twin.take(std::span(bytes).first(n), wire.now());
      ++frames;
    }
    while ((n = twin.give(bytes, wire.now())) > 0)
      refused += wire.send(std::span(bytes).first(n)) ? 0 : 1;
  }
  std::printf("%llu frames, %llu not sent back\n", static_cast<unsigned long long>(frames),
              static_cast<unsigned long long>(refused));
  return 0;
}

}  // namespace teletact
