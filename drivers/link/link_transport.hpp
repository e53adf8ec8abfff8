// What carries the link's bytes between two boxes: one ordinary thread that polls a LinkEndpoint
// about once a millisecond. Implementations: TcpLink (plain text, loopback only); a TLS road.
//
// A transport is *single* (a run with one connection: its end is the end of the link) or *lasting*
// (it listens or dials again after each end; the endpoint is renewed for each session).
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "drivers/emulator/network_config.hpp"
#include "drivers/link/endpoint.hpp"
#include "drivers/link/shaper.hpp"

namespace drivers {

// Of a transport with certificates, for people: who is there, and who was turned away. Without them
// all of it stays empty.
struct LinkNotes {
  // Connected now, also where its hand-shake is not over: "operator 'ada' from 10.0.0.3"; empty:
  // nobody.
  std::string peer;
  std::string note;     // how certificates are judged where that is not as usual; when ours ends
  std::string refusal;  // the newest that this box refused, and why
  std::uint64_t refused = 0;             // connections that it did not let in
  std::int64_t certificate_until_s = 0;  // of this box, seconds since 1970; 0: it has none
  double rate_Mbit_per_s = 0;            // what the road is said to carry; 0: images are not paced
};

class LinkTransport {
 public:
  // kClosed: the connection is over. kFault: refused, see fault(). A lasting transport goes from
  // both back to kConnecting by itself.
  enum class State : std::uint8_t { kConnecting, kHandshake, kReady, kClosed, kFault };

  LinkTransport() = default;
  virtual ~LinkTransport() = default;
  LinkTransport(const LinkTransport&) = delete;
  LinkTransport& operator=(const LinkTransport&) = delete;

  // Before start(): what this end sends goes over the network that the scene names, instead of a
  // shape; `epoch_host_ns`: the start of the run on the monotonic clock. False: not by this
  // transport.
  [[nodiscard]] virtual bool emulate(const NetworkConfig& network, std::int64_t epoch_host_ns) {
    static_cast<void>(epoch_host_ns);
    return !network.any();
  }
  // Starts the thread. `now` is the box's clock; the endpoint is used by that thread only from here
  // on. `after_poll` is called there once a millisecond and once more when a connection has ended.
  virtual void start(LinkEndpoint& endpoint, std::function<rt::Time()> now,
                     const std::optional<LinkShapeConfig>& shape,
                     std::function<void()> after_poll) = 0;
  // Sends Bye if it can, ends the thread, closes.
  virtual void stop() = 0;
  // Fault injection and tests: nothing crosses any more and neither side is told.
  virtual void cut() noexcept = 0;

  // Any thread may ask for these.
  [[nodiscard]] virtual State state() const noexcept = 0;
  [[nodiscard]] bool ended() const noexcept { return state() >= State::kClosed; }
  [[nodiscard]] virtual std::string fault() const = 0;  // why, after kFault
  // Which congestion control the kernel works with, read back; empty: no connection, or not known.
  [[nodiscard]] virtual std::string congestion() const { return {}; }
  [[nodiscard]] virtual LinkNotes notes() const { return {}; }
  // Connections whose handshake was complete, so far.
  [[nodiscard]] virtual std::uint64_t sessions() const noexcept = 0;
  // Local time of the last valid message, ns; 0 = never.
  [[nodiscard]] virtual std::int64_t last_heard_ns() const noexcept = 0;
  [[nodiscard]] virtual std::int64_t round_trip_ns() const noexcept = 0;
  [[nodiscard]] virtual std::int64_t clock_uncertainty_ns() const noexcept = 0;
  [[nodiscard]] virtual std::int64_t thread_cpu_ns() const noexcept = 0;
  [[nodiscard]] virtual LinkEndpoint::Stats stats() const = 0;  // after stop()
};

// What a transport's thread tells the others: the answers of the interface as words that any thread
// may read.
class ToldTransport : public LinkTransport {
 public:
  [[nodiscard]] State state() const noexcept override { return state_.load(); }
  [[nodiscard]] std::uint64_t sessions() const noexcept override { return sessions_.load(); }
  [[nodiscard]] std::int64_t last_heard_ns() const noexcept override { return last_heard_.load(); }
  [[nodiscard]] std::int64_t round_trip_ns() const noexcept override { return round_trip_.load(); }
  [[nodiscard]] std::int64_t clock_uncertainty_ns() const noexcept override {
    return uncertainty_.load();
  }
  [[nodiscard]] std::int64_t thread_cpu_ns() const noexcept override { return cpu_.load(); }

 protected:
  std::atomic<State> state_{State::kConnecting};
  std::atomic<std::uint64_t> sessions_{0};
  std::atomic<std::int64_t> last_heard_{0}, round_trip_{0}, uncertainty_{0}, cpu_{0};
};

}  // namespace drivers
