#include "drivers/ethercat/twin/chain.hpp"

#include <algorithm>

namespace drivers::ethercat {

void TwinChain::add(std::unique_ptr<Esc> slave) {
  slaves_.push_back(std::move(slave));
  cut_behind(slaves_.size());
}

void TwinChain::cut_behind(std::size_t n) noexcept {
  reach_ = std::min(n, slaves_.size());
  for (std::size_t i = 0; i < slaves_.size(); ++i) {
    const std::size_t end = i < reach_ ? reach_ : slaves_.size();
    slaves_[i]->set_place(i, end - 1 - i);
  }
}

void TwinChain::pass(std::span<std::uint8_t> frame, rt::Time now) noexcept {
  ++frames_;
  parse_frame(frame, view_);
  // Datagrams before a fault are served: a slave works on the frame as its bytes come.
  if (!view_.good())
    for (std::size_t i = 0; i < reach_; ++i) slaves_[i]->count_bad_frame();
  if (view_.count == 0 || reach_ == 0) return;
  frame[6] |= 0x02U;
  for (std::size_t i = 0; i < reach_; ++i) {
    for (std::size_t k = 0; k < view_.count; ++k) {
      const DatagramView& v = view_.datagram[k];
      const std::size_t n = v.data.size();
      Esc::Passing d{v.command, load_u32(frame, v.at - 8), frame.subspan(v.at, n),
                     load_u16(frame, v.at + n), load_u16(frame, v.at - 2)};
      slaves_[i]->pass(d, now);
      store_u32(frame, v.at - 8, d.address);
      store_u16(frame, v.at - 2, d.irq);
      store_u16(frame, v.at + n, d.counter);
    }
  }
}

}  // namespace drivers::ethercat
