// Which right is missing, on machines made of files, and what gives it.
#include "tools/doctor/rights.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

namespace {

namespace fs = std::filesystem;
using teletact::Rights;
using testing::HasSubstr;
using testing::Not;

constexpr char kNone[] = "0000000000000000", kBoth[] = "0000000000804000",
               kAll[] = "000001ffffffffff";

class Machine {
 public:
  Machine() {
    std::string name = (fs::temp_directory_path() / "teletact_rights_XXXXXX").string();
    root_ = ::mkdtemp(name.data());
    user("0", "8388608", kNone, kAll);
  }
  ~Machine() { fs::remove_all(root_); }
  Machine(const Machine&) = delete;
  Machine& operator=(const Machine&) = delete;
  void put(const std::string& path, const std::string& text) const {
    fs::create_directories(fs::path(root_ + path).parent_path());
    std::ofstream(root_ + path) << text << "\n";
  }
  void user(const std::string& rtprio, const std::string& memlock, const std::string& effective,
            const std::string& bounding, bool no_new = false) const {
    put("/proc/self/limits", "Max locked memory         " + memlock + "   " + memlock +
                                 "   bytes\nMax realtime priority     " + rtprio + "   99\n");
    put("/proc/self/status", "Name:\tteletact\nCapEff:\t" + effective + "\nCapBnd:\t" + bounding +
                                 "\nNoNewPrivs:\t" + (no_new ? "1" : "0"));
  }
  [[nodiscard]] Rights find(int cpus = 2, const std::string& no_fifo = "",
                            const std::string& program = "/opt/teletact") const {
    return teletact::find_rights({root_, program, cpus, no_fifo});
  }

 private:
  std::string root_;
};

TEST(Rights, AFreshAccountHasNone) {
  const Machine m;
  const Rights r = m.find(2, "Operation not permitted");
  EXPECT_FALSE(r.enough());
  EXPECT_THAT(r.why(), HasSubstr("limit 0: Operation not permitted"));
  EXPECT_THAT(r.why(), HasSubstr("limit 8 MiB"));
  EXPECT_EQ(r.command, "sudo setcap cap_sys_nice,cap_ipc_lock=ep /opt/teletact");
}

TEST(Rights, EachOfThemIsNeeded) {
  const Machine m;
  m.user("98", "8388608", kNone, kAll);
  EXPECT_THAT(m.find().lacks, testing::ElementsAre(HasSubstr("memory")));
  m.user("0", "unlimited", kNone, kAll);
  EXPECT_THAT(m.find(2, "no").lacks, testing::ElementsAre(HasSubstr("priority")));
  m.user("98", "unlimited", kNone, kAll);
  EXPECT_TRUE(m.find().enough());
  EXPECT_EQ(m.find().command, "");
  m.user("0", "8388608", kBoth, kAll);
  EXPECT_TRUE(m.find().enough());
  EXPECT_FALSE(m.find(2, "no").enough()) << "what was tried counts, not what the limit says";
}

TEST(Rights, OneCoreIsNoMatterOfRights) {
  const Machine m;
  m.user("98", "unlimited", kNone, kAll);
  EXPECT_EQ(m.find(1).why(), "one core");
  EXPECT_THAT(m.find(1).command, Not(HasSubstr("setcap")));
  m.user("0", "8388608", kNone, kAll);
  EXPECT_THAT(m.find(1, "no").command, HasSubstr("setcap")) << "the rights first";
  EXPECT_EQ(m.find(1, "no").lacks.size(), 3U);
}

// A file with capabilities outside of the bounding set can not be started at all.
TEST(Rights, WhereTheSessionMayHaveNoneTheCommandSaysSo) {
  const Machine m;
  m.user("0", "8388608", kNone, kNone);
  EXPECT_THAT(m.find(2, "no").command, HasSubstr("--cap-add SYS_NICE --cap-add IPC_LOCK"));
  m.user("0", "8388608", kNone, kAll, true);
  EXPECT_THAT(m.find(2, "no").command, HasSubstr("no-new-privileges"));
}

TEST(Rights, ThePathIsFitForAShell) {
  const Machine m;
  EXPECT_THAT(m.find(2, "no", "/a b/it's/teletact").command,
              HasSubstr(" '/a b/it'\\''s/teletact'"));
}

TEST(Rights, AQuotaBelowTwoCores) {
  const Machine m;
  m.user("98", "unlimited", kNone, kAll);
  m.put("/proc/self/cgroup", "0::/a/b");
  m.put("/sys/fs/cgroup/a/b/cpu.max", "max 100000");
  EXPECT_TRUE(m.find().enough());
  m.put("/sys/fs/cgroup/a/cpu.max", "150000 100000");
  EXPECT_THAT(m.find().why(), HasSubstr("quota of 1.5 cores")) << "of a group above";
  m.put("/sys/fs/cgroup/a/cpu.max", "200000 100000");
  EXPECT_TRUE(m.find().enough());
  m.put("/sys/fs/cgroup/cpu.max", "50000 100000");
  EXPECT_THAT(m.find().why(), HasSubstr("quota of 0.5 cores"))
      << "what a container sees at the top";
}

TEST(Rights, AQuotaOfTheOldHierarchies) {
  const Machine m;
  m.user("98", "unlimited", kNone, kAll);
  m.put("/proc/self/cgroup", "7:memory:/x\n3:cpu,cpuacct:/docker/123\n0::/");
  m.put("/sys/fs/cgroup/cpu,cpuacct/cpu.cfs_quota_us", "-1");
  m.put("/sys/fs/cgroup/cpu,cpuacct/cpu.cfs_period_us", "100000");
  EXPECT_TRUE(m.find().enough());
  m.put("/sys/fs/cgroup/cpu,cpuacct/cpu.cfs_quota_us", "100000");
  EXPECT_THAT(m.find().why(), HasSubstr("quota of 1 cores"));
}

TEST(Rights, OfThisProcessIsAnAnswer) {
  const Rights r = teletact::find_rights();
  EXPECT_EQ(r.enough(), r.command.empty());
}

}  // namespace
