#include "tools/bus/twin_faults.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <optional>
#include <stdexcept>
#include <string_view>

#include "drivers/ethercat/al_state.hpp"
#include "drivers/ethercat/twin/twin_port.hpp"

namespace teletact {

namespace ec = drivers::ethercat;
namespace yb = drivers::youbot_bus;

namespace {

constexpr rt::Nanos kDelay = std::chrono::milliseconds{2};

enum class FaultValue : std::uint8_t { kShare, kSlave, kNone };
struct FaultName {
  const char* name;
  TwinFaultKind kind;
  FaultValue value;
};
constexpr std::array kFaultNames{
    FaultName{"lose-out", TwinFaultKind::kLoseOut, FaultValue::kShare},
    FaultName{"lose-back", TwinFaultKind::kLoseBack, FaultValue::kShare},
    FaultName{"duplicate", TwinFaultKind::kDuplicate, FaultValue::kShare},
    FaultName{"delay", TwinFaultKind::kDelay, FaultValue::kShare},
    FaultName{"corrupt", TwinFaultKind::kCorrupt, FaultValue::kShare},
    FaultName{"counter", TwinFaultKind::kCounter, FaultValue::kShare},
    FaultName{"cut", TwinFaultKind::kCut, FaultValue::kSlave},
    FaultName{"fall", TwinFaultKind::kFall, FaultValue::kSlave},
    FaultName{"i2t", TwinFaultKind::kI2t, FaultValue::kSlave},
    FaultName{"stick", TwinFaultKind::kStick, FaultValue::kSlave},
    FaultName{"estop", TwinFaultKind::kEmergencyStop, FaultValue::kNone},
    FaultName{"silence", TwinFaultKind::kSilence, FaultValue::kNone},
    FaultName{"link", TwinFaultKind::kLink, FaultValue::kNone}};
constexpr double kMost_s = 1e6;

[[noreturn]] void refuse_fault(const std::string& text, const std::string& why) {
  throw std::runtime_error("--fault " + text + ": " + why);
}

const FaultName& name_of(TwinFaultKind kind) {
  return *std::find_if(kFaultNames.begin(), kFaultNames.end(),
                       [kind](const FaultName& n) { return n.kind == kind; });
}

// The number that the text begins with, and what is left of it.
std::optional<double> number_before(std::string_view& s) {
  double v = 0;
  const auto [end, wrong] = std::from_chars(s.data(), s.data() + s.size(), v);
  if (wrong != std::errc{} || !std::isfinite(v)) return std::nullopt;
  s.remove_prefix(static_cast<std::size_t>(end - s.data()));
  return v;
}

std::optional<double> number_of(std::string_view s) {
  const auto v = number_before(s);
  return s.empty() ? v : std::nullopt;
}

// "2.5" or "2.5-4", behind the @. In 1e-3 the first hyphen is the number's own.
void read_times(const std::string& text, std::string_view times, TwinFault& out) {
  const auto from = number_before(times);
  if (!from || *from < 0 || *from > kMost_s || (!times.empty() && times[0] != '-'))
    refuse_fault(text, "seconds are 0 to 1000000");
  out.from_s = *from;
  if (times.empty()) return;
  const auto to = number_of(times.substr(1));
  if (!to || *to <= *from || *to > kMost_s)
    refuse_fault(text, "the end is after the beginning, and at most 1000000 s");
  if (out.kind == TwinFaultKind::kFall)
    refuse_fault(text, "it ends by the master's recovery, and takes no end");
  if (out.kind == TwinFaultKind::kI2t)
    refuse_fault(text, "it ends by the motor's own clear, and takes no end");
  out.to_s = *to;
}

}  // namespace

TwinFault parse_twin_fault(const std::string& text) {
  const auto at = text.find('@');
  const std::string what = text.substr(0, at);
  const auto colon = what.find(':');
  const std::string name = what.substr(0, colon);
  const auto* const known = std::find_if(kFaultNames.begin(), kFaultNames.end(),
                                         [&](const FaultName& n) { return name == n.name; });
  if (known == kFaultNames.end())
    refuse_fault(
        text,
        "not one of lose-out, lose-back, duplicate, delay, corrupt, counter (:SHARE of "
        "frames), cut, fall, i2t, stick (:SLAVE), estop, silence, link; each with @FROM or "
        "@FROM-TO");
  TwinFault out;
  out.kind = known->kind;
  if (at != std::string::npos) read_times(text, std::string_view(text).substr(at + 1), out);
  if (known->value == FaultValue::kNone) {
    if (colon != std::string::npos) refuse_fault(text, "takes no value");
    if (out.kind == TwinFaultKind::kSilence) out.share = 1;
    return out;
  }
  const auto v = colon == std::string::npos ? std::nullopt : number_of(what.substr(colon + 1));
  if (known->value == FaultValue::kShare) {
    if (!v || *v <= 0 || *v > 1)
      refuse_fault(text, "needs a share of frames, above 0 and at most 1: " + name + ":0.01");
    out.share = *v;
  } else {
    if (!v || *v < 1 || *v > 64 || *v != std::floor(*v))
      refuse_fault(text, "needs a slave, counted from 1: " + name + ":2");
    out.slave = static_cast<std::size_t>(*v);
  }
  return out;
}

FaultyTwin::FaultyTwin(yb::YoubotChain& chain, std::vector<TwinFault> faults)
    : chain_(chain), faults_(std::move(faults)), stage_(faults_.size()) {
  const std::size_t n = chain_.boards().size();
  for (const TwinFault& f : faults_) {
    const FaultName& name = name_of(f.kind);
    if (name.value != FaultValue::kSlave) continue;
    const std::string text = std::string(name.name) + ":" + std::to_string(f.slave);
    if (f.slave < 1 || f.slave > n)
      refuse_fault(text, "the chain has slaves 1 to " + std::to_string(n));
    const bool motor = f.kind == TwinFaultKind::kI2t || f.kind == TwinFaultKind::kStick;
    if (motor && chain_.drive(f.slave - 1) == nullptr) refuse_fault(text, "has no motor");
  }
}

rt::Time FaultyTwin::after(double seconds) const noexcept {
  return begin_ + rt::Nanos{static_cast<std::int64_t>(1e9 * seconds)};
}

bool FaultyTwin::has(TwinFaultKind kind) const noexcept {
  return std::any_of(faults_.begin(), faults_.end(),
                     [kind](const TwinFault& f) { return f.kind == kind; });
}

bool FaultyTwin::acts(TwinFaultKind kind) const noexcept {
  for (std::size_t i = 0; i < faults_.size(); ++i)
    if (faults_[i].kind == kind && stage_[i] == Stage::kActs) return true;
  return false;
}

void FaultyTwin::act(rt::Time now) noexcept {
  for (std::size_t i = 0; i < faults_.size(); ++i) {
    const TwinFault& f = faults_[i];
    if (f.share > 0) continue;
    if (stage_[i] == Stage::kWaits && now >= after(f.from_s)) {
      stage_[i] = Stage::kActs;
      begin(f, now);
    }
    if (stage_[i] == Stage::kActs && f.to_s <= kMost_s && now >= after(f.to_s)) {
      stage_[i] = Stage::kOver;
      end(f, now);
    }
  }
}

void FaultyTwin::begin(const TwinFault& f, rt::Time now) noexcept {
  switch (f.kind) {
    case TwinFaultKind::kFall:
      return chain_.wire().slave(f.slave - 1).fall(ec::al_code::kUnspecified, now);
    case TwinFaultKind::kI2t:
      return chain_.drive(f.slave - 1)->trip_i2t(now);
    case TwinFaultKind::kStick:
      return chain_.drive(f.slave - 1)->stick_encoder(true);
    case TwinFaultKind::kLink:
      if (!link_down_) chain_.wire().slave(0).lose_link(0);
      link_down_ = true;
      return;
    case TwinFaultKind::kEmergencyStop:
      chain_.emergency_stop();
      return connect();
    default:
      return connect();
  }
}

void FaultyTwin::end(const TwinFault& f, rt::Time now) noexcept {
  switch (f.kind) {
    case TwinFaultKind::kStick:
      return chain_.drive(f.slave - 1)->stick_encoder(false);
    case TwinFaultKind::kLink:
      link_down_ = acts(TwinFaultKind::kLink);
      return;
    case TwinFaultKind::kEmergencyStop:
      if (!acts(TwinFaultKind::kEmergencyStop)) chain_.release_emergency_stop(now);
      return connect();
    default:
      return connect();
  }
}

// As far as what is cut or without power at this moment lets it.
void FaultyTwin::connect() noexcept {
  std::size_t reach = chain_.wire().size();
  if (acts(TwinFaultKind::kEmergencyStop)) reach = 1;
  for (std::size_t i = 0; i < faults_.size(); ++i)
    if (faults_[i].kind == TwinFaultKind::kCut && stage_[i] == Stage::kActs)
      reach = std::min(reach, faults_[i].slave);
  chain_.wire().cut_behind(reach);
}

bool FaultyTwin::meets(TwinFaultKind kind, rt::Time now) noexcept {
  bool met = false;
  for (const TwinFault& f : faults_) {
    if (f.kind != kind || now < after(f.from_s)) continue;
    if (f.to_s > kMost_s || now < after(f.to_s)) met = random_.uniform() < f.share || met;
  }
  return met;
}

void FaultyTwin::take(std::span<std::uint8_t> frame, rt::Time now) noexcept {
  if (frame.size() > ec::kMaxFrame || link_down_ || meets(TwinFaultKind::kSilence, now) ||
      meets(TwinFaultKind::kLoseOut, now))
    return;
  const bool lost = meets(TwinFaultKind::kLoseBack, now);
  const bool hurt = !lost && meets(TwinFaultKind::kCorrupt, now);
  if (hurt) {
    chain_.wire().pass_damaged(frame, now, {});
  } else {
    chain_.wire().pass(frame, now);
  }
  if (lost) return;
  if (meets(TwinFaultKind::kCounter, now)) ec::lower_counter(frame);
  if (hurt) ec::damage_heads(frame, random_);
  const rt::Time due = meets(TwinFaultKind::kDelay, now) ? now + kDelay : now;
  put(frame, due);
  if (meets(TwinFaultKind::kDuplicate, now)) put(frame, due);
}

void FaultyTwin::put(std::span<const std::uint8_t> frame, rt::Time due) noexcept {
  for (Waiting& w : waiting_) {
    if (w.size > 0) continue;
    std::copy(frame.begin(), frame.end(), w.bytes.begin());
    w.size = frame.size();
    w.due = due;
    return;
  }
}

std::size_t FaultyTwin::give(std::span<std::uint8_t> into, rt::Time now) noexcept {
  for (Waiting& w : waiting_) {
    if (w.size == 0 || w.due > now || w.size > into.size()) continue;
    const std::size_t n = w.size;
    std::copy_n(w.bytes.begin(), n, into.begin());
    w.size = 0;
    return n;
  }
  return 0;
}

rt::Time FaultyTwin::next(rt::Time until) const noexcept {
  rt::Time at = until;
  for (const Waiting& w : waiting_)
    if (w.size > 0) at = std::min(at, w.due);
  for (std::size_t i = 0; i < faults_.size(); ++i) {
    const TwinFault& f = faults_[i];
    if (f.share > 0) continue;
    if (stage_[i] == Stage::kWaits) at = std::min(at, after(f.from_s));
    if (stage_[i] == Stage::kActs && f.to_s <= kMost_s) at = std::min(at, after(f.to_s));
  }
  return at;
}

}  // namespace teletact
