// When the sending end of the link asks capture for a frame, and for which.
//
// One demand is out at a time. It is answered by one frame, which waits in a queue of one until the
// line is free and is then sent: no encoded frame is ever replaced or thrown away. The next demand
// is made when that frame has been handed to the line, a little before the line is free again, so
// that a slow line does not wait for the camera. A camera frame that nobody asked for is not
// encoded: the newest one wins before it costs anything.
//
// A key (a frame that needs none before it) is asked for at the beginning, after a silence of the
// other end, and when the other end says that its decoder has lost the thread; then once for each
// time that it says so with the last key already there.
//
// A line that is busy nearly all the time with single frames gets coarser ones, then fewer; one
// that is idle much of the time, finer and more again. One step at a time, and not before the last
// one has shown what it does. The first frames of a connection say nothing of the line: what they
// wait for is the transport, which feels its way up from a few packets a round trip. A key is the
// first of them, too.
//
// Pure: time is an argument. One thread: that of the link.
#pragma once

#include <cstdint>
#include <optional>

#include "drivers/link/encoded_frame.hpp"
#include "drivers/link/frame_demand.hpp"
#include "drivers/link/messages.hpp"

namespace drivers {

class FrameAsker {
 public:
  struct Config {
    rt::Nanos period = std::chrono::milliseconds{30};  // least time between two demands
    rt::Nanos lead = std::chrono::milliseconds{34};    // before the line is free: one camera period
    // Until a demand is made again, answered or not: so that its reader hears that the link lives.
    rt::Nanos repeat = std::chrono::milliseconds{50};
    rt::Nanos silence = std::chrono::milliseconds{180};  // then nobody is there to send to
    // From the first frame of a connection until single frames count: some round trips of a road.
    rt::Nanos learn = std::chrono::milliseconds{1500};
  };
  FrameAsker() = default;
  explicit FrameAsker(const Config& config) noexcept : config_(config) {}

  // Once a poll of the endpoint (LinkEndpoint::Ask). `heard`: when the other end last was. A value
  // is to be published, also where it is the last one again.
  [[nodiscard]] std::optional<FrameDemand> poll(rt::Time now, rt::Nanos busy_for,
                                                rt::Time heard) noexcept;
  // The frame that answers demand `seq` goes to the line now. False: it answers none that is out
  // and must not be sent; the next one asked for is a key.
  [[nodiscard]] bool sent(rt::Time now, std::uint64_t seq, bool key, std::size_t bytes) noexcept;
  void report(const FrameReport& report) noexcept;
  // A new connection: what was asked for and not sent is given up, and the next frame is a key.
  void renew() noexcept;
  // At least so many rungs down, whatever single frames show: the line's queue grows by what others
  // send too (LinkEndpoint::wish). 0 to kRungs.
  void wish(int rungs) noexcept;

  // A demand that no frame has answered yet.
  [[nodiscard]] bool out() const noexcept { return asked_ > sent_; }

  static constexpr int kCoarsest = 3;  // quality steps below what the scene asks for
  static constexpr int kRungs = kCoarsest + 2;
  static_assert(kRungs == Spared::kMost);
  struct Stats {
    std::uint64_t sent = 0, keys = 0;
    std::uint64_t keys_asked = 0;  // by the other end
    std::uint64_t silences = 0;
    int rung = 0;  // 0: as the scene asks; to kCoarsest: coarser; then 24 and 20 frames a second
  };
  [[nodiscard]] Stats stats() const noexcept;
  // What is spared now, and why, for people.
  [[nodiscard]] Spared spared() const noexcept;

 private:
  [[nodiscard]] FrameDemand make(rt::Time now) noexcept;
  [[nodiscard]] int rung() const noexcept;
  [[nodiscard]] rt::Nanos period() const noexcept;
  void line_is_free(rt::Time now) noexcept;

  Config config_;
  std::uint64_t asked_ = 0, sent_ = 0;       // numbers of demands
  std::uint64_t frames_ = 0, last_key_ = 0;  // numbers of frames, as the other end sees them
  rt::Time next_{}, repeat_{};
  bool want_key_ = true, silent_ = false;
  bool first_ = true;       // no frame of this connection has been sent
  rt::Time counts_from_{};  // Config::learn
  // The frame that the line works on, and what was learned from those before it.
  bool sending_ = false;
  rt::Time since_{};
  std::size_t bytes_ = 0;
  double load_ = 0;  // time on the line of a frame, in camera periods
  double rate_kbit_per_s_ = 0;
  int rung_ = 0, frames_on_rung_ = 0, wish_ = 0;
  Stats stats_;
};

}  // namespace drivers
