// The doctor on machines made of files: one that is fit, and each way to be less than that.
#include "tools/doctor/doctor.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "rt/random.hpp"
#include "tools/doctor/doctor_network.hpp"
#include "tools/teletact/commands.hpp"

namespace {

namespace fs = std::filesystem;
using Level = teletact::DoctorCheck::Level;
using testing::HasSubstr;

constexpr char kCpu[] = "/sys/devices/system/cpu/";

// A fit machine: PREEMPT_RT, four cores, two of them isolated, everything as it should be.
class Machine {
 public:
  Machine() {
    // In memory where that is to be had: each machine is fifty small files.
    std::string name = access("/dev/shm", W_OK) == 0 ? "/dev/shm" : "/tmp";
    name += "/teletact_doctor_XXXXXX";
    root_ = mkdtemp(name.data());
    put("/proc/version", "Linux version 6.1.0-18-rt-amd64 (gcc) #1 SMP PREEMPT_RT Debian");
    put("/proc/sys/kernel/osrelease", "6.1.0-18-rt-amd64");
    put("/proc/cmdline", "BOOT_IMAGE=/vmlinuz root=/dev/sda1 isolcpus=2,3");
    put("/sys/kernel/realtime", "1");
    limits("99", "unlimited");
    put("/proc/self/status", "Name:\tteletact\nCapEff:\t0000000000000000\n");
    put(std::string(kCpu) + "online", "0-3");
    put(std::string(kCpu) + "isolated", "2-3");
    put(std::string(kCpu) + "nohz_full", "2-3");
    put(std::string(kCpu) + "smt/active", "0");
    for (int i = 0; i < 4; ++i) {
      const std::string cpu = std::string(kCpu) + "cpu" + std::to_string(i);
      put(cpu + "/cpufreq/scaling_governor", "performance");
      put(cpu + "/cpuidle/state0/name", "POLL");
      put(cpu + "/cpuidle/state0/latency", "0");
      put(cpu + "/cpuidle/state0/disable", "0");
      put(cpu + "/cpuidle/state1/name", "C6");
      put(cpu + "/cpuidle/state1/latency", "133");
      put(cpu + "/cpuidle/state1/disable", "0");
      put(cpu + "/topology/thread_siblings_list", std::to_string(i));
    }
    put("/dev/cpu_dma_latency", "");
    put("/proc/irq/1/smp_affinity_list", "0-3");
    put("/proc/irq/1/effective_affinity_list", "0");
    put("/proc/irq/24/smp_affinity_list", "0-1");
    put("/proc/1/comm", "systemd");
    put(clock() + "current_clocksource", "tsc");
    put(clock() + "available_clocksource", "tsc hpet acpi_pm");
    put("/proc/sys/kernel/sched_rt_runtime_us", "950000");
    put("/proc/sys/kernel/sched_rt_period_us", "1000000");
    put("/proc/sys/net/ipv4/tcp_available_congestion_control", "reno cubic bbr");
    put("/proc/cpuinfo", "processor\t: 0\nflags\t\t: fpu vme avx2\n");
  }
  ~Machine() { fs::remove_all(root_); }
  void put(const std::string& path, const std::string& text) {
    fs::create_directories(fs::path(root_ + path).parent_path());
    std::ofstream(root_ + path) << text << "\n";
  }
  void remove(const std::string& path) { fs::remove_all(root_ + path); }
  void limits(const std::string& rtprio, const std::string& memlock) {
    put("/proc/self/limits",
        "Limit                     Soft Limit           Hard Limit           Units     \n"
        "Max locked memory         " +
            memlock + "              " + memlock +
            "             bytes\n"
            "Max realtime priority     " +
            rtprio + "                    99                   \n");
  }
  static std::string clock() { return "/sys/devices/system/clocksource/clocksource0/"; }
  teletact::DoctorCheck check(const std::string& id) const {
    for (const auto& c : teletact::run_doctor(root_)) {
      if (c.id == id) return c;
    }
    ADD_FAILURE() << "no check " << id;
    return {};
  }
  Level level(const std::string& id) const {
    const auto c = check(id);
    EXPECT_FALSE(c.state.empty()) << id;
    EXPECT_FALSE(c.why.empty()) << id;
    EXPECT_EQ(c.todo.empty(), c.level == Level::kFine) << id << ": " << c.todo;
    return c.level;
  }
  const std::string& root() const { return root_; }

 private:
  std::string root_;
};

TEST(CpuList, AsTheKernelWritesThem) {
  using testing::ElementsAre;
  EXPECT_THAT(teletact::parse_cpu_list("0-2,5\n"), ElementsAre(0, 1, 2, 5));
  EXPECT_THAT(teletact::parse_cpu_list("3"), ElementsAre(3));
  EXPECT_THAT(teletact::parse_cpu_list(""), ElementsAre());
  EXPECT_THAT(teletact::parse_cpu_list("(null)"), ElementsAre());
  EXPECT_THAT(teletact::parse_cpu_list("5-3,1,1, 2"), ElementsAre(1, 2));
  EXPECT_EQ(teletact::parse_cpu_list("0-2000000000").size(), 4096U);
  EXPECT_TRUE(teletact::parse_cpu_list("-1,99999999999999999999").empty());
}

TEST(Doctor, AFitMachineIsFine) {
  const Machine m;
  const auto checks = teletact::run_doctor(m.root());
  EXPECT_EQ(checks.size(), 19U);
  for (const auto& c : checks) EXPECT_EQ(m.level(c.id), Level::kFine) << c.id << ": " << c.state;
  EXPECT_EQ(teletact::doctor_verdict(checks), Level::kFine);
}

TEST(Doctor, Preemption) {
  Machine m;
  m.remove("/sys/kernel/realtime");
  EXPECT_EQ(m.level("preemption"), Level::kFine) << "the version says it too";
  m.put("/proc/version", "Linux version 6.1 #1 SMP PREEMPT_DYNAMIC Debian");
  EXPECT_EQ(m.level("preemption"), Level::kAdvice);
  EXPECT_THAT(m.check("preemption").state, HasSubstr("unknown"));
  m.put("/proc/cmdline", "quiet preempt=voluntary");
  EXPECT_THAT(m.check("preemption").state, HasSubstr("voluntary"));
  m.put("/sys/kernel/debug/sched/preempt", "none voluntary (full)");
  EXPECT_THAT(m.check("preemption").state, HasSubstr("full"));
  EXPECT_EQ(m.check("preemption").todo.find("preempt=full"), std::string::npos);
  m.put("/sys/kernel/debug/sched/preempt", "(none) voluntary full");
  EXPECT_THAT(m.check("preemption").todo, HasSubstr("preempt=full"));
  m.put("/proc/version", "Linux version 6.1 #1 SMP Debian");
  EXPECT_THAT(m.check("preemption").state, HasSubstr("no preemption"));
}

TEST(Doctor, Limits) {
  Machine m;
  m.limits("0", "8388608");
  EXPECT_EQ(m.level("rtprio"), Level::kUnfit);
  EXPECT_EQ(m.level("memlock"), Level::kUnfit);
  EXPECT_THAT(m.check("memlock").state, HasSubstr("8 MiB"));
  m.limits("20", "4294967296");
  EXPECT_EQ(m.level("rtprio"), Level::kAdvice);
  EXPECT_EQ(m.level("memlock"), Level::kFine);
  m.limits("94", "unlimited");
  EXPECT_EQ(m.level("rtprio"), Level::kAdvice) << "a sentinel wants 95";
  m.limits("95", "unlimited");
  EXPECT_EQ(m.level("rtprio"), Level::kFine);
  m.limits("unlimited", "unlimited");
  EXPECT_EQ(m.level("rtprio"), Level::kFine);
  m.limits("0", "0");
  m.put("/proc/self/status", "CapEff:\t0000000000804000\n");  // bits 23 and 14
  EXPECT_EQ(m.level("rtprio"), Level::kFine);
  EXPECT_EQ(m.level("memlock"), Level::kFine);
  m.put("/proc/self/status", "CapEff:\t0000000000800000\n");
  EXPECT_EQ(m.level("memlock"), Level::kUnfit);
  m.remove("/proc/self/limits");
  EXPECT_EQ(m.level("memlock"), Level::kAdvice);
}

TEST(Doctor, Cores) {
  Machine m;
  m.put(std::string(kCpu) + "isolated", "");
  EXPECT_EQ(m.level("cores"), Level::kAdvice);
  EXPECT_THAT(m.check("cores").todo, HasSubstr("domain,2-3 "));
  m.put(std::string(kCpu) + "online", "0-1");
  EXPECT_THAT(m.check("cores").todo, HasSubstr("domain,1 "));
  m.put(std::string(kCpu) + "online", "0");
  EXPECT_EQ(m.level("cores"), Level::kUnfit);
}

TEST(Doctor, Quota) {
  Machine m;
  EXPECT_EQ(m.level("quota"), Level::kFine);
  m.put("/proc/self/cgroup", "0::/");
  m.put("/sys/fs/cgroup/cpu.max", "max 100000");
  EXPECT_EQ(m.level("quota"), Level::kFine);
  m.put("/sys/fs/cgroup/cpu.max", "400000 100000");
  EXPECT_EQ(m.level("quota"), Level::kAdvice);
  EXPECT_THAT(m.check("quota").state, HasSubstr("4 cores"));
  m.put("/sys/fs/cgroup/cpu.max", "150000 100000");
  EXPECT_EQ(m.level("quota"), Level::kUnfit);
  m.put("/sys/fs/cgroup/cpu.max", "garbage");
  EXPECT_EQ(m.level("quota"), Level::kFine);
}

TEST(Doctor, Governor) {
  Machine m;
  m.put(std::string(kCpu) + "cpu2/cpufreq/scaling_governor", "powersave");
  EXPECT_EQ(m.level("governor"), Level::kAdvice);
  EXPECT_THAT(m.check("governor").state, HasSubstr("performance on 0-1,3"));
  EXPECT_THAT(m.check("governor").state, HasSubstr("powersave on 2"));
  for (int i = 0; i < 4; ++i) m.remove(std::string(kCpu) + "cpu" + std::to_string(i) + "/cpufreq");
  EXPECT_EQ(m.level("governor"), Level::kFine) << "a virtual machine shows none";
}

TEST(Doctor, IdleStates) {
  Machine m;
  EXPECT_EQ(m.level("cstates"), Level::kFine) << "deep, but the device file is writable";
  EXPECT_THAT(m.check("cstates").state, HasSubstr("133 us"));
  m.remove("/dev/cpu_dma_latency");
  EXPECT_EQ(m.level("cstates"), Level::kAdvice);
  for (int i = 0; i < 4; ++i) {
    m.put(std::string(kCpu) + "cpu" + std::to_string(i) + "/cpuidle/state1/disable", "1");
  }
  EXPECT_EQ(m.level("cstates"), Level::kFine);
}

TEST(Doctor, Interrupts) {
  Machine m;
  m.put("/proc/irq/25/effective_affinity_list", "3");
  m.put("/proc/irq/26/smp_affinity_list", "0-3");
  EXPECT_EQ(m.level("irq"), Level::kAdvice);
  EXPECT_THAT(m.check("irq").state, HasSubstr("4 interrupts, 2 on isolated cores (25,26)"));
  m.remove("/proc/irq/25");
  m.remove("/proc/irq/26");
  EXPECT_EQ(m.level("irq"), Level::kFine);
  m.put("/proc/77/comm", "irqbalance");
  EXPECT_EQ(m.level("irq"), Level::kAdvice);
  m.remove("/proc/77");
  m.put(std::string(kCpu) + "isolated", "");
  EXPECT_EQ(m.level("irq"), Level::kAdvice);
}

TEST(Doctor, ClockSource) {
  Machine m;
  m.put(Machine::clock() + "current_clocksource", "hpet");
  EXPECT_EQ(m.level("clock"), Level::kAdvice);
  EXPECT_THAT(m.check("clock").todo, HasSubstr("echo tsc"));
  m.put(Machine::clock() + "available_clocksource", "hpet acpi_pm");
  EXPECT_THAT(m.check("clock").todo, HasSubstr("unstable"));
  m.put(Machine::clock() + "current_clocksource", "refined-jiffies");
  EXPECT_EQ(m.level("clock"), Level::kUnfit);
  m.put(Machine::clock() + "current_clocksource", "kvm-clock");
  EXPECT_EQ(m.level("clock"), Level::kFine);
}

TEST(Doctor, Smt) {
  Machine m;
  m.put(std::string(kCpu) + "smt/active", "1");
  for (int i = 0; i < 4; ++i) {
    m.put(std::string(kCpu) + "cpu" + std::to_string(i) + "/topology/thread_siblings_list",
          i < 2 ? "0-1" : "2-3");
  }
  EXPECT_EQ(m.level("smt"), Level::kFine) << "whole cores are isolated";
  m.put(std::string(kCpu) + "cpu3/topology/thread_siblings_list", "1,3");
  EXPECT_EQ(m.level("smt"), Level::kAdvice);
  m.put(std::string(kCpu) + "isolated", "");
  EXPECT_EQ(m.level("smt"), Level::kAdvice);
}

TEST(Doctor, Throttling) {
  Machine m;
  m.put("/proc/sys/kernel/sched_rt_runtime_us", "-1");
  EXPECT_EQ(m.level("throttle"), Level::kFine);
  m.put("/proc/sys/kernel/sched_rt_runtime_us", "920000");
  EXPECT_EQ(m.level("throttle"), Level::kAdvice);
  m.put("/proc/sys/kernel/sched_rt_runtime_us", "500000");
  EXPECT_EQ(m.level("throttle"), Level::kUnfit);
  EXPECT_THAT(m.check("throttle").todo, HasSubstr("sched_rt_runtime_us=950000"));
}

TEST(Doctor, FairServer) {
  Machine m;
  EXPECT_THAT(m.check("fair_server").state, HasSubstr("none in this kernel"));
  m.put("/proc/sys/kernel/osrelease", "6.18.44");
  EXPECT_EQ(m.level("fair_server"), Level::kAdvice);
  for (int i = 0; i < 4; ++i) {
    m.put("/sys/kernel/debug/sched/fair_server/cpu" + std::to_string(i) + "/runtime", "50000000");
  }
  EXPECT_THAT(m.check("fair_server").state, HasSubstr("50 ms"));
  for (int i = 2; i < 4; ++i) {
    m.put("/sys/kernel/debug/sched/fair_server/cpu" + std::to_string(i) + "/runtime", "0");
  }
  EXPECT_EQ(m.level("fair_server"), Level::kFine) << "only the isolated cores matter";
}

TEST(Doctor, VirtualMachine) {
  Machine m;
  m.put("/proc/cpuinfo", "processor\t: 0\nflags\t\t: fpu hypervisor avx2\n");
  EXPECT_EQ(m.level("virtual"), Level::kAdvice);
  m.put("/proc/cpuinfo", "processor\t: 0\nflags\t\t: fpu avx2 hypervisor\n");
  EXPECT_EQ(m.level("virtual"), Level::kAdvice);
}

void put_card(Machine& m, const std::string& name) {
  m.put("/sys/class/net/" + name + "/type", "1");
  m.put("/sys/class/net/" + name + "/device/vendor", "0x8086");
}

TEST(Doctor, RawFrames) {
  Machine m;
  EXPECT_EQ(m.level("raw_frames"), Level::kFine) << "no card, no bus";
  put_card(m, "enp3s0");
  EXPECT_EQ(m.level("raw_frames"), Level::kAdvice);
  EXPECT_THAT(m.check("raw_frames").todo, HasSubstr("cap_net_raw"));
  m.put("/proc/self/status", "Name:\tteletact\nCapEff:\t0000000000002000\n");
  EXPECT_EQ(m.level("raw_frames"), Level::kFine);
}

TEST(Doctor, Congestion) {
  Machine m;
  const std::string file = "/proc/sys/net/ipv4/tcp_available_congestion_control";
  m.put(file, "bbr reno");
  EXPECT_EQ(m.level("congestion"), Level::kFine);
  m.put(file, "reno cubic bbr2");
  EXPECT_EQ(m.level("congestion"), Level::kAdvice);
  EXPECT_THAT(m.check("congestion").state, HasSubstr("reno cubic bbr2, no BBR"));
  EXPECT_THAT(m.check("congestion").todo, HasSubstr("modprobe tcp_bbr"));
  m.remove(file);
  EXPECT_EQ(m.level("congestion"), Level::kAdvice);
}

TEST(Doctor, Coalescing) {
  using teletact::doctor::Moderation;
  Machine m;
  EXPECT_EQ(m.level("coalescing"), Level::kFine);
  put_card(m, "enp3s0");
  m.put("/sys/class/net/lo/type", "772");
  m.put("/sys/class/net/wlan0/type", "1");
  m.put("/sys/class/net/wlan0/device/vendor", "0x8086");
  m.put("/sys/class/net/wlan0/wireless/x", "");
  m.put("/sys/class/net/br0/type", "1");
  const teletact::doctor::Tree tree(m.root());
  std::vector<std::string> asked;
  Moderation is{3, 0, false};
  const auto read = [&](const std::string& card) -> std::optional<Moderation> {
    asked.push_back(card);
    return is;
  };
  auto c = teletact::doctor::coalescing(tree, read);
  EXPECT_EQ(c.level, Level::kAdvice);
  EXPECT_EQ(c.state, "enp3s0 rx 3 us, tx 0 us");
  EXPECT_THAT(c.todo, HasSubstr("ethtool -C enp3s0 adaptive-rx off rx-usecs 0"));
  EXPECT_EQ(asked, std::vector<std::string>{"enp3s0"}) << "no bridge, no radio, no loopback";
  is = {0, 0, true};
  EXPECT_EQ(teletact::doctor::coalescing(tree, read).level, Level::kAdvice);
  is = {};
  c = teletact::doctor::coalescing(tree, read);
  EXPECT_EQ(c.level, Level::kFine);
  EXPECT_TRUE(c.todo.empty());
  EXPECT_EQ(teletact::doctor::moderation_of("no such card, and a long name"), std::nullopt);
  EXPECT_EQ(teletact::doctor::moderation_of("lo-nowhere"), std::nullopt);
}

TEST(Doctor, InterruptThreads) {
  Machine m;
  put_card(m, "enp3s0");
  EXPECT_EQ(m.level("irq_threads"), Level::kFine);
  const auto thread = [&](const std::string& pid, const std::string& name, int priority) {
    m.put("/proc/" + pid + "/comm", name);
    std::string fields = pid + " (" + name + ") S";
    for (int i = 4; i < 40; ++i) fields += " 0";
    m.put("/proc/" + pid + "/stat", fields + " " + std::to_string(priority) + " 1 0");
  };
  thread("60", "irq/9-acpi", 50);
  EXPECT_EQ(m.level("irq_threads"), Level::kFine) << "another's";
  thread("61", "irq/35-enp3s0-r", 50);
  thread("62", "irq/40-teletact", 50);
  EXPECT_EQ(m.level("irq_threads"), Level::kAdvice);
  EXPECT_EQ(m.check("irq_threads").state, "irq/35-enp3s0-r FIFO 50; irq/40-teletact FIFO 50");
  EXPECT_EQ(m.check("irq_threads").todo, "as root: chrt -f -p 93 61 && chrt -f -p 93 62");
  thread("61", "irq/35-enp3s0-r", 93);
  thread("62", "irq/40-teletact", 93);
  EXPECT_EQ(m.level("irq_threads"), Level::kFine);
  m.put("/proc/61/stat", "61 (irq/35-enp3s0) S 1 2");
  EXPECT_EQ(m.level("irq_threads"), Level::kAdvice) << "cut off: not known to be above";
}

// Files that are missing, empty, huge, folders or noise: a finding each, never a crash.
TEST(Doctor, SurvivesAnyTree) {
  const auto empty = teletact::run_doctor("/nonexistent");
  EXPECT_EQ(empty.size(), 19U);
  EXPECT_EQ(teletact::doctor_verdict(empty), Level::kUnfit);
  const std::uint64_t seed = 31;
  rt::Random r(seed);
  for (int i = 0; i < 60; ++i) {
    Machine m;
    std::vector<fs::path> files;
    for (const auto& e : fs::recursive_directory_iterator(m.root())) {
      if (e.is_regular_file()) files.push_back(e.path());
    }
    for (const auto& file : files) {
      const double u = r.uniform();
      if (u < 0.1) {
        fs::remove(file);
      } else if (u < 0.2) {
        fs::remove(file);
        fs::create_directories(file);
      } else if (u < 0.4) {
        std::string noise(static_cast<std::size_t>(r.integer(0, 200)), ' ');
        for (auto& c : noise) c = static_cast<char>(r() & 0xffU);
        std::ofstream(file) << noise;
      } else if (u < 0.45) {
        std::ofstream(file) << "99999999999999999999999999";
      }
    }
    for (const auto& c : teletact::run_doctor(m.root())) {
      EXPECT_FALSE(c.state.empty()) << "seed " << seed << " " << c.id;
      EXPECT_EQ(c.state.find('\n'), std::string::npos);
    }
  }
}

int doctor(std::vector<std::string> args) {
  args.insert(args.begin(), "doctor");
  std::vector<char*> argv;
  for (auto& a : args) argv.push_back(a.data());
  argv.push_back(nullptr);
  return teletact::cmd_doctor(static_cast<int>(args.size()), argv.data());
}

TEST(Command, ExitCodeBySeverityAndJson) {
  Machine m;
  const std::string json = m.root() + "/doctor.json";
  EXPECT_EQ(doctor({"--root", m.root()}), 0);
  m.put(std::string(kCpu) + "smt/active", "1");
  m.remove(std::string(kCpu) + "isolated");
  EXPECT_EQ(doctor({"--root", m.root(), "--json", json}), 1);
  std::ifstream in(json);
  const auto j = nlohmann::json::parse(in);
  EXPECT_EQ(j.at("command"), "doctor");
  EXPECT_EQ(j.at("checks").size(), 19U);
  EXPECT_EQ(j.at("metrics").at(0).at("name"), "doctor.verdict");
  EXPECT_EQ(j.at("metrics").at(0).at("value"), 1);
  m.limits("0", "0");
  EXPECT_EQ(doctor({"--root", m.root()}), 2);
  EXPECT_EQ(doctor({"--root", m.root(), "--rights"}), 1);
  m.limits("98", "unlimited");
  EXPECT_EQ(doctor({"--root", m.root(), "--rights"}), 0) << "whatever else there is to say";
  EXPECT_THROW(doctor({"--root", "/nonexistent"}), std::runtime_error);
  EXPECT_THROW(doctor({"--wrong"}), std::runtime_error);
  EXPECT_THROW(doctor({"--root", m.root(), "--json", "/nonexistent/x.json"}), std::runtime_error);
  EXPECT_EQ(doctor({"--help"}), 0);
  const int here = doctor({});
  EXPECT_TRUE(here >= 0 && here <= 2);
}

}  // namespace
