// The product's CAN driver on the guest's vcan, against four modules with sockets of their own:
// what it does when the bus fails. docs/can.md, "What goes wrong", is what it is held against.
//
//   vm_can_bus --iface vcan0
//
// vcan has no wire, so it has no errors of its own: what a controller's driver would say is put
// into it as error frames, and while a controller "is off" the modules hear nothing. A queue that
// nobody empties is netem's, an interface that is down or gone is truly so.
// Figures: can.{jobs, job_cpu_p50_us, job_cpu_p99_us, job_cpu_max_us, age_max_us, down_to_stop_us,
// flood_lost, flood_cpu_max_us, dropped}.
#include <linux/can/error.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>

#include "rt/clock/box_time.hpp"
#include "rt/quantile.hpp"
#include "tests/vm/guest/can_driver.hpp"
#include "tests/vm/guest/say.hpp"

namespace {

using drivers::can::BusState;
using drivers::can::PortState;
using vm::CanDriver;
using vm::CanModules;
using vm::check;
using Job = CanDriver::Job;

std::string text(auto n) { return std::to_string(n); }
constexpr auto kDownJob = [](const Job& j) { return j.down(); };
constexpr auto kGoodJob = [](const Job& j) { return j.good(); };
constexpr auto kLostJob = [](const Job& j) { return j.lost(); };
constexpr auto kWrongJob = [](const Job& j) { return j.wrong; };

bool run(std::vector<std::string> words) {
  std::vector<char*> argv;
  for (auto& w : words) argv.push_back(w.data());
  argv.push_back(nullptr);
  pid_t child = 0;
  int status = 1;
  if (::posix_spawnp(&child, argv[0], nullptr, nullptr, argv.data(), environ) != 0) return false;
  return ::waitpid(child, &status, 0) == child && status == 0;
}

class Story {
 public:
  Story(rt::NonRealtime& nrt, std::string iface)
      : iface_(std::move(iface)),
        raw_(vm::open_raw(iface_)),
        modules_(iface_),
        driver_(nrt, iface_, modules_) {}
  ~Story() { ::close(raw_); }
  Story(const Story&) = delete;
  Story& operator=(const Story&) = delete;

  void healthy();
  void small_errors();
  void lost_replies();
  void late_replies();
  void bus_off();
  void bus_off_between_two_jobs();
  void silent_module();
  void queue_full();
  void flood();
  void hanging_owner();
  void interface_down();
  void interface_gone();
  void books();

 private:
  // It stays down while nobody acts, and nothing turns; then it drives again.
  void recovers_by_the_act(const std::string& name, std::size_t since, bool bus_is_back = true);
  // From the job that sees it the bus is down, by this name, and no job before.
  void down_at_once(const std::string& name, std::int64_t after_ns, PortState);
  void put(std::uint32_t classes, std::uint8_t controller = 0) {
    vm::put_error(raw_, classes, controller);
  }

  std::string iface_;
  int raw_;
  CanModules modules_;
  CanDriver driver_;
};

void Story::healthy() {
  driver_.wait(60);
  const std::size_t from = driver_.count();
  driver_.wait(200);
  check("drives", driver_.how_many(from, kGoodJob) >= 200 && modules_.any_turns(),
        text(driver_.how_many(from, kGoodJob)) + " good jobs");
  std::int64_t age = 0;
  std::vector<double> cpu;
  for (std::size_t i = from; i < driver_.count(); ++i) {
    age = std::max(age, driver_.job(i).age_ns);
    cpu.push_back(1e-3 * static_cast<double>(driver_.job(i).cpu_ns));
  }
  // A position is asked for every fourth turn of three a job: nine jobs, and what a job begins
  // late.
  check("positions are as young as is said", age <= 9'200'000, text(age / 1000) + " us");
  std::sort(cpu.begin(), cpu.end());
  vm::figure("can.age_max_us", 1e-3 * static_cast<double>(age), "us");
  vm::figure("can.job_cpu_p50_us", cpu[rt::quantile_rank(.5, cpu.size()) - 1], "us");
  vm::figure("can.job_cpu_p99_us", cpu[rt::quantile_rank(.99, cpu.size()) - 1], "us");
  vm::figure("can.job_cpu_max_us", cpu.back(), "us");
}

void Story::small_errors() {
  const std::size_t from = driver_.count();
  const auto before = driver_.port();
  const auto state_after = [&](std::uint32_t classes, std::uint8_t controller) {
    put(classes, controller);
    driver_.wait(3);
    return driver_.job(driver_.count() - 1).bus;
  };
  check("a warning is named",
        state_after(CAN_ERR_CRTL, CAN_ERR_CRTL_TX_WARNING) == BusState::kWarning, "");
  check("error passive is named",
        state_after(CAN_ERR_CRTL, CAN_ERR_CRTL_RX_PASSIVE) == BusState::kPassive, "");
  check("error active again is named",
        state_after(CAN_ERR_CRTL, CAN_ERR_CRTL_ACTIVE) == BusState::kActive, "");
  put(CAN_ERR_PROT);
  put(CAN_ERR_ACK);
  put(CAN_ERR_CRTL, CAN_ERR_CRTL_RX_OVERFLOW);
  put(CAN_ERR_BUSERROR);  // a class that may come by thousands, and that is not asked for
  driver_.wait(5);
  const auto& now = driver_.port();
  check("each is counted, once",
        now.protocol_errors - before.protocol_errors == 1 && now.no_acks - before.no_acks == 1 &&
            now.overflows - before.overflows == 1,
        "");
  check("no more error frames than were asked for", now.error_frames - before.error_frames == 6,
        text(now.error_frames - before.error_frames) + " of 7");
  check("none of them stops the wheels",
        driver_.how_many(from, kDownJob) + driver_.how_many(from, kLostJob) == 0 &&
            modules_.any_turns(),
        "");
}

void Story::lost_replies() {
  std::size_t from = driver_.count();
  const auto late = driver_.bus().late;
  constexpr int kLost = 12;
  for (int i = 0; i < kLost; ++i) {
    modules_.faults.lose = 1;
    driver_.wait(31);
  }
  check("each lost reply is a lost frame",
        driver_.bus().late - late == kLost && driver_.how_many(from, kLostJob) == kLost,
        text(driver_.bus().late - late) + " late, " + text(driver_.how_many(from, kLostJob)) +
            " jobs, of " + text(kLost));
  check("lost replies stop nothing", driver_.how_many(from, kDownJob) == 0, "");
}

void Story::late_replies() {
  const std::size_t from = driver_.count();
  const auto before = driver_.bus();
  modules_.faults.delay_ms = 8;
  driver_.wait(60);
  modules_.faults.delay_ms = 0;
  driver_.wait(60);
  check("replies after their time answer nothing",
        driver_.bus().late > before.late && driver_.bus().strange > before.strange,
        text(driver_.bus().late - before.late) + " late, " +
            text(driver_.bus().strange - before.strange) + " that answer nothing");
  check("late replies stop nothing", driver_.how_many(from, kDownJob) == 0, "");
  driver_.wait(30);
}

void Story::down_at_once(const std::string& name, std::int64_t after_ns, PortState as) {
  const std::size_t job = driver_.first_after(after_ns);
  const std::size_t down = driver_.first(job > 3 ? job - 3 : 0, kDownJob);
  check(name + " is down in the same job", down <= job && down < driver_.count(),
        "job " + text(down) + ", the next one was " + text(job));
  const PortState is = down < driver_.count() ? driver_.job(down).port : PortState::kUp;
  check(name + " is named", is == as, to_text(is));
}

void Story::recovers_by_the_act(const std::string& name, std::size_t since, bool bus_is_back) {
  const std::uint64_t speeds = modules_.speeds();
  driver_.wait(30);
  const auto jobs = driver_.count() - since;
  check(name + " stays down", driver_.how_many(since, kDownJob) == static_cast<int>(jobs),
        text(driver_.how_many(since, kDownJob)) + " of " + text(jobs) + " jobs");
  check(name + " and nothing turns", !bus_is_back || !modules_.any_turns(), "");
  check(name + " sends no speed", modules_.speeds() == speeds, "");
  driver_.rearm();
  driver_.wait(60);
  const std::size_t end = driver_.count() - 30;
  check(name + " drives after the act",
        driver_.how_many(end, kGoodJob) >= 30 && modules_.any_turns(), "");
}

void Story::bus_off() {
  const auto before = driver_.port();
  modules_.faults.no_bus = true;
  put(CAN_ERR_BUSOFF);
  const std::int64_t at = rt::monotonic_ns();
  driver_.wait(30);
  down_at_once("bus-off", at, PortState::kBusOff);
  check("modules that hear nothing turn on", modules_.any_turns(), "as docs/can.md warns");
  const std::size_t since = driver_.first_after(at);
  const std::uint64_t speeds = modules_.speeds();
  modules_.faults.no_bus = false;
  put(CAN_ERR_RESTARTED);
  driver_.wait(20);
  check("a restart is counted and brings no motion",
        driver_.port().restarts - before.restarts == 1 &&
            driver_.port().bus_offs - before.bus_offs == 1 && modules_.speeds() == speeds,
        "");
  recovers_by_the_act("bus-off", since);
}

// As a controller with a restart-ms that is short.
void Story::bus_off_between_two_jobs() {
  driver_.hang(true);
  ::usleep(3000);
  put(CAN_ERR_BUSOFF);
  put(CAN_ERR_RESTARTED);
  const std::int64_t at = rt::monotonic_ns();
  driver_.hang(false);
  driver_.wait(10);
  const std::size_t since = driver_.first_after(at);
  check("bus-off and back between two jobs is down", driver_.how_many(since, kDownJob) > 0,
        "bus-offs " + text(driver_.port().bus_offs));
  recovers_by_the_act("bus-off and back", since);
}

void Story::silent_module() {
  const std::size_t from = driver_.count();
  modules_.faults.silent = 2;
  const std::int64_t at = rt::monotonic_ns();
  driver_.wait(130);
  const std::size_t first = driver_.first_after(at);
  const std::size_t down = driver_.first(first, kDownJob);
  check("a module without power is down after 100 jobs",
        down - first >= 90 && down - first <= 101 && down < driver_.count(),
        "job " + text(down - first));
  check("until then frames are lost", driver_.how_many(from, kLostJob) > 0, "");
  std::int64_t latest = 0;
  for (int i = 0; i < vm::kModules && down < driver_.count(); ++i) {
    if (i != 2)
      latest = std::max(latest, modules_.motor(i).stopped_ns - driver_.job(down).start_ns);
  }
  vm::figure("can.down_to_stop_us", 1e-3 * static_cast<double>(latest), "us");
  check("the others have motor stop in that job", latest > 0 && latest < 1'000'000,
        text(latest / 1000) + " us");
  modules_.faults.silent = -1;
  driver_.wait(20);
  recovers_by_the_act("a module that was silent", down);
}

// Nobody acknowledges: what the interface took stays in its queue.
void Story::queue_full() {
  const auto before = driver_.port();
  const std::size_t from = driver_.count();
  const std::int64_t at = rt::monotonic_ns();
  if (!run({"tc", "qdisc", "add", "dev", iface_, "root", "netem", "limit", "10", "delay", "100s"}))
    check("netem on vcan", false, "");
  driver_.wait(60);
  const auto& now = driver_.port();
  check("a full queue refuses frames", now.refused > before.refused,
        text(now.refused - before.refused));
  const std::size_t full =
      driver_.first(from, [](const Job& j) { return j.out == drivers::BusStatus::kFrameLost; });
  const std::size_t down = driver_.first(full, kDownJob);
  check("a full queue is down after 20 jobs", down - full == 19 && down < driver_.count(),
        "job " + text(down - full));
  check("a full queue is named",
        full < driver_.count() && driver_.job(full).port == PortState::kQueueFull,
        full < driver_.count() ? to_text(driver_.job(full).port) : "never");
  check("before the fault none was refused", before.refused == 0 && full >= driver_.first_after(at),
        "");
  if (!run({"tc", "qdisc", "del", "dev", iface_, "root"})) check("netem off", false, "");
  driver_.wait(20);
  recovers_by_the_act("a full queue", down);
}

void Story::flood() {
  const std::size_t from = driver_.count();
  const auto before = driver_.bus();
  const auto port = driver_.port();
  // A bus that is as full as one of 1 Mbit/s can be: eight frames a millisecond.
  can_frame reply{};
  reply.can_id = vm::kReplyId;
  reply.can_dlc = 7;
  reply.data[0] = 99;  // of a module that is none of ours
  can_frame other = reply;
  other.can_id = 0x300;
  for (int ms = 0; ms < 50; ++ms) {
    for (int i = 0; i < 8; ++i)
      if (::write(raw_, i < 4 ? &reply : &other, sizeof reply) < 0) std::perror("flood");
    ::usleep(1000);
  }
  driver_.wait(10);
  check("a full bus: foreign replies are counted, other frames not even read",
        driver_.bus().strange - before.strange == 200,
        text(driver_.bus().strange - before.strange));
  check("a full bus stops nothing",
        driver_.how_many(from, kGoodJob) == static_cast<int>(driver_.count() - from),
        text(driver_.how_many(from, kLostJob)) + " lost");
  // More than its buffer holds, between two jobs: what is lost is counted, no job takes long.
  const std::size_t burst = driver_.count();
  driver_.hang(true);
  ::usleep(3000);
  for (int i = 0; i < 2000; ++i)
    if (::write(raw_, &reply, sizeof reply) < 0) std::perror("flood");
  driver_.hang(false);
  driver_.wait(100);
  std::int64_t cpu = 0;
  for (std::size_t i = burst; i < driver_.count(); ++i) cpu = std::max(cpu, driver_.job(i).cpu_ns);
  vm::figure("can.dropped", static_cast<double>(driver_.port().dropped - port.dropped), "1");
  vm::figure("can.flood_lost", driver_.how_many(burst, kLostJob), "1");
  vm::figure("can.flood_cpu_max_us", 1e-3 * static_cast<double>(cpu), "us");
  check("more than the buffer holds: dropped ones are counted",
        driver_.port().dropped > port.dropped, text(driver_.port().dropped - port.dropped));
  // Some 440 frames that the socket's buffer holds, 64 a job, with the guard of the test build in
  // each call: .3 to .45 ms. The fourth of these jobs has more, however fast the burst came: .2 ms
  // where the guest has just started, 1.2 ms behind the lane's other cases.
  const int slow = driver_.how_many(burst, [](const Job& j) { return j.cpu_ns > 600'000; });
  check("no more than one job takes 0.6 ms over it", slow <= 1, text(slow));
  check("no job takes 2 ms over it", cpu < 2'000'000, text(cpu / 1000) + " us");
  check("it passes by itself",
        driver_.how_many(burst, kDownJob) == 0 &&
            driver_.how_many(driver_.count() - 20, kGoodJob) >= 20,
        text(driver_.how_many(burst, kLostJob)) + " lost");
}

void Story::hanging_owner() {
  driver_.hang(true);
  ::usleep(3000);
  check("modules turn while the owner hangs", modules_.any_turns(), "");
  driver_.make_safe();
  ::usleep(2000);
  check("make_safe stops them from another thread", !modules_.any_turns(), "");
  driver_.hang(false);
  const std::uint64_t speeds = modules_.speeds();
  driver_.wait(50);
  check("and so it stays", modules_.speeds() == speeds && !modules_.any_turns(), "");
  driver_.rearm();
  driver_.wait(100);
  check("until the act", modules_.any_turns(), "");
}

void Story::interface_down() {
  if (!run({"ip", "link", "set", iface_, "down"})) check("ip link set down", false, "");
  const std::int64_t at = rt::monotonic_ns();
  driver_.wait(20);
  down_at_once("an interface that is down", at, PortState::kDown);
  const std::size_t since = driver_.first_after(at);
  if (!run({"ip", "link", "set", iface_, "up"})) check("ip link set up", false, "");
  driver_.wait(20);
  recovers_by_the_act("an interface that was down", since);
}

void Story::books() {
  const auto& p = driver_.port();
  check("no state that no motor had", driver_.how_many(0, kWrongJob) == 0,
        text(driver_.how_many(0, kWrongJob)) + " of " + text(driver_.count()) + " jobs");
  check("nothing but classic frames", p.not_classic == 0, text(p.not_classic));
  check("no module refused anything", driver_.bus().refused == 0, text(driver_.bus().refused));
  vm::figure("can.jobs", static_cast<double>(driver_.count()), "1");
}

void Story::interface_gone() {
  if (!run({"ip", "link", "del", iface_})) check("ip link del", false, "");
  const std::int64_t at = rt::monotonic_ns();
  driver_.wait(20);
  down_at_once("an interface that is gone", at, PortState::kGone);
}

}  // namespace

int main(int argc, char** argv) {
  rt::Startup startup;
  const std::string iface = vm::option(argc, argv, "iface", std::string("vcan0"));
  try {
    Story s(startup.token(), iface);
    s.healthy();
    s.small_errors();
    s.lost_replies();
    s.late_replies();
    s.bus_off();
    s.bus_off_between_two_jobs();
    s.silent_module();
    s.queue_full();
    s.flood();
    s.hanging_owner();
    s.interface_down();
    s.books();
    s.interface_gone();
  } catch (const std::exception& e) {
    check("driver on " + iface, false, e.what());
    return 1;
  }
  return 0;
}
