// Waits for a chain that is not whole: a cable that is loose, an emergency stop that is pressed, a
// robot that has no power yet. It reads and changes nothing.
#pragma once

#include <functional>
#include <string>

#include "drivers/ethercat/port.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/result.hpp"

namespace drivers::youbot_bus {

// Told five times a second while boards are missing, in one sentence that says where to look;
// false: it is given up.
using ChainNews = std::function<bool(const std::string&)>;

// Returns once as many slaves answer as `chain` has (base, base+arm, base+2arms, arm; "any": as one
// of them has), of a chain that was waited for in two looks. The number of slaves; the error is the
// last sentence. More slaves than wanted are not waited for: who opens the bus names them.
[[nodiscard]] rt::Result<int> await_chain(rt::NonRealtime&, ethercat::Port&,
                                          const std::string& chain, const ChainNews& news);

}  // namespace drivers::youbot_bus
