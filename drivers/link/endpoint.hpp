// One end of the link, without a transport: what to send when, and what to do with what arrives.
// The TCP transport (tcp_link.hpp) and the virtual clock's link drive the same object, so the same
// bytes travel in both.
//
// Sending: each outgoing edge is asked for its newest message at its rate; small messages go first;
// an image is fetched (and so encoded bytes are copied) only when the line is free: newest wins.
// After 10 ms without a message of its own an end says that it is alive, so that the other may take
// a silence of a few of these for a fault. Where they gather (gather()), small messages go together
// at most once in that time.
// Receiving: header and CRC are checked, then the edge's handler gets the body with the stamp
// already in local time. The first message must be a Hello of the same schema.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "drivers/link/clock_sync.hpp"
#include "drivers/link/wire.hpp"
#include "rt/memory/non_realtime.hpp"

namespace drivers {

class LinkEndpoint {
 public:
  // Writes the newest message's body into `out` and returns its size; 0 = nothing new.
  using Fill = std::function<std::size_t(std::span<std::uint8_t> out)>;
  // Body of a received message; `sent` is its stamp in local time. False: refused (counted).
  using Deliver = std::function<bool(std::span<const std::uint8_t> body, rt::Time sent)>;
  using Send = std::function<void(std::span<const std::uint8_t> message)>;

  LinkEndpoint(rt::NonRealtime&, rt::Box box);
  // Before the first poll: how pictures are coded (schema_hash()).
  void speak(std::string_view pictures) { schema_ = schema_hash(pictures); }

  // `urgent`, if there is one: while it says so the period is not waited for.
  using Urgent = std::function<bool()>;
  void add_outgoing(MessageId id, rt::Nanos period, bool bulk, Fill fill, Urgent urgent = {});
  void add_incoming(MessageId id, Deliver deliver);

  // Of a transport for which each packet is one more that can be lost: small messages that are due
  // wait for the next turn, one in each `period`, but for urgent ones. Zero: none waits.
  void gather(rt::Nanos period) noexcept { gather_ = period; }

  // Sees every message as it arrived and whether it was taken, after its handler has run.
  using Tap = std::function<void(std::span<const std::uint8_t> message, rt::Time now, bool taken)>;
  void set_tap(Tap tap) { tap_ = std::move(tap); }

  // Called at every poll once both clocks are known; `busy_for`: how long the line will still be
  // busy with what it was given; Nanos::max(): busy, for an unknown time.
  using Ask = std::function<void(rt::Time now, rt::Nanos busy_for)>;
  void set_ask(Ask ask) { ask_ = std::move(ask); }
  // Rungs of FrameAsker that the transport wishes to be spared, because the road's round trip
  // grows.
  void set_wish(int rungs) noexcept { wish_ = rungs; }
  [[nodiscard]] int wish() const noexcept { return wish_; }

  // Called every millisecond or so by the transport; `line_free` says whether bulk may go out;
  // `busy_for` as above, where it is not.
  void poll(rt::Time now, bool line_free, const Send& send, rt::Nanos busy_for = rt::Nanos::max());
  // One whole message as it arrived. False: the connection must be closed; fault() says why.
  [[nodiscard]] bool receive(std::span<const std::uint8_t> message, rt::Time now, const Send& send);

  [[nodiscard]] rt::Box box() const noexcept { return box_; }
  [[nodiscard]] bool ready() const noexcept { return hello_ok_ && clock_.valid(); }
  [[nodiscard]] bool hello_ok() const noexcept { return hello_ok_; }
  [[nodiscard]] bool bye_received() const noexcept { return bye_; }
  [[nodiscard]] const std::string& fault() const noexcept { return fault_; }
  [[nodiscard]] const ClockSync& clock() const noexcept { return clock_; }
  [[nodiscard]] rt::Time last_heard() const noexcept { return last_heard_; }
  [[nodiscard]] bool ever_heard() const noexcept { return ever_heard_; }
  [[nodiscard]] rt::Nanos round_trip() const noexcept { return clock_.round_trip(); }
  // Of the message that a handler is given: when it arrived, and how unsure to_local() is then.
  [[nodiscard]] rt::Time arrived() const noexcept { return arrived_; }
  // Its number among all of its id that were sent.
  [[nodiscard]] std::uint64_t arrived_seq() const noexcept { return arrived_seq_; }
  [[nodiscard]] rt::Nanos unsure() const noexcept { return clock_.uncertainty(arrived_); }
  [[nodiscard]] rt::Time to_local(std::int64_t remote_ns) const noexcept {
    return clock_.to_local({other(), remote_ns});
  }
  // Of that message too: what it says was made later than it arrived, beyond doubt.
  [[nodiscard]] bool from_ahead(rt::Time made) const noexcept {
    return made > arrived_ + unsure() + kAhead;
  }

  struct Stats {
    std::array<std::uint64_t, kMessageIds + 1> sent{}, received{}, refused{};
    std::uint64_t bytes_sent = 0, bytes_received = 0;
  };
  [[nodiscard]] const Stats& stats() const noexcept { return stats_; }
  void send_bye(rt::Time now, const Send& send);

  // Before another connection, of a transport that listens or dials again: forgets what was agreed
  // with the last peer (its Hello, the clocks, Bye, the fault, how far it had counted), so that
  // nothing is read with the clock of a box that may have started again since. What this box says
  // and knows stays: edges and their handlers, when it last heard, the statistics, and the numbers
  // of its own edges, for a receiver that lived through it compares them. Then each of `on_renew`
  // is called, so that a codec can ask for a frame that needs none before it.
  void renew() noexcept;
  void on_renew(std::function<void()> renewed) { renewed_.push_back(std::move(renewed)); }

 private:
  struct Outgoing {
    MessageId id{};
    rt::Nanos period{};
    bool bulk = false;
    Fill fill;
    Urgent urgent;
    rt::Time next{};
    std::uint64_t seq = 0;
  };
  [[nodiscard]] rt::Box other() const noexcept {
    return box_ == rt::Box::kOperator ? rt::Box::kRobot : rt::Box::kOperator;
  }
  void emit(MessageId id, std::uint64_t seq, std::span<const std::uint8_t> body, rt::Time now,
            const Send& send);
  [[nodiscard]] bool on_hello(const Header& h);
  [[nodiscard]] bool take(std::span<const std::uint8_t> message, rt::Time now, const Send& send);

  rt::Box box_;
  std::vector<Outgoing> outgoing_;
  std::array<Deliver, kMessageIds + 1> incoming_{};
  std::vector<std::uint8_t> buffer_;  // message under construction: header and body
  Tap tap_;
  Ask ask_;
  std::uint64_t schema_ = schema_hash();
  ClockSync clock_;
  rt::Time next_clock_{}, next_alive_{}, next_turn_{};
  rt::Nanos gather_{0};
  bool hello_sent_ = false, hello_ok_ = false, bye_ = false, ever_heard_ = false;
  rt::Time last_heard_{}, arrived_{};
  std::uint64_t control_seq_ = 0, arrived_seq_ = 0;
  int clock_replies_ = 0;  // of this connection
  std::vector<std::function<void()>> renewed_;
  int wish_ = 0;
  std::string fault_;
  Stats stats_;
};

}  // namespace drivers
