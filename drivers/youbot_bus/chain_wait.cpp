#include "drivers/youbot_bus/chain_wait.hpp"

#include <algorithm>

#include "drivers/ethercat/register_access.hpp"
#include "drivers/youbot_bus/chain_layout.hpp"

namespace drivers::youbot_bus {

namespace {

constexpr rt::Nanos kLook = std::chrono::milliseconds{200};

// The slaves that there should be, of so many that answer.
std::size_t wanted_of(const std::string& chain, std::size_t there) {
  if (const auto kind = chain_kind_of(chain)) return boards_of(*kind).size();
  std::size_t next = SIZE_MAX;
  for (const ChainKind k : kChainKinds)
    if (const std::size_t n = boards_of(k).size(); n >= there) next = std::min(next, n);
  return next == SIZE_MAX ? there : next;
}

}  // namespace

rt::Result<int> await_chain(rt::NonRealtime&, ethercat::Port& port, const std::string& chain,
                            const ChainNews& news) {
  ethercat::RegisterAccess registers(port);
  int whole_looks = 0;
  for (bool waited = false;; waited = true) {
    const auto there = registers.count_slaves();
    std::string missing;
    if (!there) {
      missing = port.link_up()
                    ? "no frame comes back: look at the cable to the first slave"
                    : "the card has no link: look at the cable to the first slave, and whether "
                      "the robot has power";
    } else {
      const auto n = static_cast<std::size_t>(*there);
      missing = missing_text(n, wanted_of(chain, n));
    }
    whole_looks = missing.empty() ? whole_looks + 1 : 0;
    // Boards that have just got their power come one after the other.
    if (whole_looks > (waited ? 1 : 0)) return *there;
    if (!missing.empty() && !news(missing)) return rt::Error{missing};
    port.sleep_until(port.now() + kLook);
  }
}

}  // namespace drivers::youbot_bus
