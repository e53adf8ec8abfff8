// The cycle: no allocation, no throw, one wait.
#include <algorithm>

#include "drivers/ethercat/master.hpp"
#include "drivers/ethercat/registers.hpp"

namespace drivers::ethercat {

namespace {

constexpr int kMostRefused = 2;  // the frames of one job
// Datagrams of a recovery, a slave, beside those that wait for a state: 2 + 6 blocks, four states,
// each asked for a few times, and some lost.
constexpr std::int64_t kRecoverySteps = 300, kMostRecoverySteps = 1'000'000;

}  // namespace

const char* to_text(CycleStatus s) noexcept {
  static constexpr std::array kTexts{"ok", "frame lost", "link down", "working counter"};
  return kTexts[static_cast<std::size_t>(s)];
}

const char* to_text(BusFault f) noexcept {
  static constexpr std::array kTexts{"none",           "link down",   "frames are lost",
                                     "slaves missing", "slave state", "working counter"};
  return kTexts[static_cast<std::size_t>(f)];
}

std::span<std::uint8_t> Master::outputs(std::size_t i) noexcept {
  const SlaveMapping& m = mapping_.slaves[i];
  return std::span(image_).subspan(m.output_at, m.output_bytes);
}

std::span<const std::uint8_t> Master::inputs(std::size_t i) const noexcept {
  const SlaveMapping& m = mapping_.slaves[i];
  return std::span(image_).subspan(m.input_at, m.input_bytes);
}

void Master::clear_outputs() noexcept {
  std::fill_n(image_.begin(), mapping_.output_bytes, std::uint8_t{0});
}

void Master::stop_outputs() noexcept {
  for (std::size_t i = 0; i < kept_.size(); ++i)
    if (!kept_[i]) std::ranges::fill(outputs(i), std::uint8_t{0});
}

std::span<const std::uint8_t> Master::output_image() const noexcept {
  return std::span(image_).first(mapping_.output_bytes);
}

// Behind the process data, in the same frame.
void Master::add_watch(Places& p) noexcept {
  const auto place = [&] { return static_cast<int>(frames_.count()) - 1; };
  if (frames_.add(Command::kBrd, broadcast_address(reg::kAlStatus), 2)) p.all = place();
  if (recovery_.active()) {
    if (recovery_.add_to(frames_)) p.service = place();
  } else if (!slaves_.empty() &&
             frames_.add(Command::kFprd, station_address(slaves_[watched_].station, reg::kAlStatus),
                         6)) {
    p.service = place();
  }
  if (transfer_.busy() && transfer_.add_to(frames_)) p.mailbox = place();
}

CycleResult Master::exchange() noexcept {
  if (stopped_ || recovery_.active()) stop_outputs();
  frames_.begin();
  Places p;
  int expected = 0;
  const std::size_t out = mapping_.output_bytes, in = mapping_.input_bytes;
  if (mapping_.lrw && out + in > 0) {
    if (frames_.add(Command::kLrw, 0, out + in, image_)) p.data = 0;
    expected = mapping_.expected_lrw();
  } else {
    if (in > 0 && frames_.add(Command::kLrd, static_cast<std::uint32_t>(out), in)) {
      p.data = static_cast<int>(frames_.count()) - 1;
      expected += mapping_.expected_lrd();
    }
    if (out > 0 && frames_.add(Command::kLwr, 0, out, output_image())) {
      p.write = static_cast<int>(frames_.count()) - 1;
      expected += mapping_.expected_lwr();
    }
  }
  add_watch(p);
  return finish(p, expected, Half::kBoth);
}

CycleResult Master::read_inputs() noexcept {
  frames_.begin();
  Places p;
  if (mapping_.input_bytes > 0 &&
      frames_.add(Command::kLrd, static_cast<std::uint32_t>(mapping_.output_bytes),
                  mapping_.input_bytes))
    p.data = 0;
  add_watch(p);
  return finish(p, mapping_.expected_lrd(), Half::kRead);
}

CycleResult Master::write_outputs() noexcept {
  if (stopped_ || recovery_.active()) stop_outputs();
  frames_.begin();
  Places p;
  if (mapping_.output_bytes > 0 &&
      frames_.add(Command::kLwr, 0, mapping_.output_bytes, output_image()))
    p.write = 0;
  return finish(p, mapping_.expected_lwr(), Half::kWrite);
}

CycleResult Master::finish(const Places& p, int expected, Half h) noexcept {
  CycleResult r{CycleStatus::kOk, 0, expected};
  // After a lost read its write waits half as long: two lost frames shall not cost the next job.
  const bool read_was_lost = h == Half::kWrite && half_read_ &&
                             (last_ == CycleStatus::kLost || last_ == CycleStatus::kLinkDown);
  const rt::Nanos patience = read_was_lost ? config_.reply_timeout / 2 : config_.reply_timeout;
  const bool sent = frames_.send();
  refused_in_row_ = sent ? 0 : refused_in_row_ + 1;
  if (!sent) {
    // A card whose queue is full refuses a frame, which is no more than lost. One that goes on
    // sends none, whatever it says of its carrier: a fall of it may be told 10 ms later.
    const bool down = refused_in_row_ > kMostRefused || !frames_.port().link_up();
    r.status = down ? CycleStatus::kLinkDown : CycleStatus::kLost;
  } else if (!frames_.collect(frames_.port().now() + patience)) {
    // A card without a carrier takes frames all the same: only a lost one is worth the question.
    r.status = frames_.port().link_up() ? CycleStatus::kLost : CycleStatus::kLinkDown;
  }
  if (r.status != CycleStatus::kOk) {
    lose(p);
    judge(h, r.status);
    return r;
  }
  const auto counted = [&](int place) {
    return place < 0 ? 0 : frames_.reply(static_cast<std::size_t>(place)).counter;
  };
  r.counter = counted(p.data) + counted(p.write);
  if (r.counter != expected) r.status = CycleStatus::kShort;
  if (r.status == CycleStatus::kOk && h != Half::kWrite && p.data >= 0) {
    const auto data = frames_.reply(static_cast<std::size_t>(p.data)).data;
    // Of LRW the image comes back whole; of LRD the inputs alone.
    const auto in = data.last(mapping_.input_bytes);
    std::copy(in.begin(), in.end(),
              image_.begin() + static_cast<std::ptrdiff_t>(mapping_.output_bytes));
  }
  take_watch(p);
  judge(h, r.status);
  return r;
}

void Master::take_watch(const Places& p) noexcept {
  if (p.all >= 0) {
    const DatagramView& all = frames_.reply(static_cast<std::size_t>(p.all));
    present_ = all.counter;
    all_states_ = all.data[0];
  }
  if (p.service >= 0) take_service(frames_.reply(static_cast<std::size_t>(p.service)));
  if (p.mailbox >= 0) transfer_.on_reply(frames_.reply(static_cast<std::size_t>(p.mailbox)));
}

void Master::take_service(const DatagramView& d) noexcept {
  const auto told = [&] {
    return d.counter == 1 ? AlStatus{d.data[0], load_u16(d.data, 4)} : AlStatus{};
  };
  if (!recovery_.active()) {
    al_[watched_] = told();
    watched_ = (watched_ + 1) % slaves_.size();
    return;
  }
  if (recovery_.observes()) al_[static_cast<std::size_t>(recovery_.slave())] = told();
  recovery_.on_reply(d);
  if (recovery_.active() || !recovery_.succeeded()) return;
  stopped_ = false;
  std::fill(al_.begin(), al_.end(),
            AlStatus{static_cast<std::uint8_t>(AlState::kOp), al_code::kNone});
}

void Master::lose(const Places& p) noexcept {
  if (p.service >= 0 && recovery_.active()) recovery_.on_lost();
  if (p.mailbox >= 0) transfer_.on_lost();
}

// A write belongs to the read before it: together they are one cycle, as good as its worse half.
void Master::judge(Half h, CycleStatus s) noexcept {
  const bool second = h == Half::kWrite && half_read_;
  const bool read_was_bad = second && last_ != CycleStatus::kOk;
  // A read without a write was a whole cycle.
  if (half_read_ && !second && last_ == CycleStatus::kOk) counters_.bad_in_row = 0;
  half_read_ = h == Half::kRead;
  if (!second) ++counters_.cycles;
  if (read_was_bad) return;
  last_ = s;
  if (s == CycleStatus::kOk) {
    // A good read counts when its write was good as well.
    if (h != Half::kRead) counters_.bad_in_row = 0;
    return;
  }
  if (s == CycleStatus::kLost) ++counters_.lost;
  if (s == CycleStatus::kLinkDown) ++counters_.link_down;
  if (s == CycleStatus::kShort) ++counters_.short_counter;
  if (++counters_.bad_in_row >= config_.bad_limit) stopped_ = true;
}

BusHealth Master::health() const noexcept {
  BusHealth h;
  const int slaves = static_cast<int>(slaves_.size());
  if (last_ == CycleStatus::kLinkDown || last_ == CycleStatus::kLost) {
    h.fault = last_ == CycleStatus::kLost ? BusFault::kFramesLost : BusFault::kLinkDown;
    return h;
  }
  if (present_ < slaves) {
    h.fault = BusFault::kSlavesMissing;
    h.slave = present_;
    return h;
  }
  // Who it is, is known when its turn has come; that somebody is, at once.
  if (all_states_ != static_cast<std::uint8_t>(AlState::kOp) || present_ > slaves) {
    h.fault = BusFault::kSlaveState;
    for (int i = 0; i < slaves && h.slave < 0; ++i) {
      const AlStatus& al = al_[static_cast<std::size_t>(i)];
      if (al.is() == AlState::kOp && !al.error()) continue;
      h.slave = i;
      h.al = al;
    }
    // None of those that were found: it has no station address, so its turn never comes.
    if (h.slave < 0 && present_ > slaves) {
      h.slave = slaves;
      h.too_many = present_ - slaves;
    }
    return h;
  }
  if (last_ == CycleStatus::kShort) h.fault = BusFault::kWorkingCounter;
  return h;
}

void Master::recover() noexcept {
  counters_.bad_in_row = 0;
  // One look a cycle: a slave has the time that a step of the state machine has.
  const std::int64_t looks = config_.state_timeout / std::max(config_.period, rt::Nanos{1});
  recovery_.start(static_cast<int>(std::min(kRecoverySteps + looks, kMostRecoverySteps)));
  stop_outputs();
}

bool Master::post(std::size_t slave, std::span<const std::uint8_t> request, int patience) noexcept {
  if (transfer_.busy()) return false;
  transfer_.start(slaves_[slave].station, mapping_.slaves[slave].mailbox, request, patience);
  return true;
}

bool Master::post_read(std::size_t slave, int patience) noexcept {
  if (transfer_.busy()) return false;
  transfer_.start_read(slaves_[slave].station, mapping_.slaves[slave].mailbox, patience);
  return true;
}

}  // namespace drivers::ethercat
