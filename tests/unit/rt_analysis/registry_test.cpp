// Processes that share a host: forked children register, are refused, die, and leave no trace.
#include "rt/sched/registry.hpp"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/file.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <functional>

namespace {

using rt::Nanos;
using rt::Registry;
using rt::RegistryEntry;
using testing::HasSubstr;

RegistryEntry row(const char* task, int cpu, int priority, std::int64_t c_us, std::int64_t t_us) {
  RegistryEntry e;
  e.task = task;
  e.cpu = cpu;
  e.priority = priority;
  e.C = Nanos{c_us * 1000};
  e.T = e.D = Nanos{t_us * 1000};
  return e;
}

class RegistryTest : public testing::Test {
 protected:
  void SetUp() override { Registry::remove(name_); }
  void TearDown() override { Registry::remove(name_); }
  Registry open() {
    auto r = Registry::open(name_);
    EXPECT_TRUE(r.has_value()) << r.error();
    return std::move(r).value();
  }
  std::string name_ = "teletact_test_registry_" + std::to_string(::getpid());
};

// Runs `body` in a child, which then waits until its pipe is closed. Returns its pid and the text
// that body returned.
struct Child {
  pid_t pid = -1;
  int hold = -1;
  std::string said;
  void kill_and_keep_zombie() const { ::kill(pid, SIGKILL); }
  void reap() {
    if (hold >= 0) ::close(hold);
    hold = -1;
    if (pid > 0) ::waitpid(pid, nullptr, 0);
    pid = -1;
  }
};

Child fork_child(const std::function<std::string()>& body) {
  std::array<int, 2> up{}, down{};
  EXPECT_EQ(::pipe2(up.data(), O_CLOEXEC), 0);
  EXPECT_EQ(::pipe2(down.data(), O_CLOEXEC), 0);
  Child child;
  child.pid = ::fork();
  if (child.pid == 0) {
    ::close(up[0]);
    ::close(down[1]);
    std::string text = body();
    text += '\n';
    if (::write(up[1], text.data(), text.size()) < 0) ::_exit(2);
    ::close(up[1]);
    char c = 0;
    while (::read(down[0], &c, 1) > 0) {
    }
    ::_exit(0);
  }
  ::close(up[1]);
  ::close(down[0]);
  child.hold = down[1];
  char c = 0;
  while (::read(up[0], &c, 1) == 1 && c != '\n') child.said += c;
  ::close(up[0]);
  return child;
}

TEST_F(RegistryTest, RegistersListsAndRemoves) {
  {
    Registry r = open();
    const std::array rows{row("haptic", 0, 80, 100, 1000), row("fusion", 1, 79, 20000, 33333)};
    ASSERT_TRUE(r.try_register(rows).has_value());
    Registry other = open();
    const auto seen = other.entries();
    ASSERT_EQ(seen.size(), 2U);
    EXPECT_EQ(seen[0].task, "haptic");
    EXPECT_EQ(seen[0].pid, ::getpid());
    EXPECT_EQ(seen[1].T.count(), 33'333'000);
  }
  EXPECT_TRUE(open().entries().empty());
}

TEST_F(RegistryTest, RefusesTheProcessThatNoLongerFits) {
  Child first = fork_child([&] {
    static Registry r = open();
    const std::array rows{row("fusion", 1, 79, 20000, 33333)};
    return r.try_register(rows).has_value() ? "ok" : "refused";
  });
  ASSERT_EQ(first.said, "ok");
  Registry mine = open();
  const std::array more{row("planning", 1, 60, 40000, 100000)};
  const auto result = mine.try_register(more);
  ASSERT_FALSE(result.has_value());
  EXPECT_THAT(result.error(), HasSubstr("cpu 1 would be used to 1.001, above 0.900"));
  EXPECT_THAT(result.error(), HasSubstr("already there: fusion (pid " + std::to_string(first.pid)));
  EXPECT_EQ(mine.entries().size(), 1U);  // nothing of ours was entered
  const std::array elsewhere{row("planning", 0, 60, 40000, 100000)};
  EXPECT_TRUE(mine.try_register(elsewhere).has_value());
  first.reap();
}

TEST_F(RegistryTest, RefusesWhenAnothersDeadlineWouldBreak) {
  Registry other = open();
  auto tight = row("tight", 0, 50, 1000, 100000);
  tight.D = Nanos{3'000'000};
  ASSERT_TRUE(other.try_register(std::array{tight}).has_value());
  Registry mine = open();
  const auto result = mine.try_register(std::array{row("rude", 0, 70, 4000, 50000)});
  ASSERT_FALSE(result.has_value());
  EXPECT_THAT(result.error(), HasSubstr("task 'tight'"));
  EXPECT_THAT(result.error(), HasSubstr("R = 5.032 ms > D = 3.000 ms"));
  // Below it, it does no harm.
  EXPECT_TRUE(mine.try_register(std::array{row("polite", 0, 40, 4000, 50000)}).has_value());
}

TEST_F(RegistryTest, EqualPrioritiesOfTwoProcessesDelayEachOther) {
  Registry other = open();
  auto a = row("a", 0, 80, 1000, 100000);
  a.D = Nanos{3'000'000};
  ASSERT_TRUE(other.try_register(std::array{a}).has_value());
  Registry mine = open();
  EXPECT_FALSE(mine.try_register(std::array{row("b", 0, 80, 2500, 100000)}).has_value());
}

TEST_F(RegistryTest, AKilledProcessIsForgottenEvenAsAZombie) {
  Child child = fork_child([&] {
    static Registry r = open();
    return r.try_register(std::array{row("x", 0, 80, 80000, 100000)}).has_value() ? "ok" : "no";
  });
  ASSERT_EQ(child.said, "ok");
  Registry mine = open();
  const std::array rows{row("y", 0, 79, 50000, 100000)};
  ASSERT_FALSE(mine.try_register(rows).has_value());
  child.kill_and_keep_zombie();
  for (int i = 0; i < 1000 && !mine.entries().empty(); ++i) ::usleep(1000);
  EXPECT_TRUE(mine.try_register(rows).has_value());
  child.reap();
}

TEST_F(RegistryTest, AChildDoesNotRemoveItsParentsRows) {
  Registry r = open();
  ASSERT_TRUE(r.try_register(std::array{row("x", 0, 80, 100, 1000)}).has_value());
  Child child = fork_child([&] {
    r.unregister();
    return std::string("left alone");
  });
  EXPECT_EQ(child.said, "left alone");
  child.reap();
  EXPECT_EQ(r.entries().size(), 1U);
}

TEST_F(RegistryTest, RegisteringAgainReplacesOwnRowsOrKeepsThem) {
  Registry r = open();
  ASSERT_TRUE(r.try_register(std::array{row("x", 0, 80, 80000, 100000)}).has_value());
  ASSERT_TRUE(r.try_register(std::array{row("x", 0, 80, 85000, 100000)}).has_value());
  ASSERT_FALSE(r.try_register(std::array{row("x", 0, 80, 95000, 100000)}).has_value());
  ASSERT_EQ(r.entries().size(), 1U);
  EXPECT_EQ(r.entries()[0].C.count(), 85'000'000);
  r.unregister();
  EXPECT_TRUE(r.entries().empty());
}

TEST_F(RegistryTest, ManyProcessesAtOnceNeverOvercommit) {
  // 12 children want 0.2 of a core each: exactly 4 fit below 0.90, whoever comes first.
  std::vector<Child> children;
  std::array<int, 2> gate{}, tried{}, release{};
  for (auto* ends : {&gate, &tried, &release}) ASSERT_EQ(::pipe(ends->data()), 0);
  for (int i = 0; i < 12; ++i) {
    // The parent does not wait for the answer before it starts the next: answers go to a file each.
    const pid_t pid = ::fork();
    if (pid == 0) {
      ::close(gate[1]);
      ::close(release[1]);
      char c = 0;
      while (::read(gate[0], &c, 1) > 0) {
      }
      auto r = Registry::open(name_);
      if (!r) ::_exit(3);
      const bool in =
          r.value().try_register(std::array{row("x", 0, 40 + i, 20000, 100000)}).has_value();
      // Held until all have tried.
      if (::write(tried[1], &c, 1) != 1) ::_exit(3);
      ::close(tried[1]);
      while (::read(release[0], &c, 1) > 0) {
      }
      ::_exit(in ? 0 : 1);
    }
    Child child;
    child.pid = pid;
    children.push_back(child);
  }
  ::close(gate[0]);
  ::close(gate[1]);
  ::close(tried[1]);
  char c = 0;
  std::size_t answers = 0;
  while (answers < children.size() && ::read(tried[0], &c, 1) == 1) ++answers;
  EXPECT_EQ(answers, children.size());
  ::close(tried[0]);
  ::close(release[0]);
  ::close(release[1]);
  int in = 0, out = 0;
  for (Child& child : children) {
    int status = 0;
    ::waitpid(child.pid, &status, 0);
    ASSERT_TRUE(WIFEXITED(status));
    ASSERT_NE(WEXITSTATUS(status), 3);
    (WEXITSTATUS(status) == 0 ? in : out) += 1;
  }
  EXPECT_EQ(in, 4);
  EXPECT_EQ(out, 8);
}

TEST_F(RegistryTest, ALockDiesWithItsHolder) {
  Registry mine = open();
  // A child that takes the file's lock and is killed while it holds it.
  const std::string path = "/dev/shm/" + name_;
  Child child = fork_child([&] {
    const int fd = ::open(path.c_str(), O_RDWR);
    return ::flock(fd, LOCK_EX) == 0 ? "locked" : "failed";
  });
  ASSERT_EQ(child.said, "locked");
  child.kill_and_keep_zombie();
  EXPECT_TRUE(mine.try_register(std::array{row("x", 0, 80, 100, 1000)}).has_value());
  child.reap();
}

TEST_F(RegistryTest, AForeignFileIsRefused) {
  const int fd = ::shm_open(("/" + name_).c_str(), O_RDWR | O_CREAT, 0600);
  ASSERT_GE(fd, 0);
  ASSERT_EQ(::ftruncate(fd, 100), 0);
  ::close(fd);
  const auto r = Registry::open(name_);
  ASSERT_FALSE(r.has_value());
  EXPECT_THAT(r.error(), HasSubstr("has 100 bytes"));
  EXPECT_FALSE(Registry::open("a/b").has_value());
}

// As config/systemd/teletact.tmpfiles.conf makes it at the start of the machine.
TEST_F(RegistryTest, AnEmptyFileBecomesTheTable) {
  const int fd = ::shm_open(("/" + name_).c_str(), O_RDWR | O_CREAT, 0666);
  ASSERT_GE(fd, 0);
  ::close(fd);
  Registry mine = open();
  EXPECT_TRUE(mine.try_register(std::array{row("x", 0, 80, 100, 1000)}).has_value());
  EXPECT_EQ(open().entries().size(), 1U);
}

// Whatever the maker's umask: the next user's process must be able to enter its rows too.
TEST_F(RegistryTest, AnotherUserCanShareIt) {
  const mode_t before = ::umask(0077);
  Registry mine = open();
  ::umask(before);
  struct stat info {};
  ASSERT_EQ(::stat(("/dev/shm/" + name_).c_str(), &info), 0);
  EXPECT_EQ(info.st_mode & 0777U, 0666U);
  ASSERT_TRUE(mine.try_register(std::array{row("x", 0, 80, 80000, 100000)}).has_value());
  if (::geteuid() != 0) GTEST_SKIP() << "can not become another user here";
  Child child = fork_child([&]() -> std::string {
    if (::setresuid(65534, 65534, 65534) != 0) return "can not become another user";
    static auto theirs = Registry::open(name_);
    if (!theirs) return theirs.error();
    const auto refused = theirs.value().try_register(std::array{row("y", 0, 79, 20000, 100000)});
    if (refused) return "does not see the first one's rows";
    const auto ok = theirs.value().try_register(std::array{row("y", 0, 79, 5000, 100000)});
    return ok ? "ok" : ok.error();
  });
  EXPECT_EQ(child.said, "ok");
  EXPECT_EQ(mine.entries().size(), 2U) << "a process of another user counts as alive";
  child.reap();
  EXPECT_EQ(mine.entries().size(), 1U);
}

// The other way round: made by an ordinary user, used by root and by a third one.
TEST_F(RegistryTest, ATableThatAnOrdinaryUserMadeServesRootToo) {
  if (::geteuid() != 0) GTEST_SKIP() << "can not become another user here";
  Child child = fork_child([&]() -> std::string {
    if (::setresuid(65534, 65534, 65534) != 0) return "can not become another user";
    ::umask(0027);
    static auto theirs = Registry::open(name_);
    if (!theirs) return theirs.error();
    const auto ok = theirs.value().try_register(std::array{row("y", 0, 79, 5000, 100000)});
    return ok ? "ok" : ok.error();
  });
  ASSERT_EQ(child.said, "ok");
  EXPECT_EQ(open().entries().size(), 1U);
  child.reap();
}

TEST_F(RegistryTest, BadRowsAreNamed) {
  Registry r = open();
  auto bad = row("x", 0, 80, 100, 1000);
  bad.T = Nanos{0};
  EXPECT_THAT(r.try_register(std::array{bad}).error(), HasSubstr("'x'"));
  bad = row("x", -1, 80, 100, 1000);
  EXPECT_THAT(r.try_register(std::array{bad}).error(), HasSubstr("cpu -1"));
  bad = row("x", 0, 100, 100, 1000);
  EXPECT_THAT(r.try_register(std::array{bad}).error(), HasSubstr("priority 100"));
}

TEST_F(RegistryTest, FullTableIsSaid) {
  Registry r = open();
  std::vector<RegistryEntry> rows(513, row("x", 0, 0, 0, 1000));
  EXPECT_THAT(r.try_register(rows).error(), HasSubstr("is full"));
}

TEST_F(RegistryTest, AnAdmissionBecomesRows) {
  rt::AdmissionRequest request;
  request.cpus = {4, 6};
  rt::TaskSpec s;
  s.name = "haptic";
  s.rate = {1000, 1};
  s.budget = Nanos{100'000};
  s.core = 1;
  request.tasks.push_back(s);
  s.name = "robot_io";
  s.box = rt::Box::kRobot;
  request.tasks.push_back(s);
  s.name = "sentinel";
  s.budget = Nanos{5000};
  s.core.reset();
  request.platform.push_back({s, rt::kSentinelPriority});
  request.best_effort = {{"link", 0.05, 0}};
  const auto admission = rt::admit(request);
  ASSERT_TRUE(admission.admitted) << admission.refusal;
  const auto rows = rt::registry_entries(request, admission);
  ASSERT_EQ(rows.size(), 4U);
  EXPECT_EQ(rows[0].cpu, 6);
  EXPECT_EQ(rows[0].priority, 80);
  EXPECT_EQ(rows[2].task, "sentinel@6");
  EXPECT_EQ(rows[2].priority, 95);
  EXPECT_EQ(rows[3].priority, 0);
  EXPECT_EQ(rows[3].C.count(), 50'000'000);
  const auto robots = rt::registry_entries(
      request, admission, [](const std::string&, rt::Box box) { return box == rt::Box::kRobot; });
  ASSERT_EQ(robots.size(), 2U);
  EXPECT_EQ(robots[0].task, "robot_io");
  Registry r = open();
  EXPECT_TRUE(r.try_register(rows).has_value());
}

}  // namespace
