// The cable of the motor bus is pulled while the wheels turn, and plugged in again: robot_io, the
// EtherCAT master and a packet socket on a veth pair, whose other end is taken down by its flag.
//
//   vm_cable --iface veth0 --far veth1 [--pulls N]
#include <net/if.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <vector>

#include "drivers/ethercat/master.hpp"
#include "drivers/ethercat/raw_port.hpp"
#include "rt/quantile.hpp"
#include "tests/vm/guest/robot_job.hpp"
#include "tests/vm/guest/say.hpp"
#include "tests/vm/guest/wire_tap.hpp"

namespace {

using namespace drivers;
using tasks::Mode;
namespace fault = tasks::robot_io_fault;

constexpr std::int64_t kPeriod_ns = 1'000'000;
// docs/faults.md, F-RIO-13: jobs until it is named; the first of them may call it a lost frame.
constexpr std::int64_t kNamed_jobs = 2;
// Below the watchdog of the slaves they stay in OP: only the latch holds the robot then.
constexpr useconds_t kShort_us = 30'000, kLong_us = 300'000;

std::string text(auto n) { return std::to_string(n); }

// A robot without switches.
class NoLines final : public SafetyIo {
 public:
  void sense(rt::Time, SafetyInputs& out) noexcept override { out = {}; }
  void act(rt::Time, const SafetyOutputs&) noexcept override {}
};

class Cable {
 public:
  explicit Cable(const std::string& end) : socket_(::socket(AF_INET, SOCK_DGRAM, 0)) {
    std::copy_n(end.begin(), std::min(end.size(), sizeof ifr_.ifr_name - 1), ifr_.ifr_name);
  }
  ~Cable() { ::close(socket_); }
  Cable(const Cable&) = delete;
  Cable& operator=(const Cable&) = delete;
  void pull() {
    ++pulls_;
    put(0);
  }
  [[nodiscard]] int pulls() const { return pulls_; }
  void plug() { put(IFF_UP); }

 private:
  void put(unsigned up) {
    ifreq now = ifr_;
    bool done = ::ioctl(socket_, SIOCGIFFLAGS, &now) == 0;
    const auto flags = static_cast<unsigned>(now.ifr_flags) & ~static_cast<unsigned>(IFF_UP);
    now.ifr_flags = static_cast<short>(flags | up);
    done = done && ::ioctl(socket_, SIOCSIFFLAGS, &now) == 0;
    if (!done) vm::check(std::string("flags of ") + ifr_.ifr_name, false, "");
  }
  int socket_;
  int pulls_ = 0;
  ifreq ifr_{};
};

class CableStory {
 public:
  CableStory(vm::RobotJob& job, vm::WireTap& tap, std::int64_t epoch_ns)
      : job_(job), tap_(tap), epoch_ns_(epoch_ns) {}

  void pulls(const std::string& what, Cable& cable, int n) {
    std::vector<double> us;
    std::int64_t jobs = 0;
    std::size_t drove = 0;
    int unnamed = 0, unlatched = 0, stood = 0;
    for (int i = 0; i < n; ++i) {
      const Pull p = pull(cable, kPeriod_ns * i / n, kShort_us);
      if (!p.drove) ++stood;
      if (!p.named) ++unnamed;
      if (!p.latched) ++unlatched;
      drove += p.driving_after;
      jobs = std::max(jobs, p.jobs);
      us.push_back(1e-3 * static_cast<double>(p.named_ns));
      if (!drive_on()) vm::check(what + ": drives after clear and engage", false, text(i));
    }
    const std::string of = " of " + text(n);
    vm::figure(what + ".named_p50_us", rt::quantile(us, 0.5), "us");
    vm::figure(what + ".named_max_us", rt::quantile(us, 1), "us");
    vm::figure(what + ".named_jobs_max", static_cast<double>(jobs), "1");
    vm::check(what + ": the wheels were driven before", stood == 0, text(stood) + " stood" + of);
    vm::check(what + ": each is named F-RIO-13", unnamed == 0, text(unnamed) + " were not" + of);
    vm::check(what + ": named within the jobs of docs/faults.md", jobs <= kNamed_jobs,
              text(jobs) + " jobs at most");
    vm::check(what + ": stays stopped when the cable is back", unlatched == 0,
              text(unlatched) + " did not" + of);
    vm::check(what + ": no frame drives until the clear", drove == 0, text(drove) + " frames");
  }

  // So long that the slaves' watchdog stops the wheels, which nobody can tell them.
  void long_pull(Cable& cable) {
    ::usleep(200'000);  // to be fast
    const double speed = job_.wheel_rad_per_s(), from = job_.wheel_rad();
    const Pull p = pull(cable, 0, kLong_us);
    const double rolled_ms = 1e3 * (job_.wheel_rad() - from) / speed;
    vm::check("long: named and latched", p.named && p.latched && p.driving_after == 0,
              "fault " + text(job_.fault()));
    vm::figure("cable.wheels_rolled_ms", rolled_ms, "ms");
    // The watchdog, a cycle, and the brake.
    vm::check("long: the wheels stop by the slaves' watchdog", rolled_ms > 50 && rolled_ms < 120,
              text(rolled_ms) + " ms at the speed of before");
    vm::check("long: slaves fell to SAFEOP, and that is told", job_.fault() == fault::kSlaveState,
              "fault " + text(job_.fault()));
    const double stands = job_.wheel_rad();
    ::usleep(500'000);
    vm::check("long: half a second later it stands and is stopped",
              job_.wheel_rad() == stands && job_.mode == Mode::kSafeStop, "");
    vm::check("long: drives after clear and engage", drive_on(), "");
  }

  // The cause is not gone: the operator's act changes nothing, neither then nor later.
  void early_clear(Cable& cable) {
    cable.pull();
    ::usleep(20'000);
    job_.clear = true;
    ::usleep(20'000);
    job_.clear = false;
    ::usleep(20'000);
    const bool held = job_.mode == Mode::kSafeStop;
    cable.plug();
    ::usleep(50'000);
    vm::check("a clear while the cable is out is no act",
              held && job_.mode == Mode::kSafeStop && tap_.off_now(), "");
    vm::check("drives after one when it is back", drive_on(), "");
  }

  // The operator's clear when the cause is gone, then engage.
  bool drive_on() {
    if (job_.mode != Mode::kSafeStop) job_.mode = Mode::kHold;
    job_.clear = true;
    const bool cleared = until([&] { return job_.mode == Mode::kHold; }, 400);
    job_.clear = false;
    ::usleep(3000);
    const bool ready = until([&] { return !job_.rearming(); }, 400);
    job_.mode = Mode::kEngaged;
    const bool drives = until([&] { return driven(); }, 120);
    ::usleep(4000);
    return cleared && ready && drives;
  }

 private:
  struct Pull {
    bool drove = false, named = false, latched = false;
    std::int64_t named_ns = 0;  // from the hand's act to the beginning of the job that named it
    std::int64_t jobs = 0;      // from the first with a bad read to that one, both counted
    std::size_t driving_after = 0;
  };

  Pull pull(Cable& cable, std::int64_t phase_ns, useconds_t out_us) {
    Pull p;
    const std::int64_t now = rt::monotonic_ns();
    const std::int64_t wait = 2 * kPeriod_ns - (now - epoch_ns_) % kPeriod_ns + phase_ns;
    ::usleep(static_cast<useconds_t>(wait / 1000));
    p.drove = driven();
    const std::int64_t before = rt::monotonic_ns();
    cable.pull();
    ::usleep(out_us);
    const std::int64_t named = job_.began_ns(fault::kBusLinkDown);
    const std::int64_t lost = job_.began_ns(fault::kFrameLost);
    p.named = named > before && job_.fault() == fault::kBusLinkDown;
    p.named_ns = named - before;
    p.jobs = 1 + (lost > before ? (named - lost + kPeriod_ns / 2) / kPeriod_ns : 0);
    const std::size_t from = tap_.first_from(named + kPeriod_ns);
    const bool stopped = job_.mode == Mode::kSafeStop;
    cable.plug();
    ::usleep(50'000);
    p.latched = stopped && job_.mode == Mode::kSafeStop && tap_.off_now();
    for (std::size_t i = from; i < tap_.count(); ++i)
      p.driving_after += tap_.frame(i).off ? 0U : 1U;
    return p;
  }

  [[nodiscard]] bool driven() const {
    const std::size_t n = tap_.count();
    return n > 0 && !tap_.frame(n - 1).still;
  }
  template <class Is>
  static bool until(Is is, int ms) {
    for (; ms > 0 && !is(); --ms) ::usleep(1000);
    return is();
  }

  vm::RobotJob& job_;
  vm::WireTap& tap_;
  std::int64_t epoch_ns_;
};

void say_counts(ethercat::Master& master) {
  const auto& cycles = master.counters();
  const auto &frames = master.frames(), &set_up = master.registers().counters();
  const auto figure = [](const char* name, std::uint64_t n) {
    vm::figure(name, static_cast<double>(n), "1");
  };
  figure("ethercat.sent", frames.sent + set_up.sent);
  figure("ethercat.lost_in_all", frames.lost + set_up.lost);
  figure("ethercat.refused", frames.refused + set_up.refused);
  figure("ethercat.cycles_lost", cycles.lost);
  figure("ethercat.cycles_link_down", cycles.link_down);
  figure("ethercat.short", cycles.short_counter);
}

}  // namespace

int main(int argc, char** argv) {
  const std::string near = vm::option(argc, argv, "iface", std::string("veth0"));
  const int pulls = static_cast<int>(vm::option(argc, argv, "pulls", 10.0));
  rt::Startup startup;
  auto& nrt = startup.token();
  auto port = ethercat::RawPort::open(nrt, near);
  if (!port) return vm::check("port", false, port.error()) ? 0 : 1;
  ethercat::Master master(nrt, *port.value());
  if (!vm::bring_up(nrt, master)) return 1;
  NoLines lines;
  youbot_bus::EtherCatMotorBus bus(nrt, master);
  vm::RobotJob job(nrt, lines, bus);
  vm::WireTap tap(near, master.mapping());
  Cable far_end(vm::option(argc, argv, "far", std::string("veth1"))), near_end(near);

  const auto person = [&](std::int64_t epoch_ns) {
    ::usleep(400'000);
    CableStory story(job, tap, epoch_ns);
    vm::check("drives", story.drive_on(), "");
    story.pulls("cable", far_end, pulls);
    story.long_pull(far_end);
    story.early_clear(far_end);
    story.pulls("card", near_end, 3);
  };
  const std::uint64_t missed = vm::run_robot(nrt, job, person, [] { return true; });
  say_counts(master);
  vm::figure("cable.pulls", far_end.pulls() + near_end.pulls(), "1");
  vm::figure("cable.jobs", static_cast<double>(job.jobs()), "1");
  vm::check("no job missed", missed == 0, text(missed));
  return 0;
}
