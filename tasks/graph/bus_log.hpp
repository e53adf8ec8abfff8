// What robot_io says of its bus and motors, for a person: which fault, of which slave or wheel, and
// what to do.
#pragma once

#include <array>

#include "rt/audit/rt_log.hpp"
#include "tasks/robot_io/bus_watch.hpp"
#include "tasks/robot_io/lasting_faults.hpp"

namespace tasks {

class BusLog {
 public:
  BusLog(rt::NonRealtime&, rt::LogSites&);
  void say(rt::RtLog&, rt::Time, const BusReport&) const noexcept;
  void say_over(rt::RtLog&, rt::Time, const LastingFaults::Ended&) const noexcept;

 private:
  void say_state(rt::RtLog&, rt::Time, const drivers::BusDetail&) const noexcept;
  struct Flag {
    std::uint32_t bit = 0;
    rt::LogSite<unsigned> site;
  };
  std::array<Flag, 10> flags_{};
  rt::LogSite<unsigned, unsigned, unsigned> slave_state_;
  rt::LogSite<unsigned> slave_unknown_, slaves_missing_, not_commutated_, encoder_stands_;
  rt::LogSite<unsigned> module_silent_, module_refuses_;            // of a CAN bus
  std::array<rt::LogSite<unsigned, unsigned, unsigned>, 4> joint_;  // by cause: slave, arm, joint
  rt::LogSite<unsigned, double, unsigned> over_;
  rt::LogSite<> bus_off_, queue_full_, interface_down_;
  rt::LogSite<> working_counter_, link_down_, down_, made_safe_;
};

}  // namespace tasks
