#include "drivers/road/door.hpp"

#include <openssl/crypto.h>

#include <algorithm>

namespace drivers {

namespace {

bool same_box(const RoadPeer& a, const RoadPeer& b) noexcept {
  return a.serial == b.serial && a.key_sha256 == b.key_sha256;
}

}  // namespace

std::string RoadDoor::ask_control(const RoadPeer& peer, std::int64_t now_ns,
                                  const RoadToken& fresh) {
  if (overdue(now_ns)) leave();
  if (state_ != State::kFree) {
    const bool robot = role_ == rt::Box::kRobot;
    return std::string("busy: ") + (robot ? "operator '" : "robot '") + peer_.name +
           "' is connected; " +
           (robot ? "one operator at a time" : "an operator has one robot at a time");
  }
  state_ = State::kPromised;
  peer_ = peer;
  token_ = fresh;
  until_ns_ = now_ns + kTokenLife.count();
  return {};
}

std::string RoadDoor::ask_bulk(const RoadPeer& peer, std::int64_t now_ns, const RoadToken& token) {
  if (state_ != State::kPromised || now_ns > until_ns_)
    return "no session waits for a second connection";
  // In constant time, so that an answer's delay tells nothing of the token.
  const bool same = CRYPTO_memcmp(token.data(), token_.data(), token.size()) == 0;
  if (!same || !same_box(peer, peer_)) return "the second connection does not belong to the first";
  state_ = State::kTaken;
  token_ = {};
  return {};
}

void RoadDoor::leave() noexcept {
  state_ = State::kFree;
  token_ = {};
}

std::size_t arrival_to_drop(std::span<const std::string> addresses) noexcept {
  std::size_t drop = 0;
  std::ptrdiff_t most = 0;
  for (std::size_t i = 0; i < addresses.size(); ++i) {
    const auto n = std::count(addresses.begin(), addresses.end(), addresses[i]);
    if (n <= most) continue;
    most = n;
    drop = i;
  }
  return drop;
}

bool ArrivalRate::may_begin(std::int64_t now_ns) noexcept {
  if (begun_) {
    left_ = std::min(kAtOnce, left_ + 1e-9 * kPerSecond * static_cast<double>(now_ns - last_ns_));
  }
  begun_ = true;
  last_ns_ = now_ns;
  if (left_ < 1) return false;
  left_ -= 1;
  return true;
}

}  // namespace drivers
