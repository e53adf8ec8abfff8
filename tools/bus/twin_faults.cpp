#include "tools/bus/twin_faults.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <optional>
#include <stdexcept>

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
    FaultName{"estop", TwinFaultKind::kEmergencyStop, FaultValue::kNone}};

[[noreturn]] void refuse_fault(const std::string& text, const std::string& why) {
  throw std::runtime_error("--fault " + text + ": " + why);
}

const FaultName& name_of(TwinFaultKind kind) {
  return *std::find_if(kFaultNames.begin(), kFaultNames.end(),
                       [kind](const FaultName& n) { return n.kind == kind; });
}

std::optional<double> number_of(const std::string& s) {
  double v = 0;
  const auto [end, wrong] = std::from_chars(s.data(), s.data() + s.size(), v);
  if (wrong != std::errc{} || end != s.data() + s.size() || !std::isfinite(v)) return std::nullopt;
  return v;
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
    refuse_fault(text,
                 "not one of lose-out, lose-back, duplicate, delay, corrupt, counter (:SHARE of "
                 "frames), cut, fall, i2t, stick (:SLAVE), estop; each with @SECONDS");
  TwinFault out;
  out.kind = known->kind;
  if (at != std::string::npos) {
    const auto s = number_of(text.substr(at + 1));
    if (!s || *s < 0 || *s > 1e6) refuse_fault(text, "seconds are 0 to 1000000");
    out.from_s = *s;
  }
  if (known->value == FaultValue::kNone) {
    if (colon != std::string::npos) refuse_fault(text, "takes no value");
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
    : chain_(chain), faults_(std::move(faults)), done_(faults_.size()) {
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

rt::Time FaultyTwin::begin_of(const TwinFault& f) const noexcept {
  return begin_ + rt::Nanos{static_cast<std::int64_t>(1e9 * f.from_s)};
}

void FaultyTwin::act(rt::Time now) noexcept {
  for (std::size_t i = 0; i < faults_.size(); ++i) {
    const TwinFault& f = faults_[i];
    if (done_[i] || f.share > 0 || now < begin_of(f)) continue;
    done_[i] = true;
    switch (f.kind) {
      case TwinFaultKind::kCut:
        chain_.wire().cut_behind(f.slave);
        break;
      case TwinFaultKind::kFall:
        chain_.wire().slave(f.slave - 1).fall(ec::al_code::kUnspecified, now);
        break;
      case TwinFaultKind::kI2t:
        chain_.drive(f.slave - 1)->trip_i2t(now);
        break;
      case TwinFaultKind::kStick:
        chain_.drive(f.slave - 1)->stick_encoder(true);
        break;
      default:
        chain_.emergency_stop();
    }
  }
}

bool FaultyTwin::meets(TwinFaultKind kind, rt::Time now) noexcept {
  bool met = false;
  for (const TwinFault& f : faults_)
    if (f.kind == kind && now >= begin_of(f)) met = random_.uniform() < f.share || met;
  return met;
}

void FaultyTwin::take(std::span<std::uint8_t> frame, rt::Time now) noexcept {
  if (frame.size() > ec::kMaxFrame || meets(TwinFaultKind::kLoseOut, now)) return;
  chain_.wire().pass(frame, now);
  if (meets(TwinFaultKind::kLoseBack, now)) return;
  if (meets(TwinFaultKind::kCounter, now)) ec::lower_counter(frame);
  if (meets(TwinFaultKind::kCorrupt, now)) ec::damage_heads(frame, random_);
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
  for (std::size_t i = 0; i < faults_.size(); ++i)
    if (!done_[i] && faults_[i].share <= 0) at = std::min(at, begin_of(faults_[i]));
  return at;
}

}  // namespace teletact
