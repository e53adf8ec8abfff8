// `teletact ethercat` and `teletact youbot`: options that would have no effect are refused, a bus
// on which nobody answers is no bad input, and a jog's file says what moved.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sched.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "tools/bus/ethercat_command.hpp"
#include "tools/bus/youbot_command.hpp"

namespace {

using namespace teletact;
using testing::HasSubstr;

EtherCatOptions on_base() {
  EtherCatOptions o;
  o.bus.twin = "base";
  o.slave = 2;
  return o;
}

// The one line that a bad input ends with.
template <class Run>
std::string bad_input(Run run) {
  try {
    (void)run();
  } catch (const CouldNotDo& e) {
    return std::string("could not do: ") + e.what();
  } catch (const std::runtime_error& e) {
    return e.what();
  }
  return "taken";
}

TEST(BenchOptions, WhatIsOfATwinNeedsOne) {
  EtherCatOptions o;
  o.bus.iface = "lo";
  o.bus.generation = "old";
  o.bus.capture = "never.pcap";
  YoubotOptions y;
  y.bus = o.bus;
  y.bus.capture.clear();
  const std::string why = "--generation is of a twin: it needs --twin KIND";
  EXPECT_EQ(bad_input([&] { return run_capture(o); }), why);
  EXPECT_EQ(bad_input([&] { return run_youbot_check(y); }), why);
  o.bus.capture.clear();
  EXPECT_EQ(bad_input([&] { return run_scan(o); }), why);
  EXPECT_FALSE(std::filesystem::exists("never.pcap"));
  EtherCatOptions twin = on_base();
  twin.bus.generation = "old";
  EXPECT_EQ(run_scan(twin), 0);
}

TEST(BenchOptions, BytesAreOfWhatHasNoSizeOfItsOwn) {
  EtherCatOptions o = on_base();
  o.bytes = 4;
  o.parameter = 4;
  EXPECT_THAT(bad_input([&] { return run_read(o); }), HasSubstr("--bytes"));
  EXPECT_THAT(bad_input([&] { return run_write(o); }), HasSubstr("--bytes"));
  o.bytes = -1;
  EXPECT_EQ(run_read(o), 0);
  o.parameter = -1;
  o.bytes = 4;
  o.sdo = "1018:1";
  EXPECT_THAT(bad_input([&] { return run_read(o); }), HasSubstr("--bytes"));
  EXPECT_THAT(bad_input([&] { return run_write(o); }), HasSubstr("could not do"))
      << "of a write they are the object's; this board has no objects";
  o.sdo.clear();
  o.reg = 0;
  EXPECT_EQ(run_read(o), 0);
}

TEST(BenchOptions, MotorAndModuleAreOfAParameter) {
  for (const bool motor : {true, false}) {
    for (int what = 0; what < 3; ++what) {
      EtherCatOptions o = on_base();
      (motor ? o.motor : o.module) = 0;
      if (what == 0) o.reg = 0;
      if (what == 1) o.sii = 8;
      if (what == 2) o.sdo = "1018:1";
      EXPECT_EQ(bad_input([&] { return run_read(o); }),
                std::string(motor ? "--motor" : "--module") + " is of --parameter")
          << what;
    }
  }
  EtherCatOptions o = on_base();
  o.parameter = 4;
  o.motor = o.module = 0;
  EXPECT_EQ(run_read(o), 0);
}

// In a network of its own, where this user may make one: a cable with nobody at its other end.
TEST(BenchOptions, ACableWithNobodyIsNoBadInput) {
  const pid_t child = ::fork();
  ASSERT_GE(child, 0);
  if (child == 0) {
    if (::unshare(CLONE_NEWNET) != 0 ||
        std::system("ip link add bo0 type veth peer name bo1 2>/dev/null && ip link set bo0 up && "
                    "ip link set bo1 up") != 0)
      ::_exit(100);
    EtherCatOptions o;
    o.bus.iface = "bo0";
    YoubotOptions y;
    y.bus = o.bus;
    int failed = 0;
    const std::string nobody = "could not do: EtherCAT: no frame came back";
    const auto is_that = [&](const std::string& line) { return line.rfind(nobody, 0) == 0; };
    failed += is_that(bad_input([&] { return run_scan(o); })) ? 0 : 1;
    failed += is_that(bad_input([&] { return run_state(o); })) ? 0 : 2;
    o.reg = 0;
    failed += is_that(bad_input([&] { return run_read(o); })) ? 0 : 4;
    failed += is_that(bad_input([&] { return run_write(o); })) ? 0 : 8;
    failed += is_that(bad_input([&] { return run_youbot_check(y); })) ? 0 : 16;
    ::_exit(failed);
  }
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  ASSERT_TRUE(WIFEXITED(status));
  if (WEXITSTATUS(status) == 100) GTEST_SKIP() << "no network of its own here";
  EXPECT_EQ(WEXITSTATUS(status), 0);
}

TEST(BenchOptions, AJogWritesWhatMoved) {
  const std::string path = (std::filesystem::temp_directory_path() /
                            ("teletact_jog_" + std::to_string(::getpid()) + ".json"))
                               .string();
  YoubotOptions o;
  o.bus.twin = "base";
  o.json = path;
  o.slave = 3;
  o.speed_rad_per_s = 0.5;
  o.seconds = 0.2;
  std::istringstream no("no\n"), move("move\n");
  EXPECT_EQ(run_youbot_jog(o, no), 1);
  EXPECT_FALSE(std::filesystem::exists(path)) << "nothing has moved";
  EXPECT_EQ(run_youbot_jog(o, move), 0);
  const auto read = nlohmann::json::parse(std::ifstream(path));
  EXPECT_EQ(read.at("slave"), 3);
  EXPECT_THAT(read.at("drive").get<std::string>(), HasSubstr("front right"));
  EXPECT_EQ(read.at("seconds"), 0.2);
  EXPECT_GT(read.at("to_ticks").get<int>(), read.at("from_ticks").get<int>());
  std::filesystem::remove(path);
}

}  // namespace
