// A piece of the road between two boxes that knows nothing of what crosses it: it holds all bytes
// back for a while, cuts the connections, or changes a byte.
#pragma once

#include <arpa/inet.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <cstdint>
#include <list>
#include <thread>
#include <vector>

#include "rt/clock/box_time.hpp"

namespace two_boxes {

class Proxy {
 public:
  // Who connects here is led on to this port of loopback.
  explicit Proxy(int to) : to_(to), listener_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    sockaddr_in a = loopback(0);
    socklen_t size = sizeof a;
    (void)::bind(listener_, reinterpret_cast<const sockaddr*>(&a), size);
    (void)::listen(listener_, 16);
    (void)::getsockname(listener_, reinterpret_cast<sockaddr*>(&a), &size);
    port_ = ntohs(a.sin_port);
    thread_ = std::thread([this] { run(); });
  }
  ~Proxy() {
    ended_ = true;
    thread_.join();
    close_all();
    ::close(listener_);
  }
  Proxy(const Proxy&) = delete;
  Proxy& operator=(const Proxy&) = delete;

  [[nodiscard]] int port() const noexcept { return port_; }
  // Each returns when it began, on the monotonic clock.
  std::int64_t hold(std::int64_t for_ns) {
    const std::int64_t now = rt::monotonic_ns();
    held_until_ = now + for_ns;
    return now;
  }
  std::int64_t cut() { return done_at(cut_); }
  // The last byte of what the dialling side sends next.
  std::int64_t change_a_byte() { return done_at(change_); }

 private:
  struct Pair {
    int dialling, listening;
  };
  static sockaddr_in loopback(int port) {
    sockaddr_in a{};
    a.sin_family = AF_INET;
    a.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    a.sin_port = htons(static_cast<std::uint16_t>(port));
    return a;
  }
  // Asks the thread for it, and waits until it is done; 0: nothing crossed for 10 s.
  std::int64_t done_at(std::atomic<bool>& asked) {
    done_ = 0;
    asked = true;
    for (int i = 0; i < 10000 && done_ == 0; ++i) ::usleep(1000);
    asked = false;
    return done_;
  }
  bool held() const { return rt::monotonic_ns() < held_until_; }
  void close_all() {
    for (const Pair& p : pairs_) close_pair(p);
    pairs_.clear();
  }
  static void close_pair(const Pair& p) {
    ::close(p.dialling);
    ::close(p.listening);
  }
  void admit() {
    const int from = ::accept4(listener_, nullptr, nullptr, SOCK_CLOEXEC);
    if (from < 0) return;
    const int on = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    const sockaddr_in a = loopback(to_);
    if (::connect(on, reinterpret_cast<const sockaddr*>(&a), sizeof a) == 0)
      pairs_.push_back({from, on});
    else
      close_pair({from, on});
  }
  // False: that direction has ended.
  bool pass(int from, int to, bool dialling) {
    std::array<char, 65536> part{};
    const ssize_t n = ::recv(from, part.data(), part.size(), MSG_DONTWAIT);
    if (n <= 0) return n < 0 && (errno == EAGAIN || errno == EINTR);
    if (dialling && change_.exchange(false)) {
      char& last = part[static_cast<std::size_t>(n) - 1];
      last = static_cast<char>(last ^ 0x10);
      done_ = rt::monotonic_ns();
    }
    for (ssize_t at = 0; at < n;) {
      const ssize_t sent =
          ::send(to, part.data() + at, static_cast<std::size_t>(n - at), MSG_NOSIGNAL);
      if (sent <= 0) return false;
      at += sent;
    }
    return true;
  }
  void run() {
    while (!ended_) {
      if (cut_.exchange(false)) {
        close_all();
        done_ = rt::monotonic_ns();
      }
      std::vector<pollfd> all{{listener_, POLLIN, 0}};
      if (!held())
        for (const Pair& p : pairs_)
          all.insert(all.end(), {{p.dialling, POLLIN, 0}, {p.listening, POLLIN, 0}});
      (void)::poll(all.data(), all.size(), 2);
      std::size_t i = 1;
      for (auto p = pairs_.begin(); p != pairs_.end() && i < all.size() && !held(); i += 2) {
        const bool open = (all[i].revents == 0 || pass(p->dialling, p->listening, true)) &&
                          (all[i + 1].revents == 0 || pass(p->listening, p->dialling, false));
        if (!open) close_pair(*p);
        p = open ? std::next(p) : pairs_.erase(p);
      }
      if (all[0].revents != 0) admit();
    }
  }

  const int to_, listener_;
  int port_ = 0;
  std::atomic<bool> ended_{false}, cut_{false}, change_{false};
  std::atomic<std::int64_t> held_until_{0}, done_{0};
  std::list<Pair> pairs_;
  std::thread thread_;
};

}  // namespace two_boxes
