// `teletact can` on simulated modules, and on an interface where the kernel has one.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <net/if.h>
#include <sys/socket.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "drivers/can/socket_port.hpp"
#include "tools/bus/can_command.hpp"
#include "tools/bus/ethercat_session.hpp"

namespace {

using teletact::CanOptions;
using testing::HasSubstr;

CanOptions twin() {
  CanOptions o;
  o.bus.twin = true;
  return o;
}

struct File {
  File()
      : path(std::filesystem::temp_directory_path() /
             ("teletact_can_" + std::to_string(getpid()) + ".json")) {}
  ~File() { std::filesystem::remove(path); }
  [[nodiscard]] nlohmann::json read() const { return nlohmann::json::parse(std::ifstream(path)); }
  std::filesystem::path path;
};

TEST(CanCommand, ScanFindsTheModulesAndNobodyElse) {
  File file;
  CanOptions o = twin();
  o.last_id = 40;
  o.json = file.path;
  EXPECT_EQ(teletact::can_scan(o), 0);
  const auto modules = file.read().at("result").at("modules");
  ASSERT_EQ(modules.size(), 4U);
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_EQ(modules[i].at("id"), 2 * i + 1);
    EXPECT_EQ(modules[i].at("reply_id"), 2);
    EXPECT_EQ(modules[i].at("type"), 1640);
  }
}

TEST(CanCommand, GetAndSet) {
  File file;
  CanOptions o = twin();
  o.id = 3;
  o.parameter = 70;
  o.global = true;
  o.json = file.path;
  EXPECT_EQ(teletact::can_get(o), 0);
  EXPECT_EQ(file.read().at("result").at("value"), 2);
  o.global = false;
  o.parameter = 2;
  o.value = -300;
  EXPECT_THROW((void)teletact::can_set(o), std::runtime_error) << "nothing moves unconfirmed";
  o.yes = true;
  EXPECT_EQ(teletact::can_set(o), 0);
  EXPECT_EQ(file.read().at("result").at("value"), -300);
  o.parameter = 200;
  EXPECT_EQ(teletact::can_get(o), 1) << "the module refuses it";
  EXPECT_EQ(file.read().at("result").at("status"), 3);
  o.id = 99;
  EXPECT_THROW((void)teletact::can_get(o), teletact::CouldNotDo);
}

TEST(CanCommand, OneBusIsNamed) {
  CanOptions o;
  EXPECT_THROW((void)teletact::can_scan(o), std::runtime_error);
  o.bus.twin = true;
  o.bus.iface = "can0";
  EXPECT_THROW((void)teletact::can_scan(o), std::runtime_error);
}

TEST(SocketPort, WhatIsNotThereIsSaidInOneLine) {
  rt::Startup startup;
  try {
    (void)drivers::can::open_socket_port(startup.token(), {"nocan7", {}, 1 << 16});
    FAIL() << "there is no such interface";
  } catch (const std::runtime_error& e) {
    EXPECT_THAT(e.what(), HasSubstr("nocan7"));
    EXPECT_EQ(std::string(e.what()).find('\n'), std::string::npos);
    EXPECT_THAT(e.what(), testing::AnyOf(HasSubstr("modprobe"), HasSubstr("ip -details")));
  }
}

// Where somebody has made vcan0: `ip link add vcan0 type vcan; ip link set vcan0 up`.
TEST(SocketPort, TwoEndsOfAnInterface) {
  if (if_nametoindex("vcan0") == 0) GTEST_SKIP() << "no vcan0 on this machine";
  rt::Startup startup;
  const auto a = drivers::can::open_socket_port(startup.token(), {"vcan0", {2}, 1 << 16});
  const auto b = drivers::can::open_socket_port(startup.token(), {"vcan0", {}, 1 << 16});
  const rt::Time now = rt::time_from_ns(5'000'000'000);
  std::array<drivers::can::CanFrame, 3> frames{};
  for (std::size_t i = 0; i < 3; ++i)
    frames[i] = {static_cast<std::uint32_t>(i + 1), false, false, 1, {}};
  ASSERT_EQ(b->send(now, frames), 3);
  std::array<drivers::can::Received, 8> in{};
  ASSERT_EQ(a->receive(now, in), 1) << "the filter lets identifier 2 alone through";
  EXPECT_EQ(in[0].frame.id, 2U);
  EXPECT_LE(in[0].at, now);
  EXPECT_GT(in[0].at, now - std::chrono::seconds{1});
  EXPECT_EQ(b->receive(now, in), 0) << "not its own";
}

}  // namespace
