#include "drivers/road/arrivals.hpp"

#include <arpa/inet.h>

#include <algorithm>
#include <array>

namespace drivers {

bool ArrivalRate::ready(std::int64_t now_ns) noexcept {
  if (begun_)
    left_ = std::min(at_once_, left_ + 1e-9 * per_s_ * static_cast<double>(now_ns - last_ns_));
  begun_ = true;
  last_ns_ = now_ns;
  return left_ >= 1;
}

bool ArrivalRate::may_begin(std::int64_t now_ns) noexcept {
  if (!ready(now_ns)) return false;
  left_ -= 1;
  return true;
}

std::string place_of(std::string_view address) {
  const std::string text(address.substr(0, address.find('%')));
  in6_addr six{};
  if (::inet_pton(AF_INET6, text.c_str(), &six) != 1) return text;
  std::array<char, INET6_ADDRSTRLEN> out{};
  if (IN6_IS_ADDR_V4MAPPED(&six)) {
    ::inet_ntop(AF_INET, &six.s6_addr[12], out.data(), out.size());
    return out.data();
  }
  std::fill(std::begin(six.s6_addr) + 8, std::end(six.s6_addr), std::uint8_t{0});
  ::inet_ntop(AF_INET6, &six, out.data(), out.size());
  return std::string(out.data()) + "/64";
}

bool ArrivalTurns::known(const std::string& place) const {
  return std::find(known_.begin(), known_.end(), place) != known_.end();
}

std::uint64_t ArrivalTurns::last_turn(const std::string& place) const {
  const auto at = std::find_if(served_.begin(), served_.end(),
                               [&](const Served& s) { return s.place == place; });
  return at == served_.end() ? 0 : at->turn;
}

void ArrivalTurns::serve(const std::string& place) {
  std::erase_if(served_, [&](const Served& s) { return s.place == place; });
  served_.push_back({place, ++turn_});
  if (served_.size() > kMostServed) served_.erase(served_.begin());
}

std::optional<std::size_t> ArrivalTurns::next(std::span<const std::string> places,
                                              std::int64_t now_ns) {
  const bool any = strangers_.ready(now_ns), any_known = of_known_.ready(now_ns);
  if (places.empty() || !(any || any_known)) return std::nullopt;
  std::optional<std::size_t> of_known, of_all;
  std::uint64_t known_turn = 0, all_turn = 0;
  for (std::size_t i = 0; i < places.size(); ++i) {
    const std::uint64_t turn = last_turn(places[i]);
    if (!of_all || turn < all_turn) of_all = i, all_turn = turn;
    if (known(places[i]) && (!of_known || turn < known_turn)) of_known = i, known_turn = turn;
  }
  std::optional<std::size_t> who;
  if (of_known && of_known_.may_begin(now_ns))
    who = of_known;
  else if (of_all && strangers_.may_begin(now_ns))
    who = of_all;
  if (who) serve(places[*who]);
  return who;
}

std::size_t ArrivalTurns::to_drop(std::span<const std::string> places) const {
  std::size_t drop = 0;
  std::ptrdiff_t most = -1;
  for (std::size_t i = 0; i < places.size(); ++i) {
    const std::ptrdiff_t n =
        known(places[i]) ? 0 : std::count(places.begin(), places.end(), places[i]);
    if (n <= most) continue;
    most = n;
    drop = i;
  }
  return drop;
}

void ArrivalTurns::had_session(const std::string& place) {
  std::erase(known_, place);
  known_.push_back(place);
  if (known_.size() > kMostKnown) known_.erase(known_.begin());
}

}  // namespace drivers
