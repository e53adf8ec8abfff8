#include "drivers/road/road_names.hpp"

#include <netdb.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <system_error>
#include <thread>
#include <utility>

namespace drivers {

namespace {

using Found = rt::Result<std::vector<std::string>>;

Found ask_system(const std::string& host) {
  addrinfo hints{};
  hints.ai_socktype = SOCK_STREAM;
  addrinfo* all = nullptr;
  if (const int code = ::getaddrinfo(host.c_str(), nullptr, &hints, &all); code != 0)
    return rt::Error{::gai_strerror(code)};
  std::vector<std::string> addresses;
  for (const addrinfo* a = all; a != nullptr; a = a->ai_next) {
    std::array<char, NI_MAXHOST> text{};
    if (::getnameinfo(a->ai_addr, a->ai_addrlen, text.data(), text.size(), nullptr, 0,
                      NI_NUMERICHOST) == 0)
      addresses.emplace_back(text.data());
  }
  ::freeaddrinfo(all);
  return addresses;
}

}  // namespace

struct RoadNames::Out {
  std::atomic<bool> done{false};
  Found found = rt::Error{""};
};

RoadNames::RoadNames(std::string host, RoadLookup lookup)
    : host_(std::move(host)), lookup_(lookup ? std::move(lookup) : ask_system) {}

void RoadNames::ask() {
  if (out_) return;
  out_ = std::make_shared<Out>();
  try {
    std::thread([out = out_, host = host_, lookup = lookup_] {
      out->found = lookup(host);
      out->done.store(true, std::memory_order_release);
    }).detach();
  } catch (const std::system_error& no_thread) {
    out_->found = rt::Error{no_thread.what()};
    out_->done.store(true, std::memory_order_release);
  }
}

std::optional<Found> RoadNames::answer() {
  if (!out_ || !out_->done.load(std::memory_order_acquire)) return std::nullopt;
  Found found = std::move(out_->found);
  out_.reset();
  if (!found || found.value().empty()) return found;
  auto& all = found.value();
  const std::size_t first = passed_over_ % all.size();
  std::rotate(all.begin(), all.begin() + static_cast<std::ptrdiff_t>(first), all.end());
  return found;
}

}  // namespace drivers
