// A master in front of a virtual youBot chain, on a clock of the test's own.
#pragma once

#include <gtest/gtest.h>

#include "drivers/ethercat/master.hpp"
#include "drivers/ethercat/twin/twin_port.hpp"
#include "drivers/youbot_bus/twin/youbot_chain.hpp"

namespace tests {

using namespace std::chrono_literals;
namespace ec = drivers::ethercat;
namespace yb = drivers::youbot_bus;

struct BusRig {
  explicit BusRig(const yb::YoubotChainConfig& c = {}, const ec::MasterConfig& m = {})
      : chain(startup.token(), c), port(chain.wire()), master(startup.token(), port, m) {}

  void bring_up() {
    const auto found = master.find(startup.token());
    ASSERT_TRUE(found) << found.error();
    const auto configured = master.configure(startup.token());
    ASSERT_TRUE(configured) << configured.error();
    const auto started = master.start(startup.token());
    ASSERT_TRUE(started) << started.error();
    next = port.now();
  }
  // One cycle on the grid of 1 ms.
  ec::CycleResult cycle() {
    port.set_now(next += 1ms);
    return master.exchange();
  }
  void cycles(int n) {
    for (int i = 0; i < n; ++i) (void)cycle();
  }
  // For this long no frame.
  void pause(rt::Nanos t) { port.set_now(next += t); }
  [[nodiscard]] yb::DriveInputs inputs(std::size_t slave) const {
    yb::DriveInputs in;
    EXPECT_TRUE(yb::decode(master.inputs(slave), in));
    return in;
  }
  void set(std::size_t slave, yb::ControllerMode mode, std::int32_t value) {
    ASSERT_TRUE(yb::encode(yb::DriveOutputs{value, mode}, master.outputs(slave)));
  }
  [[nodiscard]] std::string health() { return master.describe(startup.token(), master.health()); }
  // Sets or gets through the mailbox while cycles run.
  drivers::tmcl::Reply tmcl(std::size_t slave, drivers::tmcl::Command c, std::uint8_t type,
                            std::int32_t value = 0, std::uint8_t bank = 0) {
    const auto bytes = drivers::tmcl::encode(
        drivers::tmcl::Request{0, static_cast<std::uint8_t>(c), type, bank, value});
    EXPECT_TRUE(master.post(slave, bytes));
    for (int i = 0; i < 2000 && master.mailbox().busy(); ++i) (void)cycle();
    drivers::tmcl::Reply reply;
    EXPECT_EQ(master.mailbox().state(), ec::TransferState::kDone);
    EXPECT_TRUE(drivers::tmcl::decode(master.mailbox().reply(), reply));
    return reply;
  }
  // Timeout flags cleared, commutation found.
  void make_ready() {
    for (std::size_t i = 0; i < master.slaves().size(); ++i) {
      if (chain.drive(i) == nullptr) continue;
      EXPECT_EQ(tmcl(i, drivers::tmcl::Command::kSetAxisParameter, 158, 1).status, 100);
      set(i, yb::ControllerMode::kInitialise, 0);
    }
    cycles(300);
    for (std::size_t i = 0; i < master.slaves().size(); ++i)
      if (chain.drive(i) != nullptr) set(i, yb::ControllerMode::kStop, 0);
    cycles(2);
  }

  rt::Startup startup;
  yb::YoubotChain chain;
  ec::TwinPort port;
  ec::Master master;
  rt::Time next{};
};

}  // namespace tests
