#include "drivers/link/frame_asker.hpp"

#include <algorithm>

namespace drivers {

namespace {

// A camera's period, and what is sent where the coarsest frames do not fit: 24, then 20 a second.
constexpr double kCameraPeriod_s = 1.0 / 30;
constexpr rt::Nanos kPeriod24{41'666'667}, kPeriod20{50'000'000};
// A step of quality changes the bytes by a quarter to a third: what made a frame coarser does not
// make it finer again at once.
constexpr double kBusy = 0.95, kIdle = 0.55;
constexpr int kFramesBeforeCoarser = 4, kFramesBeforeFiner = 45;
constexpr double kForget = 0.25;  // weight of the newest frame in a mean
// A frame that the line swallows within this says nothing about its rate.
constexpr double kLeastSeen_s = 0.008;

}  // namespace

void FrameAsker::wish(int rungs) noexcept { wish_ = std::clamp(rungs, 0, kRungs); }

int FrameAsker::rung() const noexcept { return std::max(rung_, wish_); }

rt::Nanos FrameAsker::period() const noexcept {
  if (rung() == kRungs) return std::max(config_.period, kPeriod20);
  if (rung() == kRungs - 1) return std::max(config_.period, kPeriod24);
  return config_.period;
}

FrameDemand FrameAsker::make(rt::Time now) noexcept {
  repeat_ = now + config_.repeat;
  FrameDemand d;
  d.seq = asked_;
  d.made = now;
  d.rate_kbit_per_s = static_cast<std::uint32_t>(rate_kbit_per_s_);
  d.coarser = static_cast<std::uint8_t>(std::min(rung(), kCoarsest));
  d.key = want_key_ ? 1 : 0;
  return d;
}

std::optional<FrameDemand> FrameAsker::poll(rt::Time now, rt::Nanos busy_for,
                                            rt::Time heard) noexcept {
  if (sending_ && busy_for.count() == 0) line_is_free(now);
  if (now - heard > config_.silence) {
    if (!silent_) ++stats_.silences;
    silent_ = want_key_ = true;
    return std::nullopt;
  }
  silent_ = false;
  if (out() || now < next_ || busy_for > config_.lead) {
    if (asked_ == 0 || now < repeat_) return std::nullopt;
    return make(now);
  }
  ++asked_;
  // While the line keeps up, ask at fixed times: the rate then does not depend on the camera's
  // phase.
  next_ = std::max(next_ + period(), now + period() / 2);
  return make(now);
}

bool FrameAsker::sent(rt::Time now, std::uint64_t seq, bool key, std::size_t bytes) noexcept {
  if (!out() || seq != asked_) {
    want_key_ = true;
    return false;
  }
  sent_ = asked_;
  ++frames_;
  ++stats_.sent;
  if (key) {
    ++stats_.keys;
    last_key_ = frames_;
    want_key_ = false;
  }
  if (first_) counts_from_ = now + config_.learn;
  first_ = false;
  sending_ = true;
  since_ = now;
  bytes_ = bytes;
  return true;
}

void FrameAsker::line_is_free(rt::Time now) noexcept {
  sending_ = false;
  const double took_s = 1e-9 * static_cast<double>((now - since_).count());
  if (took_s > kLeastSeen_s) {
    const double rate = 8e-3 * static_cast<double>(bytes_) / took_s;
    rate_kbit_per_s_ += (rate_kbit_per_s_ > 0 ? kForget : 1.0) * (rate - rate_kbit_per_s_);
  }
  if (since_ < counts_from_) return;
  load_ += kForget * (took_s / kCameraPeriod_s - load_);
  ++frames_on_rung_;
  // Fewer frames leave more time to each.
  const double room = 1e-9 * static_cast<double>(period().count()) / kCameraPeriod_s;
  const double busy = load_ / std::max(1.0, room);
  if (busy > kBusy && frames_on_rung_ >= kFramesBeforeCoarser && rung_ < kRungs) {
    ++rung_;
    frames_on_rung_ = 0;
  } else if (busy < kIdle && frames_on_rung_ >= kFramesBeforeFiner && rung_ > 0) {
    --rung_;
    frames_on_rung_ = 0;
  }
}

void FrameAsker::report(const FrameReport& report) noexcept {
  // The last key has not arrived yet: it is the answer.
  if (report.key_wanted == 0 || report.arrived < last_key_ || want_key_) return;
  want_key_ = true;
  ++stats_.keys_asked;
}

void FrameAsker::renew() noexcept {
  sent_ = asked_;
  next_ = {};
  want_key_ = first_ = true;
  sending_ = false;
}

Spared FrameAsker::spared() const noexcept {
  if (rung() == 0) return {};
  return {static_cast<std::uint8_t>(rung()),
          wish_ >= rung_ ? Spared::Why::kLate : Spared::Why::kBusy};
}

FrameAsker::Stats FrameAsker::stats() const noexcept {
  Stats s = stats_;
  s.rung = rung();
  return s;
}

}  // namespace drivers
