#include "tasks/supervision/supervision_task.hpp"

#include <algorithm>
#include <stdexcept>
#include <string>

namespace tasks {

using rt::Severity;

void SupervisionConfig::describe(config::Section& s) {
  s.number("ramp_s", ramp_s, 0.01, 5.0, "time in ramp-down before hold");
  s.number("link_liveness_s", link_liveness_s, 0.02, 10.0, "silence of the link that is a fault");
  s.number("resume_within_s", resume_within_s, 0.0, 5.0,
           "silence of the link that a held engage survives; 0: none");
  s.number("peer_grace_s", peer_grace_s, 0.05, 30.0, "after engage, time for the robot to follow");
  s.number("estop_liveness_s", estop_liveness_s, 0.01, 1.0,
           "age of the e-stop input that counts as pressed");
}

SupervisionTask::SupervisionTask(rt::NonRealtime&, const SupervisionConfig& config, rt::Box box,
                                 const Watch* watches, int watch_count, const rt::ModeGate& gate)
    : config_(config), box_(box), watch_count_(watch_count), gate_(gate) {
  if (watch_count < 0 || watch_count > kMaxTasks) {
    throw std::logic_error("supervision: " + std::to_string(watch_count) +
                           " tasks to watch: allowed 0.." + std::to_string(kMaxTasks));
  }
  for (int i = 0; i < watch_count; ++i) {
    const Watch& w = watches[i];
    if (fault_row(w.silent_fault) < 0 || w.liveness.count() <= 0) {
      throw std::logic_error("supervision: watch " + std::to_string(i) +
                             " needs a fault of the table and a liveness above 0");
    }
    watches_[static_cast<std::size_t>(i)] = w;
  }
}

// ---- conditions of one tick ---------------------------------------------------------------------

void SupervisionTask::raise(Conditions& c, rt::FaultId id, Severity reported) noexcept {
  int row = fault_row(id);
  if (row < 0) row = fault_row(kFaultUnknown);
  const FaultRow& fault = kFaultTable[static_cast<std::size_t>(row)];
  const Severity severity = std::max(fault.severity, reported);
  auto& active = c.severity[static_cast<std::size_t>(row)];
  active = std::max(active, severity);
  c.worst = rt::worst(c.worst, rt::Health::of(severity, fault.id));
}

bool SupervisionTask::link_live(rt::Time now, const In& in) const noexcept {
  return in.link_heard && !in.link_closed &&
         now - in.link_last <= rt::nanos_from_seconds(config_.link_liveness_s);
}

bool SupervisionTask::all_heard(const In& in) const noexcept {
  return std::all_of(in.tasks.begin(), in.tasks.begin() + watch_count_,
                     [](const TaskReport& t) { return t.heard; });
}

void SupervisionTask::gather(rt::Time now, const In& in, Conditions& c) const noexcept {
  if (in.requests.stop) raise(c, kFaultStopRequested, Severity::kOk);
  if (in.estop_fitted) {
    const bool stale = now - in.estop_sampled > rt::nanos_from_seconds(config_.estop_liveness_s);
    if (!in.estop_closed || stale) raise(c, kFaultEstop, Severity::kOk);
  }
  if (in.watchdog_bit) raise(c, kFaultWatchdog, Severity::kOk);
  if (in.requests.ramp_down) raise(c, kFaultRampRequested, Severity::kOk);
  if (mode_ == Mode::kHold && in.requests.engage == Engage::kYes && !has_room(Mode::kEngaged))
    raise(c, kFaultNoRoom, Severity::kOk);
  for (std::size_t i = 0; i < static_cast<std::size_t>(watch_count_); ++i) {
    const TaskReport& t = in.tasks[i];
    if (!t.heard) continue;  // kInit waits for it
    if (now - t.heartbeat > watches_[i].liveness) {
      raise(c, watches_[i].silent_fault, Severity::kOk);
    } else if (t.health.severity > Severity::kOk) {
      raise(c, t.health.fault, t.health.severity);
    }
  }
  // A person's engage is held. What the robot's box knows of it comes by the link, below.
  if (box_ == rt::Box::kOperator && mode_ == Mode::kEngaged && in.requests.engage == Engage::kNo)
    raise(c, kFaultEngageWithdrawn, Severity::kOk);
  if (!in.link_expected) return;
  const bool live = link_live(now, in);
  if (in.link_refused) raise(c, kFaultLinkRefused, Severity::kOk);
  if (in.link_heard && !live) raise(c, kFaultLinkSilent, Severity::kOk);
  const bool moving = mode_ == Mode::kEngaged || mode_ == Mode::kRampDown;
  // A safe stop of the other box is one of this box, but only in motion: two boxes that each waited
  // for the other to leave its safe stop would wait for ever. The robot's box hears of no safe stop
  // of the operator's (peer_rules.hpp).
  if (live && moving && in.peer_mode == Mode::kSafeStop) {
    raise(c, kFaultPeerStopped, Severity::kOk);
  }
  if (mode_ != Mode::kEngaged) return;
  if (box_ == rt::Box::kRobot) {
    if (in.requests.engage != Engage::kYes) raise(c, kFaultEngageWithdrawn, Severity::kOk);
  } else if (live && peer_left(now, in)) {
    raise(c, kFaultPeerNotEngaged, Severity::kOk);
  }
}

// Operator box, engaged: has the robot's not followed in time, or left? If only goals were lost,
// only the robot notices the silence and reports it. This box then ramps down too, and goes on when
// the robot hears it again.
bool SupervisionTask::peer_left(rt::Time now, const In& in) const noexcept {
  if (in.peer_mode == Mode::kEngaged) return false;
  if (in.peer_pause == Pause::kSilent) return true;
  if (!peer_followed_) return now - entered_ > rt::nanos_from_seconds(config_.peer_grace_s);
  return in.peer_pause == Pause::kNone ||
         now - peer_engaged_ > rt::nanos_from_seconds(config_.resume_within_s + config_.ramp_s);
}

// A robot state that a silence has delayed may be older than this engage, so it does not answer it.
void SupervisionTask::note_peer(rt::Time now, const In& in) noexcept {
  if (mode_ != Mode::kEngaged || in.peer_mode != Mode::kEngaged) return;
  if (in.peer_mode_at > entered_) peer_followed_ = true;
  if (peer_followed_) peer_engaged_ = now;
}

void SupervisionTask::count_and_latch(const Conditions& c) noexcept {
  for (std::size_t i = 0; i < kFaultCount; ++i) {
    const bool active = c.severity[i] > Severity::kOk;
    if (active && !was_active_[i]) ++counts_[i];
    was_active_[i] = active;
    const bool held = kFaultTable[i].clear != ClearRule::kItself;
    if (held && c.severity[i] >= Severity::kRampDown) latched_[i] = true;
  }
}

// Of what is held back, a fault that only a new start of the program ends.
rt::FaultId SupervisionTask::restart_fault() const noexcept {
  for (std::size_t i = 0; i < kFaultCount; ++i) {
    if (latched_[i] && kFaultTable[i].clear == ClearRule::kRestart) return kFaultTable[i].id;
  }
  return rt::kNoFault;
}

bool SupervisionTask::link_changed(const In& in) noexcept {
  const bool changed = link_session_ != 0 && in.link_session != link_session_;
  link_session_ = in.link_session;
  return changed && in.link_expected;
}

// ---- a silence that a held engage survives ------------------------------------------------------

// The other box says that a silence has interrupted it, and still does.
bool SupervisionTask::peer_pauses(const In& in) const noexcept {
  return box_ == rt::Box::kRobot ? in.requests.engage == Engage::kPaused
                                 : in.peer_pause == Pause::kSilent;
}

// Is the silence of the link all that calls for a ramp down or more? `paused`: the other box says
// that the silence has interrupted it; then that it has left the engaged mode counts as silence.
bool SupervisionTask::silence_alone(const Conditions& c, bool paused) noexcept {
  for (std::size_t i = 0; i < kFaultCount; ++i) {
    const rt::FaultId id = kFaultTable[i].id;
    const bool of_peer = id == kFaultEngageWithdrawn || id == kFaultPeerNotEngaged;
    const bool silence = id == kFaultLinkSilent || (paused && of_peer);
    if (!silence && c.severity[i] >= Severity::kRampDown) return false;
  }
  return true;
}

// Before the mode is changed: is it such a silence still, or does one begin now?
void SupervisionTask::keep_resuming(rt::Time now, const In& in, const Conditions& c,
                                    bool changed) noexcept {
  const bool paused = peer_pauses(in);
  const bool begins = mode_ == Mode::kEngaged && c.worst.severity >= Severity::kRampDown &&
                      silence_alone(c, paused) && (paused || !link_live(now, in));
  if (begins) {
    resumes_ = true;
    quiet_from_ = in.link_last;
  }
  // During the silence the robot's box has only the last goal. Only a "no" in it is a release.
  const bool let_go = in.requests.engage == Engage::kNo;
  const rt::Nanos silence = std::max(now - in.link_last, in.link_last - quiet_from_);
  // The robot waited for the operator's box, and has given up.
  const bool given_up = cause_ == kFaultPeerNotEngaged && in.peer_pause == Pause::kNone &&
                        in.peer_mode != Mode::kEngaged;
  const bool ended = changed || in.link_closed || in.link_refused || let_go || given_up ||
                     !silence_alone(c, paused) ||
                     silence > rt::nanos_from_seconds(config_.resume_within_s);
  if (ended || (mode_ == Mode::kEngaged && !begins)) resumes_ = false;
}

bool SupervisionTask::may_resume(rt::Time now, const In& in,
                                 const rt::Health& worst) const noexcept {
  return resumes_ && in.requests.engage == Engage::kYes && in.peer_pause != Pause::kSilent &&
         may_engage(now, in, worst);
}

// ---- acts ---------------------------------------------------------------------------------------

// True in the tick in which an engage is pressed: after a "no" comes a "yes". The press may fall
// into a silence of the link. The robot's box then hears nothing, or "paused", between the "no" and
// the "yes". They still count as a press, if an engagement would have survived that silence.
bool SupervisionTask::take_engage(rt::Time now, const In& in, const Conditions& c,
                                  bool changed) noexcept {
  const bool robot = box_ == rt::Box::kRobot;
  const Engage asked = in.requests.engage;
  const bool pressed = asked == Engage::kYes && released_;
  // On a silent line the last goal stands still: its "no" is not seen again.
  const bool heard = !robot || !in.link_expected ||
                     now - in.link_last <= rt::nanos_from_seconds(config_.link_liveness_s);
  const bool survived = robot && mode_ == Mode::kHold && !in.link_closed &&
                        silence_alone(c, peer_pauses(in)) &&
                        now - released_at_ <= rt::nanos_from_seconds(config_.resume_within_s);
  if (robot && changed) {
    released_ = false;
  } else if (asked == Engage::kNo && heard) {
    released_ = true;
    released_at_ = now;
  } else if (asked == Engage::kYes || !survived) {
    released_ = false;
  }
  return pressed;
}

void SupervisionTask::take_clear(rt::Time now, const In& in) noexcept {
  Clear clear = in.requests.clear;
  // What the robot's box knows of the button is what the link last said.
  if (box_ == rt::Box::kRobot && in.link_expected && !link_live(now, in)) clear = Clear::kAbsent;
  if (clear != Clear::kYes) {
    clearing_ = clear_open_ = false;
  } else if (last_clear_ == Clear::kNo) {
    clearing_ = clear_open_ = true;
  }
  last_clear_ = clear;
}

// The operator has seen it: what is gone and asks for no restart no longer holds motion back.
void SupervisionTask::acknowledge(const Conditions& c) noexcept {
  for (std::size_t i = 0; i < kFaultCount; ++i) {
    if (kFaultTable[i].clear == ClearRule::kOperator && c.severity[i] == Severity::kOk) {
      latched_[i] = false;
    }
  }
}

bool SupervisionTask::held_back() const noexcept {
  return std::any_of(latched_.begin(), latched_.end(), [](bool l) { return l; });
}

void SupervisionTask::enter(Mode mode, rt::FaultId cause, rt::Time now) noexcept {
  mode_ = mode;
  cause_ = cause;
  entered_ = now;
}

rt::Health SupervisionTask::step(const rt::Tick& tick, const In& in, Out& out) noexcept {
  const rt::Time now = tick.start;
  Conditions c;
  // First: the engage that is gone with the old connection is no cause of its own.
  const bool changed = link_changed(in);
  if (changed) raise(c, kFaultLinkSilent, Severity::kOk);
  gather(now, in, c);
  count_and_latch(c);
  const bool engage = take_engage(now, in, c, changed);
  take_clear(now, in);
  if (clear_open_) acknowledge(c);
  keep_resuming(now, in, c, changed);

  if (c.worst.severity >= Severity::kSafeStop) {
    stop_safely(c.worst.fault, now);
    out.engage_refused = engage;
  } else {
    out.engage_refused = !change_mode(now, in, c.worst, engage) && engage;
  }
  const bool in_episode = mode_ != Mode::kInit && mode_ != Mode::kHold;
  if (in_episode) episode_ = rt::worst(episode_, c.worst);
  note_peer(now, in);

  out.now = c.worst;
  out.episode = episode_;
  out.mode.seq = ++seq_;
  out.mode.stamp = now;
  out.mode.mode = mode_;
  out.mode.cause = cause_;
  out.mode.clear = clearing_;
  out.mode.resumes = resumes_;
  return c.worst;
}

void SupervisionTask::stop_safely(rt::FaultId cause, rt::Time now) noexcept {
  // What only a new start ends is told, whatever came first or beside it: a clear would be tried in
  // vain.
  const rt::FaultId restart = restart_fault();
  if (restart != rt::kNoFault) cause = restart;
  if (mode_ == Mode::kSafeStop) {
    if (restart != rt::kNoFault) cause_ = restart;
    return;
  }
  if (mode_ != Mode::kEngaged && mode_ != Mode::kRampDown) episode_ = {};
  enter(Mode::kSafeStop, cause, now);
  clear_open_ = false;
}

// In hold: may the robot be engaged now?
bool SupervisionTask::may_engage(rt::Time now, const In& in,
                                 const rt::Health& worst) const noexcept {
  const bool peer_ok = !in.link_expected || (link_live(now, in) && in.peer_mode != Mode::kSafeStop);
  return worst.severity < Severity::kRampDown && peer_ok && !held_back() &&
         has_room(Mode::kEngaged);
}

// The next mode while nothing calls for a safe stop. False: an `engage` is not followed.
bool SupervisionTask::change_mode(rt::Time now, const In& in, const rt::Health& worst,
                                  bool engage) noexcept {
  switch (mode_) {
    case Mode::kInit:
      if (all_heard(in)) enter(Mode::kHold, rt::kNoFault, now);
      return false;
    case Mode::kHold:
      if (may_resume(now, in, worst)) return go(now);
      if (!engage || !may_engage(now, in, worst)) return false;
      episode_ = {};
      return go(now);
    case Mode::kEngaged:
      if (worst.severity >= Severity::kRampDown) enter(Mode::kRampDown, worst.fault, now);
      return true;  // it is engaged already
    case Mode::kRampDown:
      // The cause stays on show; what is still wrong keeps the next engage from being followed.
      if (now - entered_ >= rt::nanos_from_seconds(config_.ramp_s)) {
        enter(Mode::kHold, cause_, now);
      }
      return false;
    case Mode::kSafeStop:
      if (clear_open_ && !held_back()) {
        enter(Mode::kHold, rt::kNoFault, now);
        clear_open_ = false;
      }
      return false;
  }
  return true;
}

bool SupervisionTask::go(rt::Time now) noexcept {
  enter(Mode::kEngaged, rt::kNoFault, now);
  peer_followed_ = resumes_ = false;
  return true;
}

std::uint32_t SupervisionTask::count(rt::FaultId id) const noexcept {
  const int row = fault_row(id);
  return row < 0 ? 0 : counts_[static_cast<std::size_t>(row)];
}

}  // namespace tasks
