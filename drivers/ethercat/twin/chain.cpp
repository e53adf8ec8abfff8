#include "drivers/ethercat/twin/chain.hpp"

#include <algorithm>

namespace drivers::ethercat {

void TwinChain::add(std::unique_ptr<Esc> slave) {
  slaves_.push_back(std::move(slave));
  cut_behind(slaves_.size());
}

void TwinChain::cut_behind(std::size_t n) noexcept {
  const std::size_t end = std::min(n, slaves_.size());
  if (end < slaves_.size() && end != reach_) {
    slaves_[end]->lose_link(0);
    if (end > 0) slaves_[end - 1]->lose_link(1);
  }
  reach_ = end;
  for (std::size_t i = 0; i < slaves_.size(); ++i) {
    const std::size_t last = i < reach_ ? reach_ : slaves_.size();
    slaves_[i]->set_place(i, last - 1 - i);
  }
}

void TwinChain::pass(std::span<std::uint8_t> frame, rt::Time now) noexcept {
  pass_first(reach_, frame, now);
}

// ESC data sheet I, "error counters": the port that first hears a wrong check sequence counts a
// refused frame and marks it; ports that hear the mark count one that was refused before.
// Processing units are on the way out alone.
void TwinChain::pass_damaged(std::span<std::uint8_t> frame, rt::Time now, Damage d) noexcept {
  const std::size_t cable = reach_ == 0 ? 0 : std::min(d.cable, reach_ - 1);
  pass_first(d.out ? cable : reach_, frame, now);
  if (reach_ == 0) return;
  if (!d.out) {
    for (std::size_t i = 0; i < cable; ++i) slaves_[i]->count_damaged(1, i + 1 == cable);
    return;
  }
  for (std::size_t i = cable; i < reach_; ++i) {
    slaves_[i]->count_damaged(0, i == cable);
    slaves_[i]->count_bad_frame();
  }
  for (std::size_t i = 0; i + 1 < reach_; ++i) slaves_[i]->count_damaged(1, false);
}

void TwinChain::pass_first(std::size_t n, std::span<std::uint8_t> frame, rt::Time now) noexcept {
  ++frames_;
  parse_frame(frame, view_);
  // Datagrams before a fault are served: a slave works on the frame as its bytes come. A reserved
  // command is NOP (ETG.1000.4, 5.4), and no fault of the frame.
  if (!view_.good() && view_.fault != FrameFault::kUnknownCommand)
    for (std::size_t i = 0; i < n; ++i) slaves_[i]->count_bad_frame();
  if (view_.count == 0 || n == 0) return;
  frame[6] |= 0x02U;
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t k = 0; k < view_.count; ++k) {
      const DatagramView& v = view_.datagram[k];
      const std::size_t bytes = v.data.size();
      Esc::Passing d{v.command, load_u32(frame, v.at - 8), frame.subspan(v.at, bytes),
                     load_u16(frame, v.at + bytes), load_u16(frame, v.at - 2)};
      slaves_[i]->pass(d, now);
      store_u32(frame, v.at - 8, d.address);
      store_u16(frame, v.at - 2, d.irq);
      store_u16(frame, v.at + bytes, d.counter);
    }
  }
}

}  // namespace drivers::ethercat
