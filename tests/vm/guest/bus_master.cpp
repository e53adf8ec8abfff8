// robot_io on the product's executor: one job a millisecond drives a youBot with an arm, five
// joints held, behind a network interface. Supervision and the operator are played (Operator).
//
//   vm_master --iface IF --expect run|gaps|books|damage [--seconds S] [--act-at S] [--reply-us US]
//             [--watchdog-ms MS] [--timed no] [--gate PATH] [--check none|refuse|count]
//
//   run     the wheels turn to the end; lost frames are counted and change nothing
//   gaps    frames are missing twice: first for less than 100 cycles, and the wheels turn on; then
//           for longer, so the master stops; frames come again and it stays stopped until --act-at,
//           then the wheels turn again
//   books   no wrong state and no stop; for a clock on which a job may be late by a second
//   damage  frames come with damage that nothing before the master refused: it goes on; what it
//           took for good is counted. A flag that was hit stops robot_io; the clear is held for it
//   gate    in OP it makes PATH.ready and waits for PATH.go
//   timed   no: deadlines are not judged
//   check   checked_port.hpp
// Figures: ethercat.{cycles, missed, lost, in_row, short, sent, foreign, damaged, wrong_sequence,
// wrong_state, odd_positions, cycle_cpu_{p50, p99, max}_us, start_{p50, p99, max}_us}.
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <thread>
#include <vector>

#include "drivers/ethercat/master.hpp"
#include "drivers/ethercat/raw_port.hpp"
#include "drivers/youbot_bus/ethercat_motor_bus.hpp"
#include "drivers/youbot_bus/process_data.hpp"
#include "rt/quantile.hpp"
#include "rt/sched/admission.hpp"
#include "rt/sched/real_executor.hpp"
#include "tasks/robot_io/robot_io_task.hpp"
#include "tests/vm/guest/checked_port.hpp"
#include "tests/vm/guest/say.hpp"

namespace {

using namespace drivers;

constexpr std::int64_t kHz = 1000;
constexpr double kSpeed_m_per_s = 0.5;
// Between set-up and the first job the slaves' watchdog falls: memory is locked and threads are
// made. So the first jobs are the act of a start, and those from kSettle on are judged.
constexpr std::int64_t kStartAt = 50;
constexpr std::uint64_t kSettle = 400;
constexpr std::array<std::size_t, 5> kJoints{6, 7, 8, 9, 10};  // slaves, from 0
// From the stop until wheels that are switched off stand.
constexpr std::uint64_t kStandsAfter = 300;

struct Seen {
  int longest_loss = 0, longest_held = 0;  // lost in a row; of these the master did not stop
  std::uint64_t wrong_state =
      0;  // cycles in which a slave was missing or not in OP, or a counter wrong
  std::uint64_t odd_positions = 0;  // no position of this cycle, by the speed of the wheel
  std::uint64_t steps_judged = 0;
  std::uint64_t arm_let_go = 0;  // good cycles after the start that did not tell a joint to hold
  std::uint64_t replies_while_stopped = 0, moved_while_stopped = 0;
  std::uint64_t after_act = 0;  // cycles with wheels that turn after the act
  std::int64_t stopped_at = -1;
  bool watchdog_seen = false;     // a slave said 0x001B
  bool turning = false;           // in the last cycle
  std::int64_t answered_at = -1;  // first judged job whose frame came back in time
  std::int64_t begun_at = -1;     // all in OP, flags cleared, the wheels turn
};

// Clears what the start has left, and at `act_at` what came later; engages when it is gone.
class Operator {
 public:
  Operator(std::int64_t act_at, bool clears_always) : act_at_(act_at), always_(clears_always) {
    mode_.mode = tasks::Mode::kSafeStop;
  }
  // As supervision, every tenth job.
  void look(std::int64_t k, const rt::Health& health) noexcept {
    mode_.clear = always_ || (k >= kStartAt && k < static_cast<std::int64_t>(kSettle)) ||
                  (act_at_ >= 0 && k >= act_at_);
    if (k % 10 != 5) return;
    if (health.severity == rt::Severity::kSafeStop)
      mode_.mode = tasks::Mode::kSafeStop;
    else if (mode_.clear)
      mode_.mode = tasks::Mode::kEngaged;
  }
  // A place far ahead, told anew at 50 Hz.
  void renew(const rt::Tick& tick) noexcept {
    if (tick.k % 20 != 0) return;
    ++goal_.seq;
    goal_.made = tick.start;
    goal_.valid_until = tick.start + std::chrono::seconds{3};
    goal_.x_m = 1000;
    goal_.speed_limit_m_per_s = kSpeed_m_per_s;
    goal_.engaged = goal_.operator_engaged = 1;
  }
  [[nodiscard]] const tasks::ModeMsg& mode() const noexcept { return mode_; }
  [[nodiscard]] const drivers::RobotGoal& goal() const noexcept { return goal_; }

 private:
  std::int64_t act_at_;
  bool always_;
  tasks::ModeMsg mode_;
  drivers::RobotGoal goal_;
};

class RobotIoJob final : public rt::TaskBody {
 public:
  RobotIoJob(rt::NonRealtime& nrt, ethercat::Master& master, youbot_bus::EtherCatMotorBus& bus,
             double seconds, double act_at, bool clears_always)
      : master_(master),
        bus_(bus),
        task_(nrt, {}),
        operator_(act_at < 0 ? -1 : kSettle + std::llround(act_at * kHz), clears_always),
        act_at_(act_at < 0 ? -1 : kSettle + std::llround(act_at * kHz)),
        end_(kSettle + std::llround(seconds * kHz)) {}
  void latch(const rt::Tick& tick, rt::JobRecord&) noexcept override {
    const auto k = static_cast<std::int64_t>(tick.k);
    if (k == first_) before_ = lost();
    if (k == end_) before_end_ = lost();
    lost_before_ = lost();
    operator_.renew(tick);
    in_.sent = sent_;
    in_.bus = bus_.sense(tick.start, in_.motors);
    const bool of_write = in_.bus == BusStatus::kOk && sent_ != BusStatus::kOk;
    in_.bus_detail = of_write ? sent_detail_ : bus_.detail();
    in_.mode = &operator_.mode();
    in_.goal = &operator_.goal();
    in_.link_heard = true;
    in_.link_heard_at = tick.start;
  }
  rt::Health step(const rt::Tick& tick, rt::JobRecord&) noexcept override {
    return health_ = task_.step(tick, in_, out_);
  }
  void commit(const rt::Tick& tick, rt::JobRecord&) noexcept override {
    const auto k = static_cast<std::int64_t>(tick.k);
    if (out_.rearm_motors) bus_.rearm();
    sent_ = bus_.act(tick.start, out_.setpoints);
    sent_detail_ = bus_.detail();
    operator_.look(k, health_);
    if (k >= first_ && k < end_) note(k, lost() == lost_before_);
  }
  [[nodiscard]] std::uint64_t lost_while_judged() const noexcept { return before_end_ - before_; }
  void make_safe() noexcept override { bus_.make_safe(); }
  [[nodiscard]] const Seen& seen() const noexcept { return seen_; }
  // Frames, of which a job sends two.
  [[nodiscard]] std::uint64_t lost() const noexcept {
    return master_.frames().lost + master_.frames().refused;
  }

 private:
  void note(std::int64_t k, bool replied) noexcept {
    using ethercat::BusFault;
    if (replied && !master_.stopped()) seen_.longest_held = std::max(seen_.longest_held, in_row_);
    in_row_ = replied ? 0 : in_row_ + 1;
    seen_.longest_loss = std::max(seen_.longest_loss, in_row_);
    if (!replied) return;
    if (seen_.answered_at < 0) seen_.answered_at = k;
    const ethercat::BusHealth health = master_.health();
    const bool good = health.fault == BusFault::kNone;
    if (!good && seen_.begun_at >= 0 && seen_.stopped_at < 0 && !master_.stopped())
      ++seen_.wrong_state;
    if (health.al.code == ethercat::al_code::kWatchdog) seen_.watchdog_seen = true;
    youbot_bus::DriveInputs in;
    if (!youbot_bus::decode(master_.inputs(1), in)) return;
    const bool moved = in.position_ticks != last_.position_ticks;
    if (seen_.begun_at >= 0 && seen_.stopped_at < 0 && !master_.stopped()) {
      note_step(k, in);
      note_arm();
    }
    last_ = in;
    last_at_ = k;
    seen_.turning = moved && in.velocity_rpm != 0;
    if (good && seen_.turning && seen_.begun_at < 0) seen_.begun_at = k;
    if (master_.stopped()) {
      if (seen_.stopped_at < 0) seen_.stopped_at = k;
      ++seen_.replies_while_stopped;
      const bool stands = static_cast<std::uint64_t>(k - seen_.stopped_at) > kStandsAfter;
      if (stands && moved) ++seen_.moved_while_stopped;
    } else if (act_at_ >= 0 && k > act_at_ && seen_.turning) {
      ++seen_.after_act;
    }
  }

  void note_arm() noexcept {
    for (const std::size_t j : kJoints) {
      youbot_bus::DriveOutputs o;
      if (youbot_bus::decode(master_.outputs(j), o) &&
          o.mode == youbot_bus::ControllerMode::kPosition)
        continue;
      ++seen_.arm_let_go;
      return;
    }
  }

  // By the mean speed of both states; that of another cycle is a whole step off. A wheel that has
  // hardly begun to turn tells nothing.
  void note_step(std::int64_t k, const youbot_bus::DriveInputs& in) noexcept {
    const youbot_bus::MotorBusConfig c;
    constexpr double kLeast_rpm = 500;
    if (std::min(std::abs(in.velocity_rpm), std::abs(last_.velocity_rpm)) < kLeast_rpm) return;
    const double step =
        0.5 * (in.velocity_rpm + last_.velocity_rpm) / 60 * c.ticks_per_motor_turn / kHz;
    const double took = static_cast<double>(in.position_ticks - last_.position_ticks);
    ++seen_.steps_judged;
    if (std::abs(took - step * static_cast<double>(k - last_at_)) > std::abs(step) / 2)
      ++seen_.odd_positions;
  }

  ethercat::Master& master_;
  youbot_bus::EtherCatMotorBus& bus_;
  tasks::RobotIoTask task_;
  tasks::RobotIoTask::In in_;
  tasks::RobotIoTask::Out out_;
  Operator operator_;
  BusStatus sent_ = BusStatus::kOk;
  BusDetail sent_detail_;
  rt::Health health_;
  std::int64_t act_at_, first_ = kSettle, end_;
  std::uint64_t before_ = 0, before_end_ = 0, lost_before_ = 0;  // lost frames
  Seen seen_;
  int in_row_ = 0;
  youbot_bus::DriveInputs last_;  // of the first wheel
  std::int64_t last_at_ = 0;
};

struct Run {
  std::vector<rt::JobRecord> jobs;
  std::uint64_t releases = 0, late = 0;
  std::vector<std::string> missing;
  // Without a record: dropped by the policy.
  [[nodiscard]] std::uint64_t missed() const { return late + releases - jobs.size(); }
};

Run drive(rt::NonRealtime& nrt, RobotIoJob& job, double seconds) {
  const auto wanted = static_cast<std::uint64_t>(std::llround(seconds * kHz));
  rt::PlacedTask task;
  task.spec.name = "robot_io";
  task.spec.rate = {kHz, 1};
  task.spec.budget = std::chrono::microseconds{200};
  task.body = &job;
  task.priority = rt::kTopTaskPriority;
  Run run;
  run.jobs.reserve(wanted + 64);
  rt::RealExecutor<rt::Plain> executor(
      nrt, {task}, rt::Plain{},
      [&](const rt::JobRecord& r) {
        if (r.k >= kSettle && r.k < kSettle + wanted) run.jobs.push_back(r);
      },
      [](const rt::SentinelRecord&) {});
  rt::RunPlan plan;
  plan.epoch_host_ns = rt::monotonic_ns() + 300'000'000;
  plan.duration = rt::Nanos{static_cast<std::int64_t>(kSettle + wanted + 10) * 1'000'000'000 / kHz};
  executor.run(plan);
  run.missing = executor.missing();
  run.releases = wanted;
  for (const auto& r : run.jobs) run.late += r.missed() ? 1 : 0;
  return run;
}

void wait_at(const std::string& gate) {
  if (gate.empty()) return;
  std::fclose(std::fopen((gate + ".ready").c_str(), "w"));
  while (::access((gate + ".go").c_str(), F_OK) != 0) ::usleep(10'000);
}

void say_job(const char* what, const rt::JobRecord& j) {
  std::printf("%s: job %llu start %.1f us, CPU %.1f us, end %.1f us, %u faults, %u skipped\n", what,
              static_cast<unsigned long long>(j.k), 1e-3 * static_cast<double>(j.lateness_ns()),
              1e-3 * static_cast<double>(j.cpu_ns),
              1e-3 * static_cast<double>(j.end_ns - j.release_ns), j.minor_faults, j.skipped);
}

void say_times(const Run& run) {
  std::vector<double> start, cpu;
  const rt::JobRecord* latest = run.jobs.data();
  for (const auto& j : run.jobs) {
    if (j.lateness_ns() > latest->lateness_ns()) latest = &j;
    if (j.missed() || j.skipped > 0) say_job("missed", j);
    start.push_back(1e-3 * static_cast<double>(j.lateness_ns()));
    cpu.push_back(1e-3 * static_cast<double>(j.cpu_ns));
  }
  say_job("latest start", *latest);
  std::sort(start.begin(), start.end());
  std::sort(cpu.begin(), cpu.end());
  const auto at = [](const std::vector<double>& sorted, double q) {
    return sorted[rt::quantile_rank(q, sorted.size()) - 1];
  };
  vm::figure("ethercat.start_p50_us", at(start, .5), "us");
  vm::figure("ethercat.start_p99_us", at(start, .99), "us");
  vm::figure("ethercat.start_max_us", start.back(), "us");
  vm::figure("ethercat.cycle_cpu_p50_us", at(cpu, .5), "us");
  vm::figure("ethercat.cycle_cpu_p99_us", at(cpu, .99), "us");
  vm::figure("ethercat.cycle_cpu_max_us", cpu.back(), "us");
}

void say_frames(ethercat::Master& master, const vm::CheckedPort& wire, const Seen& s) {
  const auto &cycles = master.frames(), &set_up = master.registers().counters();
  const auto figure = [](const char* name, std::uint64_t n) {
    vm::figure(name, static_cast<double>(n), "1");
  };
  figure("ethercat.sent", cycles.sent + set_up.sent);
  figure("ethercat.foreign", cycles.foreign + set_up.foreign);
  figure("ethercat.damaged", cycles.damaged + set_up.damaged);
  figure("ethercat.wrong_sequence", wire.wrong());
  figure("ethercat.wrong_state", s.wrong_state);
  figure("ethercat.odd_positions", s.odd_positions);
  figure("ethercat.arm_let_go", s.arm_let_go);
}

void judge(const Seen& s, const ethercat::Master& master, const std::string& expect,
           std::uint64_t lost) {
  const auto text = [](auto n) { return std::to_string(n); };
  if (expect == "books") {
    vm::check("no wrong state", s.wrong_state == 0, text(s.wrong_state) + " cycles");
    vm::check("no stop", !master.stopped() && s.stopped_at < 0, "");
    return;
  }
  if (expect == "damage") {
    vm::check("no stop", !master.stopped() && s.stopped_at < 0, "");
    vm::check("wheels turn at the end", s.turning, "");
    return;
  }
  // On a line that loses frames the first one judged may be lost, and tells nothing.
  constexpr std::int64_t kMostLost = 3;
  vm::check("in OP and turning from the first judged job on",
            s.begun_at == s.answered_at &&
                s.answered_at - static_cast<std::int64_t>(kSettle) <= kMostLost,
            "job " + text(s.begun_at) + ", answered from " + text(s.answered_at));
  vm::check("no wrong state", s.wrong_state == 0, text(s.wrong_state) + " cycles");
  if (expect == "run") {
    vm::check("every state is of its own cycle", s.odd_positions == 0 && s.steps_judged > 500,
              text(s.odd_positions) + " of " + text(s.steps_judged) + " are not");
    vm::check("the arm is held in every cycle", s.arm_let_go == 0, text(s.arm_let_go));
    vm::check("no stop", !master.stopped() && s.stopped_at < 0, "");
    vm::check("wheels turn at the end", s.turning, "");
    return;
  }
  vm::check("held over the short gap", s.longest_held >= 10 && s.longest_held < 100,
            text(s.longest_held) + " lost in a row");
  vm::check("stopped by lost frames", s.stopped_at >= 0 && s.longest_loss >= 100,
            text(s.longest_loss) + " lost in a row of " + text(lost));
  vm::check("slaves fell to SAFEOP by their watchdog, 0x001B", s.watchdog_seen, "");
  vm::check("stays stopped while frames come", s.replies_while_stopped >= 500,
            text(s.replies_while_stopped) + " cycles with a reply");
  vm::check("wheels stand meanwhile", s.moved_while_stopped == 0,
            text(s.moved_while_stopped) + " cycles moved");
  vm::check("recovers by the act", !master.stopped() && s.turning && s.after_act > 100,
            text(s.after_act) + " cycles turning after it");
}

}  // namespace

int main(int argc, char** argv) {
  const double seconds = vm::option(argc, argv, "seconds", 60.0);
  const double act_at = vm::option(argc, argv, "act-at", -1.0);
  const bool timed = vm::option(argc, argv, "timed", std::string("yes")) == "yes";
  const std::string expect = vm::option(argc, argv, "expect", std::string("run"));
  rt::Startup startup;
  auto& nrt = startup.token();
  auto port = ethercat::RawPort::open(nrt, vm::option(argc, argv, "iface", std::string("lo")));
  if (!port) {
    std::fprintf(stderr, "%s\n", port.error().c_str());
    return 2;
  }
  ethercat::MasterConfig config;
  config.reply_timeout =
      rt::Nanos{static_cast<std::int64_t>(1e3 * vm::option(argc, argv, "reply-us", 500.0))};
  config.watchdog_ms = static_cast<int>(
      vm::option(argc, argv, "watchdog-ms", static_cast<double>(config.watchdog_ms)));
  vm::CheckedPort wire(*port.value(), vm::option(argc, argv, "check", std::string("none")));
  ethercat::Master master(nrt, wire, config);
  master.registers().set_timeout(4 * config.reply_timeout);
  for (const auto step :
       {&ethercat::Master::find, &ethercat::Master::configure, &ethercat::Master::start}) {
    const auto done = (master.*step)(nrt);
    if (done) continue;
    const auto& n = master.registers().counters();
    vm::check("chain in OP", false,
              done.error() + "; frames sent " + std::to_string(n.sent) + ", refused " +
                  std::to_string(n.refused) + ", lost " + std::to_string(n.lost) + ", foreign " +
                  std::to_string(n.foreign) + ", damaged " + std::to_string(n.damaged));
    return 1;
  }
  vm::figure("ethercat.slaves", static_cast<double>(master.slaves().size()), "1");
  youbot_bus::MotorBusConfig motors;
  motors.joints.assign(kJoints.begin(), kJoints.end());
  youbot_bus::EtherCatMotorBus bus(nrt, master, motors);
  RobotIoJob job(nrt, master, bus, seconds, act_at, expect == "damage");
  wait_at(vm::option(argc, argv, "gate", std::string()));
  const std::uint64_t at_gate = job.lost();
  const Run run = drive(nrt, job, seconds);
  for (const auto& line : run.missing) vm::check("every right", false, line);

  const std::uint64_t lost = job.lost_while_judged();
  vm::figure("ethercat.cycles", static_cast<double>(run.jobs.size()), "1");
  vm::figure("ethercat.missed", static_cast<double>(run.missed()), "1");
  vm::figure("ethercat.lost", static_cast<double>(lost), "1");
  // From the gate on, with the jobs of start and end.
  vm::figure("ethercat.lost_in_all", static_cast<double>(job.lost() - at_gate), "1");
  vm::figure("ethercat.in_row", job.seen().longest_loss, "1");
  vm::figure("ethercat.short", static_cast<double>(master.counters().short_counter), "1");
  say_frames(master, wire, job.seen());
  say_times(run);
  if (timed) {
    vm::check("no cycle missed", run.missed() == 0,
              std::to_string(run.jobs.size()) + " of " + std::to_string(run.releases));
  }
  judge(job.seen(), master, expect, lost);
  return 0;
}
