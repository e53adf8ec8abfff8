// What the log says of the motor bus: the slave, and on a youBot with two arms which arm it is of.
#include "tasks/graph/bus_log.hpp"

#include <gtest/gtest.h>
#include <spdlog/sinks/base_sink.h>
#include <spdlog/spdlog.h>

#include <mutex>

namespace {

using drivers::BusTrouble;
namespace fault = tasks::robot_io_fault;

class Lines : public spdlog::sinks::base_sink<std::mutex> {
 public:
  std::string last;

 protected:
  void sink_it_(const spdlog::details::log_msg& m) override {
    last.assign(m.payload.data(), m.payload.size());
  }
  void flush_() override {}
};

struct LogRig {
  std::string said(rt::FaultId id, BusTrouble trouble, int slave, std::uint16_t al_state = 0x14) {
    tasks::BusReport r;
    r.fault = id;
    r.detail.trouble = trouble;
    r.detail.slave = static_cast<std::int16_t>(slave);
    r.detail.al_state = al_state;
    r.detail.al_code = 0x1B;
    sink->last.clear();
    bus.say(log, rt::time_from_ns(1'000'000'000), r);
    drain.drain();
    return sink->last;
  }
  rt::Startup startup;
  rt::LogSites sites;
  tasks::BusLog bus{startup.token(), sites};
  rt::RtLog log;
  std::shared_ptr<Lines> sink = std::make_shared<Lines>();
  rt::LogDrain drain{startup.token(), sites, std::make_shared<spdlog::logger>("test", sink)};
};

bool has(const std::string& line, const std::string& part) {
  return line.find(part) != std::string::npos;
}

TEST(BusLog, AJointIsNamedWithItsArm) {
  LogRig rig;
  rig.drain.attach(rig.startup.token(), "robot_io", rig.log);
  for (int joint = 1; joint <= 5; ++joint) {
    for (const int arm : {1, 2}) {
      const int slave = 6 * arm + joint;
      const std::string line = rig.said(fault::kJointUnable, BusTrouble::kJointI2t, slave);
      EXPECT_TRUE(has(line, "F-RIO-31 slave " + std::to_string(slave) + ", arm " +
                                std::to_string(arm) + " joint " + std::to_string(joint) +
                                ", was overloaded"))
          << line;
    }
  }
}

TEST(BusLog, ASlaveOfTheSecondArmHasItsNumber) {
  LogRig rig;
  rig.drain.attach(rig.startup.token(), "robot_io", rig.log);
  const std::string fell = rig.said(fault::kSlaveState, BusTrouble::kSlaveState, 15);
  EXPECT_TRUE(has(fell, "F-RIO-11 slave 15 left OP: AL status 0x14")) << fell;
  EXPECT_TRUE(has(fell, "code 0x001b")) << fell;
  const std::string gone = rig.said(fault::kSlavesMissing, BusTrouble::kSlavesMissing, 12);
  EXPECT_TRUE(has(gone, "F-RIO-12 from slave 12 on nobody answers")) << gone;
}

// No state is known of one that was plugged in while the others are in OP.
TEST(BusLog, ASlaveTooManyHasItsNumber) {
  LogRig rig;
  rig.drain.attach(rig.startup.token(), "robot_io", rig.log);
  const std::string line = rig.said(fault::kSlaveState, BusTrouble::kSlaveState, 12, 0);
  EXPECT_TRUE(has(line, "F-RIO-11 slave 12 tells no state")) << line;
  EXPECT_TRUE(has(line, "one more than were found")) << line;
}

}  // namespace
