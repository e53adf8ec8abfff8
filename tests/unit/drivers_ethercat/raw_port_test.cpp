// The port on a network card, as far as a machine without a second one allows: its errors, and the
// loopback interface, on which a frame comes back as it was sent: from no slave.
#include "drivers/ethercat/raw_port.hpp"

#include <gtest/gtest.h>
#include <sched.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>

#include "drivers/ethercat/register_access.hpp"
#include "drivers/ethercat/scan.hpp"

namespace {

using namespace drivers::ethercat;

TEST(RawPort, NamesAnInterfaceThatIsNotThere) {
  rt::Startup startup;
  const auto port = RawPort::open(startup.token(), "no_such_card");
  ASSERT_FALSE(port);
  EXPECT_EQ(port.error(), "interface no_such_card: there is none of this name");
}

// In a child without rights: the line says which one is missing.
TEST(RawPort, WithoutTheRightItSaysWhich) {
  const pid_t child = ::fork();
  ASSERT_GE(child, 0);
  if (child == 0) {
    if (::geteuid() == 0 && ::setuid(65534) != 0) ::_exit(3);
    rt::Startup startup;
    const auto port = RawPort::open(startup.token(), "lo");
    if (port) ::_exit(2);  // this user has the right all the same
    ::_exit(port.error().find("CAP_NET_RAW") != std::string::npos ? 0 : 1);
  }
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  ASSERT_TRUE(WIFEXITED(status));
  if (WEXITSTATUS(status) >= 2) GTEST_SKIP() << "rights could not be dropped here";
  EXPECT_EQ(WEXITSTATUS(status), 0);
}

// In a network of its own, where this user may make one: the cable is pulled at the other end. The
// kernel takes the frame all the same.
TEST(RawPort, ACardWithoutACarrierTakesFramesAndSaysThatItHasNone) {
  const pid_t child = ::fork();
  ASSERT_GE(child, 0);
  if (child == 0) {
    const auto did = [](const char* command) { return std::system(command) == 0; };
    if (::unshare(CLONE_NEWNET) != 0 ||
        !did("ip link add rp0 type veth peer name rp1 2>/dev/null && ip link set rp0 up && "
             "ip link set rp1 up"))
      ::_exit(2);
    rt::Startup startup;
    const auto port = RawPort::open(startup.token(), "rp0");
    if (!port) ::_exit(2);
    const auto becomes = [&](bool up) {
      for (int i = 0; i < 300 && port.value()->link_up() != up; ++i) ::usleep(10'000);
      return port.value()->link_up() == up;
    };
    const std::array<std::uint8_t, 60> frame{};
    int failed = becomes(true) ? 0 : 10;
    failed += did("ip link set rp1 down") && becomes(false) ? 0 : 20;
    failed += port.value()->send(frame) ? 0 : 40;
    failed += did("ip link set rp1 up") && becomes(true) ? 0 : 80;
    ::_exit(failed);
  }
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  ASSERT_TRUE(WIFEXITED(status));
  if (WEXITSTATUS(status) == 2) GTEST_SKIP() << "no network of its own here";
  EXPECT_EQ(WEXITSTATUS(status), 0);
}

TEST(RawPort, ALoopedFrameIsFromNoSlave) {
  rt::Startup startup;
  auto port = RawPort::open(startup.token(), "lo");
  if (!port) GTEST_SKIP() << port.error();
  EXPECT_TRUE(port.value()->link_up());
  RegisterAccess registers(*port.value());
  registers.set_timeout(std::chrono::seconds{1});
  std::array<std::uint8_t, 1> type{0x55};
  EXPECT_EQ(registers.run(Command::kBrd, broadcast_address(0), type).value_or(9), 0);
  EXPECT_EQ(type[0], 0x55) << "nothing was read";
  const auto found = scan(startup.token(), registers);
  ASSERT_TRUE(found) << found.error();
  EXPECT_TRUE(found.value().empty());
}

}  // namespace
