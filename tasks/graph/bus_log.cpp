#include "tasks/graph/bus_log.hpp"

#include <string>

#include "drivers/tmcl/motor_faults.hpp"
#include "tasks/supervision/fault_ids.hpp"

namespace tasks {

namespace {

// "F-RIO-12 slave 4 does not answer; to do: ..."
std::string line_of(rt::FaultId id, const std::string& who) {
  const FaultRow& row = kFaultTable[static_cast<std::size_t>(fault_row(id))];
  return std::string(row.code) + " " + who + "; to do: " + std::string(row.advice);
}

constexpr const char* kWheel =
    "wheel {} (1 front left, 2 front right, 3 back left, 4 back right; on a youBot slaves 2 to "
    "5): ";
constexpr const char* kModule =
    "module {} of the CAN bus (1 front left, 2 front right, 3 back left, 4 back right): ";

rt::FaultId fault_of_bit(unsigned bit) noexcept {
  if (bit == 16) return robot_io_fault::kMotorTimeout;
  return bit == 17 ? robot_io_fault::kI2tExceeded : robot_io_fault::kMotorFault;
}

// Of a youBot's joint, from its slave: the boards of the arms are slaves 6 and 12, each with its
// five joints behind it.
struct JointPlace {
  unsigned arm, joint;
};
JointPlace place_of(unsigned slave) noexcept {
  constexpr unsigned kFirstBoard = 6, kBoardsOfAnArm = 6;
  const unsigned behind = slave < kFirstBoard ? 0 : slave - kFirstBoard;
  return {1 + behind / kBoardsOfAnArm, behind % kBoardsOfAnArm};
}

// Of a joint: which of BusLog's lines.
std::size_t cause_of(drivers::BusTrouble t) noexcept {
  using drivers::BusTrouble;
  if (t == BusTrouble::kJointNotCommutated) return 0;
  if (t == BusTrouble::kJointTimeout) return 1;
  return t == BusTrouble::kJointI2t ? 2 : 3;
}

}  // namespace

BusLog::BusLog(rt::NonRealtime& nrt, rt::LogSites& sites) {
  namespace f = robot_io_fault;
  const auto level = rt::LogLevel::kWarning;
  slave_state_ = sites.add<unsigned, unsigned, unsigned>(
      nrt, level,
      line_of(f::kSlaveState,
              "slave {} left OP: AL status {:#04x} (1 INIT, 2 PREOP, 4 SAFEOP, 8 OP, +16 error), "
              "code {:#06x}"));
  slave_unknown_ = sites.add<unsigned>(
      nrt, level,
      line_of(f::kSlaveState,
              "slave {} tells no state: it does not answer, or it is one more than were found"));
  slaves_missing_ = sites.add<unsigned>(
      nrt, level, line_of(f::kSlavesMissing, "from slave {} on nobody answers"));
  not_commutated_ = sites.add<unsigned>(
      nrt, level, line_of(f::kNotCommutated, "slave {} does not know its commutation"));
  encoder_stands_ = sites.add<unsigned>(
      nrt, level,
      line_of(f::kEncoderStands, kWheel + std::string("told to turn, and its encoder stands")));
  working_counter_ = sites.add<>(
      nrt, level, line_of(f::kWorkingCounter, "a frame came back that not every slave took"));
  link_down_ = sites.add<>(nrt, level, line_of(f::kBusLinkDown, "the network card has no link"));
  bus_off_ = sites.add<>(nrt, level, line_of(f::kBusOff, "the CAN controller is off (bus-off)"));
  queue_full_ = sites.add<>(
      nrt, level, line_of(f::kQueueFull, "frames do not leave: the send queue stays full"));
  interface_down_ =
      sites.add<>(nrt, level, line_of(f::kInterfaceDown, "the CAN interface is down or gone"));
  module_silent_ = sites.add<unsigned>(
      nrt, level, line_of(f::kModuleSilent, kModule + std::string("tells no position any more")));
  module_refuses_ = sites.add<unsigned>(
      nrt, level, line_of(f::kModuleRefuses, kModule + std::string("refuses what it is told")));
  constexpr std::array kWhy{"does not know its commutation", "got no frame in time (timeout)",
                            "was overloaded for too long (I2t)", "reports a fault of its own"};
  for (std::size_t i = 0; i < joint_.size(); ++i)
    joint_[i] = sites.add<unsigned, unsigned, unsigned>(
        nrt, level, line_of(f::kJointUnable, std::string("slave {}, arm {} joint {}, ") + kWhy[i]));
  made_safe_ = sites.add<>(nrt, level,
                           line_of(f::kMadeSafe,
                                   "its motors were stopped: too many of its "
                                   "deadlines were missed, or a job of it hung"));
  over_ = sites.add<unsigned, double, unsigned>(
      nrt, rt::LogLevel::kInfo, "F-RIO-{:02} is over: it was there for {:.1f} s, in {} jobs");
  down_ = sites.add<>(nrt, level, line_of(f::kBusDown, "the motor bus is down"));
  std::size_t n = 0;
  for (const auto& flag : drivers::tmcl::motor_flags()) {
    if (flag.kind == drivers::tmcl::FlagKind::kStatus || n == flags_.size()) continue;
    flags_[n++] = {1U << flag.bit, sites.add<unsigned>(nrt, level,
                                                       line_of(fault_of_bit(flag.bit),
                                                               kWheel + std::string(flag.name)))};
  }
}

void BusLog::say_state(rt::RtLog& log, rt::Time now, const drivers::BusDetail& d) const noexcept {
  const auto slave = static_cast<unsigned>(d.slave);
  if (slave > 0 && d.al_state == 0) {
    log.write(slave_unknown_, now, slave);
  } else {
    log.write(slave_state_, now, slave, unsigned{d.al_state}, unsigned{d.al_code});
  }
}

void BusLog::say_over(rt::RtLog& log, rt::Time now, const LastingFaults::Ended& e) const noexcept {
  constexpr unsigned kFirst = 500;  // ids of robot_io: F-RIO-01 is 501
  log.write(over_, now, e.fault - kFirst, e.lasted_s, e.jobs);
}

void BusLog::say(rt::RtLog& log, rt::Time now, const BusReport& r) const noexcept {
  const auto wheel = static_cast<unsigned>(r.wheel + 1);
  const auto slave = static_cast<unsigned>(r.detail.slave);
  switch (r.fault) {
    case robot_io_fault::kWorkingCounter:
      log.write(working_counter_, now);
      break;
    case robot_io_fault::kSlaveState:
      say_state(log, now, r.detail);
      break;
    case robot_io_fault::kSlavesMissing:
      log.write(slaves_missing_, now, slave);
      break;
    case robot_io_fault::kBusLinkDown:
      log.write(link_down_, now);
      break;
    case robot_io_fault::kNotCommutated:
      log.write(not_commutated_, now, slave);
      break;
    case robot_io_fault::kBusOff:
      log.write(bus_off_, now);
      break;
    case robot_io_fault::kQueueFull:
      log.write(queue_full_, now);
      break;
    case robot_io_fault::kInterfaceDown:
      log.write(interface_down_, now);
      break;
    case robot_io_fault::kModuleSilent:
      log.write(module_silent_, now, slave);
      break;
    case robot_io_fault::kJointUnable: {
      const JointPlace at = place_of(slave);
      log.write(joint_[cause_of(r.detail.trouble)], now, slave, at.arm, at.joint);
      break;
    }
    case robot_io_fault::kModuleRefuses:
      log.write(module_refuses_, now, slave);
      break;
    case robot_io_fault::kMadeSafe:
      log.write(made_safe_, now);
      break;
    case robot_io_fault::kEncoderStands:
      log.write(encoder_stands_, now, wheel);
      break;
    case robot_io_fault::kI2tExceeded:
    case robot_io_fault::kMotorTimeout:
    case robot_io_fault::kMotorFault:
      for (const Flag& f : flags_) {
        const bool mine =
            r.fault == robot_io_fault::kMotorFault
                ? f.bit < 1U << 16U
                : f.bit == (r.fault == robot_io_fault::kMotorTimeout ? 1U << 16U : 1U << 17U);
        if (mine && (r.flags & f.bit) != 0) log.write(f.site, now, wheel);
      }
      break;
    default:
      log.write(down_, now);
  }
}

}  // namespace tasks
