#include "tests/vm/guest/gpio_story.hpp"

#include <fcntl.h>
#include <time.h>

#include <algorithm>
#include <csignal>

#include "rt/quantile.hpp"

namespace vm {

using tasks::Mode;

namespace {

namespace fault = tasks::robot_io_fault;
std::string text(auto n) { return std::to_string(n); }

void sleep_until(std::int64_t ns) {
  timespec at{};
  at.tv_sec = ns / 1'000'000'000;
  at.tv_nsec = ns % 1'000'000'000;
  while (::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &at, nullptr) != 0) {
  }
}

}  // namespace

std::size_t GpioStory::driving_from(std::size_t frame) const {
  std::size_t n = 0;
  for (; frame < tap_.count(); ++frame) n += tap_.frame(frame).off ? 0U : 1U;
  return n;
}

// The way from a stop: its cause gone, the switch let go and held, the operator's clear, engage.
bool GpioStory::drive_on(bool with_switch) {
  close_estop();
  if (job_.mode == Mode::kEngaged) job_.mode = Mode::kHold;
  ::usleep(2000);
  if (with_switch) {
    lines_.open(kEnable);
    ::usleep(3000);
    lines_.close(kEnable);
  }
  ::usleep(static_cast<useconds_t>(1000 * (kDebounce_ms + 3)));
  job_.clear = true;
  const bool cleared = until([&] { return job_.mode == Mode::kHold; }, 400);
  job_.clear = false;
  ::usleep(3000);
  const bool ready = until([&] { return !job_.rearming(); }, 400);
  job_.mode = Mode::kEngaged;
  const bool drives = until(
      [&] {
        const std::size_t n = tap_.count();
        return n > 0 && !tap_.frame(n - 1).still;
      },
      120);
  ::usleep(4000);
  return cleared && ready && drives;
}

GpioStory::Press GpioStory::press(std::int64_t phase_ns, bool shortly) {
  Press p{};
  const std::int64_t now = rt::monotonic_ns();
  const std::int64_t release = now - (now - epoch_ns_) % kPeriod_ns + 2 * kPeriod_ns;
  sleep_until(release + phase_ns);
  const bool on = job_.mode == Mode::kEngaged && !tap_.off_now();
  p.before_ns = rt::monotonic_ns();
  lines_.open(kEstop);
  p.after_ns = rt::monotonic_ns();
  if (shortly) lines_.close(kEstop);
  ::usleep(2000);
  p.edge_ns = job_.opened_ns();
  if (!shortly) lines_.open(kEstop2);  // two contacts are never quite as fast as each other
  ::usleep(8000);
  const std::size_t at = tap_.first_from(p.before_ns);
  p.drove = on && at > 0 && !tap_.frame(at - 1).off;
  std::size_t first = at;
  while (first < tap_.count() && !tap_.frame(first).off) ++first;
  p.wire_ns = first < tap_.count() ? tap_.frame(first).at_ns : 0;
  p.driving_after = driving_from(first);
  return p;
}

void GpioStory::judge(const std::string& what, const std::vector<Press>& all) const {
  std::vector<double> us;
  int odd_stamps = 0, stood = 0, no_stop = 0;
  std::size_t driving = 0;
  for (const Press& p : all) {
    odd_stamps += p.edge_ns < p.before_ns - 50'000 || p.edge_ns > p.after_ns + 50'000 ? 1 : 0;
    stood += p.drove ? 0 : 1;
    no_stop += p.wire_ns == 0 ? 1 : 0;
    driving += p.driving_after;
    if (p.wire_ns != 0) us.push_back(1e-3 * static_cast<double>(p.wire_ns - p.edge_ns));
  }
  std::sort(us.begin(), us.end());
  const std::string of = " of " + text(all.size());
  check(what + ": the wheels were driven before", stood == 0, text(stood) + " stood" + of);
  check(what + ": edges have the kernel's time", odd_stamps == 0, text(odd_stamps) + " odd" + of);
  check(what + ": each is a motor stop on the wire", no_stop == 0,
        text(no_stop) + " were not" + of);
  check(what + ": no frame drives after it", driving == 0, text(driving) + " frames");
  if (us.empty()) return;
  const std::string name = what == "press" ? "estop.to_wire" : "estop.short_to_wire";
  figure(name + "_p50_us", us[rt::quantile_rank(.5, us.size()) - 1], "us");
  figure(name + "_p99_us", us[rt::quantile_rank(.99, us.size()) - 1], "us");
  figure(name + "_max_us", us.back(), "us");
  check(what + ": within a period and 0.3 ms", us.back() <= 1e-3 * kLimit_ns,
        text(us.back()) + " us");
}

void GpioStory::presses(int n) {
  std::vector<Press> all;
  int not_driven = 0;
  const auto before = job_.faults(fault::kEstopOpen);
  for (int i = 0; i < n; ++i) {
    // All moments of a period, one after the other.
    all.push_back(press(kPeriod_ns * i / n, false));
    if (job_.fault() != fault::kEstopOpen || job_.mode != Mode::kSafeStop) ++not_driven;
    if (!drive_on()) ++not_driven;
  }
  judge("press", all);
  std::int64_t longest = 0;
  for (const Press& p : all) longest = std::max(longest, p.wire_ns - p.edge_ns);
  check("presses reach the worst moment of a period", longest > 900'000,
        text(longest / 1000) + " us");
  check("each is named, and drives again after clear and engage",
        not_driven == 0 && job_.faults(fault::kEstopOpen) > before, text(not_driven) + " did not");
}

// Open for some microseconds: when a job reads the level, it is closed again. The edge tells.
void GpioStory::short_presses() {
  std::vector<Press> all;
  for (int i = 0; i < 8; ++i) {
    all.push_back(press(100'000 + 100'000 * i, true));
    if (!drive_on()) check("drives after a short press", false, "");
  }
  judge("a short press", all);
}

void GpioStory::contacts_differ() {
  const auto before = job_.faults(fault::kEstopDisagree);
  lines_.open(kEstop2);
  ::usleep(static_cast<useconds_t>(1000 * (kDisagree_ms + 5)));
  check("contacts that differ are named",
        job_.faults(fault::kEstopDisagree) > before && job_.fault() == fault::kEstopDisagree,
        "fault " + text(job_.fault()));
  check("and stop", tap_.off_now(), "");
  check("drives after them", drive_on(), "");
}

void GpioStory::taped_switch() {
  const bool drove = drive_on(false);
  check("a switch that was held from the start enables nothing",
        !drove && job_.fault() == fault::kNotEnabled, "fault " + text(job_.fault()));
  check("drives once it was let go and held", drive_on(), "");
}

void GpioStory::enable_let_go() {
  ::usleep(100'000);  // to be fast enough for a ramp
  const auto before = job_.faults(fault::kNotEnabled);
  const std::int64_t edge = rt::monotonic_ns();
  lines_.open(kEnable);
  ::usleep(80'000);
  check("a switch that is let go is named", job_.faults(fault::kNotEnabled) > before, "");
  std::size_t stands = tap_.first_from(edge);
  while (stands < tap_.count() && !tap_.frame(stands).still) ++stands;
  const std::int64_t took = stands < tap_.count() ? tap_.frame(stands).at_ns - edge : 0;
  figure("enable.to_stand_us", 1e-3 * static_cast<double>(took), "us");
  // 0.1 m/s at most by then, at 4 m/s2; and the job that sees it.
  check("the base ramps down and stands", took > kPeriod_ns && took < 60'000'000,
        text(took / 1000) + " us");
  std::size_t moves = 0;
  for (; stands < tap_.count(); ++stands) moves += tap_.frame(stands).still ? 0U : 1U;
  check("and stays", moves == 0, text(moves) + " frames");
  check("drives after let go, hold, clear and engage", drive_on(), "");
}

int GpioStory::beats(int ms) const {
  int edges = 0, last = lines_.value(kBeat);
  const std::int64_t end = rt::monotonic_ns() + ms * 1'000'000LL;
  while (rt::monotonic_ns() < end) {
    const int now = lines_.value(kBeat);
    edges += now != last ? 1 : 0;
    last = now;
    ::usleep(300);
  }
  return edges;
}

void GpioStory::heartbeat() {
  const int wanted = static_cast<int>(60 / kBeat_ms);
  const int drives = beats(60);
  figure("heartbeat.edges", drives, "1");
  check("the heartbeat is a square wave", std::abs(drives - wanted) <= 2,
        text(drives) + " edges in 60 ms");
  check("the lamp is on while it drives", lines_.value(kLamp) == 1, "");
  open_estop();
  ::usleep(15'000);
  const int stopped = beats(60);
  check("the heartbeat goes on in a safe stop", std::abs(stopped - wanted) <= 2,
        text(stopped) + " edges in 60 ms");
  check("drives after it", drive_on(), "");
}

// The chain is silent: the relay has to open, and closes by the operator's clear alone.
void GpioStory::bus_lost() {
  const std::int64_t back_at = rt::monotonic_ns() + 250'000'000;  // --long-gap-ms
  ::kill(chain_pid_, SIGUSR2);
  timed_ = false;
  const bool stops = until([&] { return job_.mode == Mode::kSafeStop; }, 200);
  check("a lost bus is a safe stop", stops && job_.faults(fault::kBusDown) > 0,
        "fault " + text(job_.fault()));
  ::usleep(5000);
  const int silent = beats(30);
  check("the heartbeat ends with the bus", silent == 0, text(silent) + " edges in 30 ms");
  sleep_until(back_at + 20'000'000);
  timed_ = true;
  const int back = beats(30);
  check("a bus that is back brings no heartbeat", back == 0, text(back) + " edges in 30 ms");
  check("drives after the operator's clear", drive_on(), "fault " + text(job_.fault()));
  const int again = beats(30);
  check("and the heartbeat goes on", again >= 13, text(again) + " edges in 30 ms");
}

// As a chip on a USB stick that is pulled out.
void GpioStory::chip_gone() {
  const std::int64_t at = rt::monotonic_ns();
  const int fd = ::open(live_.c_str(), O_WRONLY | O_CLOEXEC);
  if (fd < 0 || ::write(fd, "0", 1) != 1) std::perror(live_.c_str());
  if (fd >= 0) ::close(fd);
  ::usleep(20'000);
  std::size_t off = tap_.first_from(at);
  while (off < tap_.count() && !tap_.frame(off).off) ++off;
  check("a chip that is gone is named", job_.fault() == fault::kLinesUnread, text(job_.fault()));
  check("and stops the motors", off < tap_.count() && driving_from(off) == 0, "");
}

void GpioStory::tell_all(int n) {
  ::usleep(50'000);
  close_estop();
  lines_.close(kEnable);
  ::usleep(30'000);
  taped_switch();
  presses(n);
  short_presses();
  contacts_differ();
  enable_let_go();
  heartbeat();
  bus_lost();
  check("every frame has the kernel's time", tap_.unstamped() == 0, text(tap_.unstamped()));
  timed_ = false;
  chip_gone();
}

}  // namespace vm
