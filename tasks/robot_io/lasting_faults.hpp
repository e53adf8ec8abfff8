// How often a fault that lasts is told to a person: when it begins, once a minute while it is
// there, and when it is over. One that comes and goes within a second is one fault.
//
// Nothing here allocates or waits; one owner.
#pragma once

#include <array>
#include <cstdint>

#include "rt/health.hpp"
#include "rt/time.hpp"

namespace tasks {

class LastingFaults {
 public:
  static constexpr rt::Nanos kQuiet = std::chrono::seconds{1}, kAgain = std::chrono::minutes{1};

  // `who`: slave, wheel or module that it is told of; faults of two are two faults.
  struct Ended {
    rt::FaultId fault = rt::kNoFault;
    int who = 0;
    double lasted_s = 0;
    std::uint32_t jobs = 0;  // in which it was there
  };

  // It is there in this job. True: say so.
  [[nodiscard]] bool is_there(rt::FaultId fault, int who, rt::Time now) noexcept {
    Entry& e = entry(fault, who);
    const bool begins = e.fault != fault || e.who != who;
    if (begins) e = {fault, who, now, now, now, 0};
    e.seen = now;
    ++e.jobs;
    if (!begins && now - e.said < kAgain) return false;
    e.said = now;
    return true;
  }

  // The next one that is over; false: none. Of one that was there for less than a second the line
  // of its beginning says all there is to say.
  [[nodiscard]] bool take_ended(rt::Time now, Ended& out) noexcept {
    for (Entry& e : entries_) {
      if (e.fault == rt::kNoFault || now - e.seen < kQuiet) continue;
      out = {e.fault, e.who, rt::seconds(e.seen - e.begun), e.jobs};
      e = {};
      if (out.lasted_s >= rt::seconds(kQuiet)) return true;
    }
    return false;
  }

 private:
  struct Entry {
    rt::FaultId fault = rt::kNoFault;
    int who = 0;
    rt::Time begun{}, seen{}, said{};
    std::uint32_t jobs = 0;
  };
  // Its own, a free one, or the one that was seen the longest ago.
  Entry& entry(rt::FaultId fault, int who) noexcept {
    Entry* best = &entries_[0];
    for (Entry& e : entries_) {
      if (e.fault == fault && e.who == who) return e;
      const bool better = e.fault == rt::kNoFault
                              ? best->fault != rt::kNoFault
                              : best->fault != rt::kNoFault && e.seen < best->seen;
      if (better) best = &e;
    }
    return *best;
  }
  std::array<Entry, 16> entries_{};
};

}  // namespace tasks
