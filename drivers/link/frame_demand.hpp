// What the sending end of the link asks of capture: one frame, and how it is to be coded.
//
// A codec that needs its previous frame must never lose an encoded one. So nothing is encoded
// before the link knows that it will be sent: capture answers a demand with one frame, and the
// next demand is made when that frame has been handed to the line (frame_asker.hpp).
#pragma once

#include <cstdint>

#include "rt/message/fields.hpp"
#include "rt/time.hpp"

namespace drivers {

struct FrameDemand {
  std::uint64_t seq = 0;  // of the frame that is asked for; a demand made again keeps it
  rt::Time made{};
  std::uint32_t rate_kbit_per_s = 0;  // that the line was seen to carry; 0: not known
  std::uint8_t coarser = 0;           // quality steps below what the scene asks for
  std::uint8_t key = 0;               // 1: a frame that needs none before it
};

}  // namespace drivers

template <>
struct rt::Fields<drivers::FrameDemand> {
  using M = drivers::FrameDemand;
  static constexpr auto kList = fields(value(&M::seq), datum(&M::made), value(&M::rate_kbit_per_s),
                                       value(&M::coarser), value(&M::key));
};
static_assert(rt::lists_every_field<drivers::FrameDemand>());
