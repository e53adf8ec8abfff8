// A program drives the chain on a card; every other command that opens the card is tried beside it.
// In a network of its own, where this user may make one.
#include <gmock/gmock.h>
#include <sched.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstdlib>
#include <functional>
#include <sstream>

#include "drivers/ethercat/card_claim.hpp"
#include "drivers/ethercat/raw_port.hpp"
#include "drivers/ethercat/registers.hpp"
#include "drivers/youbot_bus/ethercat_youbot.hpp"
#include "tools/bus/ethercat_command.hpp"
#include "tools/bus/youbot_command.hpp"

namespace {

using namespace teletact;
using namespace std::chrono_literals;
namespace ec = drivers::ethercat;
namespace yb = drivers::youbot_bus;

pid_t forked(const std::function<void()>& body) {
  const pid_t pid = ::fork();
  if (pid != 0) return pid;
  try {
    body();
  } catch (const std::exception& e) {
    std::fprintf(stderr, "%s\n", e.what());
  }
  ::_exit(0);
}

void end(pid_t pid) {
  ::kill(pid, SIGKILL);
  ::waitpid(pid, nullptr, 0);
}

// The chain in OP, and cycles until it is killed. A machine that is busy may let it wait.
void drive(bool claims, int ready) {
  rt::Startup startup;
  std::unique_ptr<ec::CardClaim> claim;
  if (claims) claim = std::move(ec::claim_silent_card(startup.token(), "sp0").value());
  const auto port = ec::RawPort::open(startup.token(), "sp0");
  ec::MasterConfig c;
  c.watchdog_ms = 5000;
  c.bad_limit = 1'000'000;
  ec::Master master(startup.token(), *port.value(), c);
  for (int i = 0; i < 50 && !yb::bring_up(startup.token(), master, "base"); ++i)
    port.value()->sleep_until(port.value()->now() + 20ms);
  if (::write(ready, "x", 1) != 1) return;
  for (;;) {
    (void)master.exchange();
    port.value()->sleep_until(port.value()->now() + 5ms);
  }
}

// All five slaves in OP, with the addresses that the owner gave: read beside it.
bool all_in_op() {
  EtherCatChoice choice;
  choice.iface = "sp0";
  choice.looks = true;
  EtherCatSession look(choice);
  if (look.count() != 5) return false;
  for (int i = 0; i < 5; ++i) {
    std::array<std::uint8_t, 2> state{}, station{};
    if (!look.look(i, ec::reg::kAlStatus, state) || !look.look(i, ec::reg::kStation, station) ||
        state[0] != static_cast<std::uint8_t>(ec::AlState::kOp) ||
        ec::load_u16(station) != ec::kFirstStation + i)
      return false;
  }
  return true;
}

struct Command {
  const char* name;
  std::function<int()> run;
};

std::vector<Command> writers() {
  EtherCatOptions scan, to, sii, parameter, memory, write;
  for (EtherCatOptions* o : {&scan, &to, &sii, &parameter, &memory, &write}) {
    o->bus.iface = "sp0";
    o->slave = 2;
  }
  to.to = "init";
  sii.sii = 8;
  parameter.parameter = 156;
  memory.reg = 0x1080;
  write.reg = 0x0120;
  write.value = 1;
  YoubotOptions bench;
  bench.bus.iface = "sp0";
  TwinOptions twin;
  twin.iface = "sp0";
  twin.seconds = 0.5;
  const auto person = [] { return std::make_shared<std::istringstream>("move\n"); };
  return {{"scan", [=] { return run_scan(scan); }},
          {"state --to", [=] { return run_state(to); }},
          {"read --sii", [=] { return run_read(sii); }},
          {"read --parameter", [=] { return run_read(parameter); }},
          {"read --register 0x1080", [=] { return run_read(memory); }},
          {"write --register", [=] { return run_write(write); }},
          {"check", [=] { return run_youbot_check(bench); }},
          {"setup", [=] { return run_youbot_setup(bench, *person()); }},
          {"jog", [=] { return run_youbot_jog(bench, *person()); }},
          {"twin", [=] { return run_youbot_twin(twin); }}};
}

std::string refusal_of(const Command& c) {
  try {
    return "taken, and ended with " + std::to_string(c.run());
  } catch (const std::runtime_error& e) {
    return e.what();
  }
}

// In a child; what is wrong goes to its standard error. 100: no such right here.
int beside_a_driver(bool claims, int tries) {
  if (::unshare(CLONE_NEWNET) != 0 ||
      std::system("ip link add sp0 type veth peer name sp1 2>/dev/null && ip link set sp0 up && "
                  "ip link set sp1 up") != 0)
    return 100;
  const pid_t twin = forked([] {
    TwinOptions o;
    o.iface = "sp1";
    o.chain = "base";
    (void)run_youbot_twin(o);
  });
  int ready[2];
  char byte = 0;
  if (::pipe(ready) != 0) return 99;
  const pid_t driver = forked([&] { drive(claims, ready[1]); });
  int wrong = ::read(ready[0], &byte, 1) == 1 && all_in_op() ? 0 : 50;
  const std::string owner = "(pid " + std::to_string(driver) + ") owns it";
  for (int k = 0; k < tries && wrong == 0; ++k) {
    for (const Command& c : writers()) {
      if (!claims && std::string(c.name) == "twin") continue;  // its master may be there first
      const std::string why = refusal_of(c);
      const bool refused = why.find(claims ? owner : "another master") != std::string::npos;
      if (refused && all_in_op()) continue;
      std::fprintf(stderr, "%s: %s\n", c.name, why.c_str());
      ++wrong;
    }
    EtherCatOptions look;
    look.bus.iface = "sp0";
    wrong += run_state(look);
    look.reg = 0x0130;
    wrong += run_read(look) + (all_in_op() ? 0 : 1);
  }
  // Killed, it owns nothing, and slaves in SAFEOP are no owner.
  end(driver);
  if (wrong == 0 && refusal_of(writers()[0]) != "taken, and ended with 0") wrong = 60;
  end(twin);
  return wrong;
}

void expect_refused(bool claims, int tries) {
  const pid_t child = ::fork();
  if (child == 0) {
    int code = 98;
    try {
      code = beside_a_driver(claims, tries);
    } catch (const std::exception& e) {
      std::fprintf(stderr, "%s\n", e.what());
    }
    ::_exit(code);
  }
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  ASSERT_TRUE(WIFEXITED(status));
  if (WEXITSTATUS(status) == 100) GTEST_SKIP() << "no network of its own here";
  EXPECT_EQ(WEXITSTATUS(status), 0);
}

TEST(SecondProgram, EveryCommandIsRefusedWithTheOwnersPidAndChangesNothing) {
  expect_refused(true, 10);
}

TEST(SecondProgram, AMasterThatClaimsNothingIsHeardByEachOfThem) { expect_refused(false, 1); }

}  // namespace
