// The master's own thread is away for longer than a slave is given: the slave is not blamed for it.
#include <gtest/gtest.h>

#include "drivers/ethercat/register_access.hpp"
#include "drivers/ethercat/scan.hpp"
#include "drivers/ethercat/twin/sii_builder.hpp"
#include "drivers/ethercat/twin/twin_port.hpp"

namespace tests {
namespace {

using namespace drivers::ethercat;
using namespace std::chrono_literals;

// Each sleep takes 100 ms more than was asked for.
class SleepsLong final : public Port {
 public:
  explicit SleepsLong(TwinPort& wire) : wire_(wire) {}
  bool send(std::span<const std::uint8_t> frame) noexcept override { return wire_.send(frame); }
  std::size_t receive(std::span<std::uint8_t> into, rt::Time deadline) noexcept override {
    return wire_.receive(into, deadline);
  }
  [[nodiscard]] rt::Time now() const noexcept override { return wire_.now(); }
  void sleep_until(rt::Time t) noexcept override {
    ++sleeps;
    wire_.sleep_until(t + 100ms);
  }
  int sleeps = 0;

 private:
  TwinPort& wire_;
};

struct OneSlave {
  explicit OneSlave(int busy_looks) {
    EscConfig esc;
    esc.sii_busy_looks = busy_looks;
    SiiBuilder sii;
    sii.identity(7, 8, 9, 1).strings({"slow"});
    wire.add(std::make_unique<Esc>(startup.token(), esc, sii.image(),
                                   std::make_unique<EscApplication>()));
  }
  rt::Startup startup;
  TwinChain wire;
  TwinPort twin{wire};
  SleepsLong port{twin};
  RegisterAccess registers{port};
};

TEST(SlowCaller, ASlaveThatIsBusyForAFewLooksIsReadAllTheSame) {
  OneSlave rig(4);
  const auto found = scan(rig.startup.token(), rig.registers);
  ASSERT_TRUE(found) << found.error();
  ASSERT_EQ(found.value().size(), 1U);
  EXPECT_EQ(found.value()[0].sii.product, 8U);
  EXPECT_GE(rig.port.sleeps, 4);
}

TEST(SlowCaller, ASlaveThatStaysBusyIsGivenUp) {
  OneSlave rig(1'000'000);
  const auto found = scan(rig.startup.token(), rig.registers);
  ASSERT_TRUE(found) << found.error();
  ASSERT_EQ(found.value().size(), 1U);
  const std::string& problem = found.value()[0].problem;
  EXPECT_NE(problem.find("slave 1: SII word 0x0000: the EEPROM stays busy"),
            std::string::npos)
      << problem;
}

}  // namespace
}  // namespace tests
