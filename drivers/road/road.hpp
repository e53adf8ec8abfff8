// A road between two boxes: sessions of two TLS connections each, one after the other, for as long
// as the box runs. Control carries small messages, bulk the images, so neither waits for the other.
// Whoever listens decides who may come in (door.hpp); who dials tries again and again.
//
// One thread: run_for() does all the work, and calls the handlers. Nothing here is real-time.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>

#include "drivers/road/road_options.hpp"
#include "rt/result.hpp"

namespace drivers {

class Road {
 public:
  struct Caps {
    std::size_t control = 0, bulk = 0;  // bytes of the longest message of each connection
  };
  struct Handlers {
    std::function<void()> up;  // a session stands
    // A whole message. False: the session is closed with `closing_reason()`.
    std::function<bool(std::span<const std::uint8_t> message)> message;
    std::function<std::string()> closing_reason;
    std::function<void(const std::string& why)> down;  // the session is over
  };

  [[nodiscard]] static rt::Result<std::unique_ptr<Road>> open(const RoadOptions& options,
                                                              const Caps& caps);
  // What open() would refuse but for the port.
  [[nodiscard]] static rt::Result<bool> check(const RoadOptions& options);
  ~Road();
  Road(const Road&) = delete;
  Road& operator=(const Road&) = delete;

  void set_handlers(Handlers handlers);
  // Waits for what the network does, at most so long, and does what is due.
  void run_for(rt::Nanos span);

  [[nodiscard]] bool up() const noexcept;
  // Nothing that was sent before waits in this process: what is sent now is the newest.
  [[nodiscard]] bool control_free() const noexcept;
  // Nothing for bulk waits in this process; how much is under way does not matter.
  [[nodiscard]] bool bulk_taken() const noexcept;
  // How long bulk will still be busy; 0: it is free; Nanos::max(): not known.
  [[nodiscard]] rt::Nanos bulk_busy_for() const noexcept;
  // Copies. Without a session nothing happens. Not `at_once`: the message waits for flush(), and
  // all that wait go as one packet where they fit into one.
  void send(bool bulk, std::span<const std::uint8_t> message, bool at_once = true);
  void flush();
  // Ends the session; what waits is sent first.
  void close_session(const std::string& why);

  // The other side has said that it leaves: an end of the connection is no cut.
  void expect_end() noexcept;

  [[nodiscard]] int port() const noexcept;
  [[nodiscard]] int wish() const noexcept;  // quality steps to be spared, 0 to 5: pace.hpp
  [[nodiscard]] const RoadPeer& peer() const noexcept;             // of the last session
  [[nodiscard]] const std::string& peer_address() const noexcept;  // likewise
  [[nodiscard]] const RoadPeer& self() const noexcept;             // this box's certificate
  [[nodiscard]] std::string congestion() const;                    // of the last session
  [[nodiscard]] const RoadCounts& counts() const noexcept;
  // Why the last attempt to dial, or the last session, ended.
  [[nodiscard]] const std::string& last_end() const noexcept;
  [[nodiscard]] const std::string& last_refusal() const noexcept;  // by this box, of a stranger
  [[nodiscard]] std::string note() const;                          // trust.hpp

 private:
  class Impl;
  explicit Road(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace drivers
