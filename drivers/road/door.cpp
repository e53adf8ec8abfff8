#include "drivers/road/door.hpp"

#include <openssl/crypto.h>

#include <algorithm>

namespace drivers {

namespace {

bool same_box(const RoadPeer& a, const RoadPeer& b) noexcept {
  return a.serial == b.serial && a.key_sha256 == b.key_sha256;
}

// Moves the key's entry to the end; the oldest of too many goes.
template <class Entry>
void remember(std::vector<Entry>& entries, Entry entry) {
  std::erase_if(entries, [&](const Entry& e) { return e.key == entry.key; });
  entries.push_back(std::move(entry));
  if (entries.size() > RoadDoor::kMostRemembered) entries.erase(entries.begin());
}

}  // namespace

std::string RoadDoor::busy() const {
  const bool robot = role_ == rt::Box::kRobot;
  return std::string("busy: ") + (robot ? "operator '" : "robot '") + peer_.name +
         "' is connected; " +
         (robot ? "one operator at a time" : "an operator has one robot at a time");
}

bool RoadDoor::another_waits(const RoadPeer& peer, std::int64_t now_ns) const noexcept {
  return std::any_of(asked_.begin(), asked_.end(), [&](const Asked& a) {
    return a.key != peer.key_sha256 && now_ns - a.at_ns <= kSitOut.count();
  });
}

std::string RoadDoor::judge(const RoadPeer& peer, std::int64_t now_ns) {
  if (now_ns < first_word_until_ns_ && peer.key_sha256 != first_word_.key_sha256)
    return "busy: '" + first_word_.name + "' was cut off and has the first word for some seconds";
  const bool unkept = std::any_of(unkept_.begin(), unkept_.end(), [&](const Unkept& u) {
    return u.key == peer.key_sha256 && now_ns < u.until_ns;
  });
  if (unkept && another_waits(peer, now_ns))
    return "its last second connection did not come, and another box waits: it sits out some "
           "seconds";
  if (state_ == State::kTaken) return busy();
  if (state_ == State::kPromised) {
    if (peer.key_sha256 == peer_.key_sha256 || now_ns < firm_until_ns_) return busy();
    leave(now_ns, End::kOver);
    displaced_ = true;
  }
  return {};
}

std::string RoadDoor::ask_control(const RoadPeer& peer, std::int64_t now_ns,
                                  const RoadToken& fresh) {
  displaced_ = false;
  if (overdue(now_ns)) {
    leave(now_ns, End::kOver);
    displaced_ = true;
  }
  if (std::string why = judge(peer, now_ns); !why.empty()) {
    remember(asked_, Asked{peer.key_sha256, now_ns});
    return why;
  }
  std::erase_if(asked_, [&](const Asked& a) { return a.key == peer.key_sha256; });
  state_ = State::kPromised;
  peer_ = peer;
  token_ = fresh;
  firm_until_ns_ = now_ns + kFirm.count();
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
  first_word_until_ns_ = 0;
  token_ = {};
  return {};
}

void RoadDoor::leave(std::int64_t now_ns, End end) noexcept {
  if (state_ == State::kPromised && end != End::kForgotten)
    remember(unkept_, Unkept{peer_.key_sha256, now_ns + kSitOut.count()});
  if (state_ == State::kTaken && end == End::kCut) {
    first_word_ = peer_;
    first_word_until_ns_ = now_ns + kFirstWord.count();
  }
  state_ = State::kFree;
  token_ = {};
}

}  // namespace drivers
