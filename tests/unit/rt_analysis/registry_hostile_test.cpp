// The registry's file is writable by every local user: what somebody may do to it, and what comes
// of it. The layout is written here by hand, from registry.hpp's rules and nothing of its code.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/file.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cstdio>
#include <cstring>
#include <limits>
#include <memory>

#include "rt/random.hpp"
#include "rt/sched/registry.hpp"

namespace {

using rt::Nanos;
using rt::Registry;
using rt::RegistryEntry;
using testing::HasSubstr;

struct RawSlot {
  std::int32_t pid = 0, cpu = 0, priority = 0, unused = 0;
  std::uint64_t start = 0, owner = 0;
  std::int64_t C = 0, T = 0, D = 0, J = 0, B = 0;
  std::array<char, 48> task{};
};
constexpr off_t kHeader = 16;
constexpr std::size_t kSlots = 512;
constexpr off_t kSize = kHeader + static_cast<off_t>(kSlots * sizeof(RawSlot));

RegistryEntry row(const char* task, std::int64_t c_us = 100) {
  RegistryEntry e;
  e.task = task;
  e.cpu = 0;
  e.priority = 80;
  e.C = Nanos{c_us * 1000};
  e.T = e.D = Nanos{1'000'000};
  return e;
}

class HostileRegistry : public testing::Test {
 protected:
  void SetUp() override {
    Registry::remove(name_);
    auto opened = Registry::open(name_);
    ASSERT_TRUE(opened) << opened.error();
    registry_ = std::make_unique<Registry>(std::move(opened).value());
    fd_ = ::open(("/dev/shm/" + name_).c_str(), O_RDWR | O_CLOEXEC);
    ASSERT_GE(fd_, 0);
    ASSERT_EQ(::lseek(fd_, 0, SEEK_END), kSize) << "the layout is as written above";
  }
  void TearDown() override {
    registry_.reset();
    ::close(fd_);
    Registry::remove(name_);
  }
  void put(std::size_t slot, const RawSlot& s) const {
    ASSERT_EQ(::pwrite(fd_, &s, sizeof s, kHeader + static_cast<off_t>(slot * sizeof s)),
              static_cast<ssize_t>(sizeof s));
  }
  // A row of a living process that is not this one.
  static RawSlot alive() {
    RawSlot s;
    s.pid = ::getppid();
    s.cpu = 0;
    s.priority = 90;
    s.C = 100'000;
    s.T = s.D = 1'000'000;
    std::strcpy(s.task.data(), "theirs");
    return s;
  }
  rt::Result<bool> try_one(std::int64_t c_us = 100) const {
    const std::array rows{row("mine", c_us)};
    return registry_->try_register(rows);
  }
  std::string name_ = "teletact_test_hostile_" + std::to_string(::getpid());
  std::unique_ptr<Registry> registry_;
  int fd_ = -1;
};

TEST_F(HostileRegistry, RowsThatMakeNoSenseArePassedOver) {
  constexpr std::int64_t kMax = std::numeric_limits<std::int64_t>::max(),
                         kMin = std::numeric_limits<std::int64_t>::min();
  std::size_t slot = 0;
  for (const std::int64_t bad : {std::int64_t{0}, std::int64_t{-1}, kMax, kMin}) {
    for (std::int64_t RawSlot::*field : {&RawSlot::C, &RawSlot::T, &RawSlot::D}) {
      RawSlot s = alive();
      s.*field = bad;
      put(slot++, s);
    }
    for (std::int64_t RawSlot::*field : {&RawSlot::J, &RawSlot::B}) {
      RawSlot s = alive();
      s.*field = bad == 0 ? -1 : bad;
      put(slot++, s);
    }
  }
  for (const std::int32_t bad : {-1, 100, std::numeric_limits<std::int32_t>::min()}) {
    RawSlot s = alive();
    s.priority = bad;
    put(slot++, s);
  }
  RawSlot s = alive();
  s.cpu = -7;
  put(slot++, s);
  s = alive();
  s.task = {};
  put(slot++, s);
  EXPECT_TRUE(registry_->entries().empty());
  const auto entered = try_one();
  EXPECT_TRUE(entered) << entered.error();
  EXPECT_EQ(registry_->entries().size(), 1U);
  put(slot + 1, alive());  // ours took the first free one
  EXPECT_EQ(registry_->entries().size(), 2U) << "a sound row counts";
}

TEST_F(HostileRegistry, RandomBytesNeitherCrashNorHang) {
  constexpr std::uint64_t kSeed = 7301;
  std::printf("seed %llu\n", static_cast<unsigned long long>(kSeed));
  rt::Random r(kSeed);
  for (int n = 0; n < 300; ++n) {
    for (std::size_t slot = 0; slot < 12; ++slot) {
      RawSlot s = alive();
      std::array<std::uint8_t, sizeof s> bytes{};
      std::memcpy(bytes.data(), &s, sizeof s);
      for (std::int64_t k = r.integer(1, 40); k > 0; --k)
        bytes[static_cast<std::size_t>(r.integer(4, sizeof s - 1))] =
            static_cast<std::uint8_t>(r());
      std::memcpy(&s, bytes.data(), sizeof s);
      s.pid = r.integer(0, 9) == 0 ? static_cast<std::int32_t>(r()) : ::getppid();
      s.start = r.integer(0, 1) == 0 ? 0 : s.start;
      put(slot, s);
    }
    for (const RegistryEntry& e : registry_->entries()) {
      ASSERT_GT(e.T.count(), 0);
      ASSERT_GE(e.C.count(), 0);
      ASSERT_FALSE(e.task.empty());
      for (const char c : e.task) ASSERT_TRUE(c >= 0x20 && c < 0x7f);
    }
    const auto result = try_one();
    if (!result) {
      ASSERT_EQ(result.error().find('\n'), std::string::npos);
      ASSERT_EQ(result.error().find('\x1b'), std::string::npos)
          << "words of others reach a terminal";
    }
    registry_->unregister();
  }
}

// A mapped file would be a SIGBUS here.
TEST_F(HostileRegistry, AFileThatIsCutShortIsAnErrorAndNoCrash) {
  ASSERT_TRUE(try_one());
  ASSERT_EQ(::ftruncate(fd_, 100), 0);
  const auto cut = try_one();
  ASSERT_FALSE(cut);
  EXPECT_THAT(cut.error(), HasSubstr("has 100 bytes, this version needs"));
  EXPECT_TRUE(registry_->entries().empty());
  registry_->unregister();
  ASSERT_EQ(::ftruncate(fd_, 0), 0);
  const auto anew = try_one();
  EXPECT_TRUE(anew) << "an empty file is a new table: " << anew.error();
  EXPECT_EQ(registry_->entries().size(), 1U);
}

TEST_F(HostileRegistry, ALockThatIsNotGivenBackIsAnErrorAndNoHang) {
  ASSERT_EQ(::flock(fd_, LOCK_EX), 0);
  const auto held = try_one();
  ASSERT_FALSE(held);
  EXPECT_THAT(held.error(), HasSubstr("is locked by another process"));
  ASSERT_EQ(::flock(fd_, LOCK_UN), 0);
  EXPECT_TRUE(try_one());
}

// Denial is what remains: it is said whose rows are in the way.
TEST_F(HostileRegistry, WhoKeepsOthersOutIsNamed) {
  RawSlot s = alive();
  s.C = 900'000;
  std::strcpy(s.task.data(), "greedy\x1b[2J");
  put(3, s);
  const auto refused = try_one(200);
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error(), HasSubstr("greedy?[2J (pid " + std::to_string(::getppid())));
  for (std::size_t slot = 0; slot < kSlots; ++slot) {
    s = alive();
    s.cpu = 7;
    s.C = 1;
    put(slot, s);
  }
  const auto full = try_one();
  ASSERT_FALSE(full);
  EXPECT_THAT(full.error(), HasSubstr("is full"));
}

// A process that dies between its writes leaves a slot whose pid is 0: free, whatever else is in
// it.
TEST_F(HostileRegistry, AHalfWrittenRowIsFree) {
  RawSlot s = alive();
  s.pid = 0;
  put(0, s);
  EXPECT_TRUE(registry_->entries().empty());
  ASSERT_TRUE(try_one());
  EXPECT_EQ(registry_->entries().size(), 1U);
}

}  // namespace
