#include "tools/desk/desk_acts.hpp"

#include <algorithm>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "tools/desk/desk_words.hpp"
#include "tools/desk/intents/safe_stop.hpp"
#include "tools/host/run_options.hpp"
#include "tools/record/box_recorder.hpp"

namespace teletact {

using perception::Vec3;
using tasks::Mode;

namespace {

ConsoleAnswer done() { return {true, {}, {}}; }
ConsoleAnswer refused(std::string why) { return {false, std::move(why), {}}; }

std::string two_digits(double v) {
  char text[32];
  std::snprintf(text, sizeof text, "%.2f", v);
  return text;
}

// Why nobody may drive by what this box has seen: the page locks driving by the same limit, but
// what a page says may be wrong. Empty: the newest picture is new enough.
std::string blind_text(OperatorBox& box, rt::Time now) {
  constexpr rt::Nanos kBlind = std::chrono::seconds{1};
  const auto frame = box.graph().cells().read<tasks::EdgeId::kFrame, tasks::kConsole>();
  if (!frame) return "there is no picture of the camera yet";
  const rt::Nanos age = now - frame->exposure;
  if (age <= kBlind) return {};
  return "the newest picture is " + two_digits(rt::seconds(age)) + " s old";
}

// While keep-outs are put back some are missing: nothing sets off, and nothing comes between.
bool waits_for_opening(Act act) {
  return act == Act::kEngage || act == Act::kMark || act == Act::kGoTo || act == Act::kDraw ||
         act == Act::kErase || act == Act::kForget || act == Act::kUndo || act == Act::kAccept ||
         act == Act::kUnmark;
}

}  // namespace

std::vector<std::string_view> DeskActs::can() const {
  std::vector<std::string_view> all = {"engage", "hold",   "clear",  "stop",   "token",  "drive",
                                       "mark",   "go_to",  "cancel", "draw",   "erase",  "forget",
                                       "undo",   "note",   "select", "accept", "device", "save",
                                       "open",   "record", "unmark"};
  if (hand_ != nullptr && hand_->takes_over()) all.emplace_back("hand");
  return all;
}

DeskActs::DeskActs(OperatorBox& box, OperatorConsole& console, DeskEvents& events, PageHand* hand,
                   bool clicks_at_once, SessionPlace sessions)
    : box_(box),
      console_(console),
      events_(events),
      hand_(hand),
      objects_(box, clicks_at_once,
               [this](const tasks::SceneEdit& e, rt::Time now) { return push(e, now); }),
      sessions_(std::move(sessions), clicks_at_once) {
  console_.leave_to_page();
}

std::optional<ConsoleAnswer> DeskActs::act(const DeskItem& item, rt::Time at, rt::Time now) {
  const Intent& in = item.intent;
  if (sessions_.opening() && waits_for_opening(in.act))
    return refused("a session is being opened: in a moment");
  switch (in.act) {
    case Act::kToken:
      engage_hold_.say(in.hold_engage, at);
      touching_.hold.say(in.hold_hand, at);
      drive_hold_.say(in.hold_drive, at);
      return std::nullopt;
    case Act::kEngage:
      return engage(item, at, now);
    case Act::kHold:
      engage_wanted_ = false;
      return done();
    case Act::kClear:
      return clear(item, now);
    case Act::kMark:
      return mark(in, now);
    case Act::kUnmark:
      return unmark(in.mark_id, now);
    case Act::kGoTo:
      return go_to(in, now);
    case Act::kCancel:
      return cancel(now);
    case Act::kDraw:
      return draw(in.obstacle, now, true);
    case Act::kErase:
      return erase(in.obstacle_id, now, true);
    case Act::kForget:
      return forget(in, now);
    case Act::kUndo:
      return undo(now);
    case Act::kDevice:
      return device(in, now);
    case Act::kSelect:
      return objects_.select(item, now);
    case Act::kAccept:
      return objects_.accept(item, console_.seen(), now);
    case Act::kRecord:
      return record(in.on, now);
    case Act::kSave:
      return sessions_.save(item, to_save());
    case Act::kOpen:
      return sessions_.open(item);
    case Act::kNote:
      events_.add(now, "note", in.text);
      return done();
    default:  // drive and hand, which do not come here
      return refused(std::string(name_of(in.act)) + " is not built into this version");
  }
}

ConsoleAnswer DeskActs::record(bool on, rt::Time now) {
  if (on == recording()) return refused(on ? "a piece has begun already" : "no piece has begun");
  const double at_s = events_.seconds_at(now);
  std::string text;
  if (on) {
    piece_.from_s = at_s;
    text = "piece " + std::to_string(++piece_.begun) + " begins";
  } else {
    const double from_s = *piece_.from_s;
    piece_.from_s.reset();
    text = "piece " + std::to_string(piece_.begun) + " ends: teletact report --from " +
           two_digits(from_s) + " --to " + two_digits(at_s);
  }
  events_.add(now, "record", text);
  return {true, {}, nlohmann::json{{"text", text}}.dump()};
}

// ---- engage, clear, stop ------------------------------------------------------------------------

// What the robot's box says of itself; of one that has fallen silent nothing is known any more. Its
// age is that of the message: the motors' measurement in it stays old until a clear.
drivers::RobotState DeskActs::heard_robot(rt::Time now) const {
  constexpr rt::Nanos kSilent = std::chrono::milliseconds{500};
  const drivers::RobotState& newest = console_.seen().robot;
  return newest.seq != 0 && now - newest.made <= kSilent ? newest : drivers::RobotState{};
}

// Empty: it has been heard, or never was.
std::string DeskActs::silence_refusal(rt::Time now) const {
  if (console_.seen().robot.seq == 0 || heard_robot(now).seq != 0) return {};
  return "nothing comes from the robot's box" + fault_advice(tasks::kFaultLinkSilent);
}

std::optional<ConsoleAnswer> DeskActs::engage(const DeskItem& item, rt::Time at, rt::Time now) {
  engage_hold_.say(true, at);
  if (!engage_hold_.held(now)) return refused("let go first, then press again");
  const tasks::ModeMsg& mode = console_.seen().mode;
  switch (mode.mode) {
    case Mode::kEngaged:
      if (engage_wanted_) return done();
      return refused("already engaged, but not from this page: go to hold first");
    case Mode::kInit:
      return refused("not all tasks have been heard yet: in a moment");
    case Mode::kRampDown:
      return refused("ramping down: press again when it holds");
    case Mode::kSafeStop:
    case Mode::kHold:
      // In a safe stop the robot's box follows no engage, whatever this box's mode came from.
      if (const std::string why = safe_stop_refusal(mode, heard_robot(now)); !why.empty())
        return refused(why);
      if (const std::string why = silence_refusal(now); !why.empty()) return refused(why);
      break;
  }
  if (waiting_) return refused("asked already");
  engage_wanted_ = true;
  engaged_seen_ = false;
  waiting_ = Waiting{item.session, item.id, now};
  console_.count(&OperatorView::engages);
  return std::nullopt;
}

void DeskActs::keep_engage(rt::Time now, const Answer& answer) {
  constexpr rt::Nanos kPatience = std::chrono::milliseconds{1500};
  const tasks::ModeMsg& mode = console_.seen().mode;
  const bool engaged = mode.mode == Mode::kEngaged;
  if (engage_wanted_ && !engage_hold_.held(now)) {
    engage_wanted_ = false;
    events_.add(now, "hold",
                engage_hold_.lost() ? "the page no longer says that it holds: engagement ends"
                                    : "let go: engagement ends");
  }
  engaged_seen_ = engaged_seen_ || (engage_wanted_ && engaged);
  // Ended by a fault: what is still pressed does not engage again.
  if (engage_wanted_ && engaged_seen_ && !engaged && !mode.resumes) engage_wanted_ = false;
  if (waiting_) {
    const bool late = now - waiting_->since > kPatience;
    if (engaged || late || !engage_wanted_) {
      const std::string there =
          mode.mode == Mode::kSafeStop ? "" : safe_stop_refusal(mode, heard_robot(now));
      const std::string why =
          !there.empty() ? there
          : mode.cause != rt::kNoFault
              ? cause_text(mode.cause, console_.seen().robot) + fault_advice(mode.cause)
          : late ? std::string("supervision did not follow: is the robot's box there?")
                 : std::string("it was let go");
      answer(waiting_->session, waiting_->id, engaged ? done() : refused(why));
      if (!engaged) engage_wanted_ = false;
      waiting_.reset();
    }
  }
  using Engage = tasks::SupervisionTask::Engage;
  box_.graph().requests().engage.store(
      static_cast<int>(engage_wanted_ ? Engage::kYes : Engage::kNo));
}

std::optional<ConsoleAnswer> DeskActs::clear(const DeskItem& item, rt::Time now) {
  const auto& seen = console_.seen();
  // Whether a silent box is in a safe stop is not known.
  if (const std::string why = silence_refusal(now);
      !why.empty() && seen.mode.mode != Mode::kSafeStop)
    return refused(why);
  if (const std::string why = clear_refusal(seen.mode, heard_robot(now)); !why.empty())
    return refused(why);
  if (clear_waits_) return refused("asked already");
  clear_from_ = now;
  box_.graph().requests().clear.store(true);
  clear_waits_ = Waiting{item.session, item.id, now};
  return std::nullopt;
}

// Pressed for so long: the robot's motors and encoders need time to let go. Answered when both
// boxes have been out of their safe stop for a while: a cause that lasts puts them back at once.
void DeskActs::keep_clear(rt::Time now, const Answer& answer) {
  using std::chrono::milliseconds;
  constexpr rt::Nanos kPress = milliseconds{500}, kOut = milliseconds{300},
                      kPatience = milliseconds{2000};
  auto& button = box_.graph().requests().clear;
  if (button.load() && now - clear_from_ >= kPress) button.store(false);
  if (!clear_waits_) return;
  const auto& seen = console_.seen();
  const std::string still = still_stopped(seen.mode, heard_robot(now));
  if (!still.empty()) clear_out_.reset();
  if (still.empty() && !clear_out_) clear_out_ = now;
  const bool cleared = clear_out_ && now - *clear_out_ >= kOut;
  if (!cleared && now - clear_waits_->since <= kPatience) return;
  if (cleared) {
    console_.count(&OperatorView::clears);
    events_.add(now, "clear", "safe stop cleared by the operator");
  }
  answer(clear_waits_->session, clear_waits_->id,
         cleared ? done() : refused(still.empty() ? "it lasts no longer than a moment" : still));
  clear_waits_.reset();
  clear_out_.reset();
}

void DeskActs::stop() noexcept {
  // Counted first: keep_stop(), which may just take back the request of an earlier stop, then sees
  // this one and asks again.
  stops_.fetch_add(1);
  box_.graph().requests().ramp_down.store(true);
}

// The request stays until it was followed, and so long that every task has latched it. A program
// that is to end keeps it.
void DeskActs::keep_stop(rt::Time now) {
  constexpr rt::Nanos kLeast = std::chrono::milliseconds{300}, kMost = std::chrono::seconds{2};
  if (const std::uint64_t stops = stops_.load(); stops != stops_seen_) {
    stops_seen_ = stops;
    box_.graph().requests().ramp_down.store(true);
    stop_from_ = now;
    engage_wanted_ = false;
    drive_hold_.lose();
    touching_.hold.lose();
    steps_.stop = true;
    events_.add(now, "stop", "stop pressed");
  }
  if (stop_from_ == rt::Time{}) return;
  const bool followed = console_.seen().mode.mode != Mode::kEngaged && now - stop_from_ >= kLeast;
  if (!followed && now - stop_from_ < kMost) return;
  stop_from_ = rt::Time{};
  if (!g_stop_requested.load()) box_.graph().requests().ramp_down.store(false);
}

// ---- driving by hand ----------------------------------------------------------------------------

std::string DeskActs::drive(const Intent& intent, rt::Time at, rt::Time now) {
  if (console_.seen().mode.mode != Mode::kEngaged) return "not engaged";
  if (!drive_hold_.held(now))
    return drive_hold_.lost() ? "let go first, then press again" : "nothing is held";
  if (const std::string why = blind_text(box_, now); !why.empty()) {
    drive_hold_.lose();
    if (driving_) events_.add(now, "drive", why);
    return why;
  }
  drive_ = intent;
  drive_at_ = at;
  return {};
}

// A page that stands still sends neither tokens nor where to: either may be the first to be too
// old.
std::string DeskActs::drive_ended() const {
  if (drive_hold_.lost()) return "no longer held by the page";
  if (console_.seen().mode.mode != Mode::kEngaged) return "no longer engaged";
  return drive_hold_.free() ? "let go" : "no longer held by the page";
}

void DeskActs::keep_drive(rt::Time now) {
  using Phase = tasks::TaskState::Phase;
  const auto& seen = console_.seen();
  bool held =
      drive_hold_.held(now) && seen.mode.mode == Mode::kEngaged && now - drive_at_ <= Hold::kLife;
  if (held && drive_press_ != drive_hold_.presses()) {
    const bool goal = seen.task.phase == Phase::kDriving || seen.task.phase == Phase::kPlanning;
    held = !goal || push(tasks::OperatorAct{}, now);
    if (held) drive_press_ = drive_hold_.presses();
  }
  if (!held && !driving_) return;
  if (held != driving_)
    events_.add(now, "drive", held ? "driven by hand" : drive_ended() + ": the base halts");
  driving_ = held;
  tasks::DriveIntent out;
  out.seq = ++drive_seq_;
  out.stamp = held ? std::min(drive_hold_.said(), drive_at_) : now;
  out.held = held;
  if (held) out.vx = drive_.vx, out.vy = drive_.vy, out.wz = drive_.wz;
  box_.graph().drive(out, now);
}

// A person who sees more than the map may have reasons to drive there: told, not stopped.
void DeskActs::watch_keep_outs(rt::Time now) {
  const auto base_W = base_in_world(console_.seen());
  if (!driving_ || !base_W) {
    keep_out_.clear();
    return;
  }
  const bool fresh = keep_out_.look(obstacles_, *base_W, {drive_.vx, drive_.vy, drive_.wz},
                                    box_.graph().config().planning.robot_radius_m);
  if (fresh) events_.add(now, "keep-out", keep_out_.text());
}

// ---- the hand -----------------------------------------------------------------------------------

std::string DeskActs::hand(const Intent& intent, rt::Time now) {
  if (hand_ == nullptr || !hand_->takes_over()) return "a haptic device is in its place";
  if (!touching_.hold.held(now))
    return touching_.hold.lost() ? "let go first, then press again" : "nothing is held";
  touching_.wanted = intent;
  touching_.press = touching_.hold.presses();
  return {};
}

// Pressed, it wants to be a little below the surface that the page points at, else a little above.
void DeskActs::keep_hand(rt::Time now) {
  constexpr double kBelow_m = 0.008, kAbove_m = 0.03;
  if (hand_ == nullptr) return;
  Hold& hold = touching_.hold;
  const bool held = hold.held(now) && touching_.press == hold.presses();
  if (!held && !touching_.on) return;
  touching_.on = held;
  PageHand::Target target;
  if (held) {
    const Intent& in = touching_.wanted;
    const double length = in.normal_W.norm();
    const perception::Vec3 up =
        length > 0.5 ? perception::Vec3(in.normal_W / length) : perception::Vec3::UnitZ();
    target = {true, in.p_W + (in.press ? -kBelow_m : kAbove_m) * up, in.button, in.clutch,
              hold.said() + Hold::kLife};
  }
  hand_->want(target, now);
}

ConsoleAnswer DeskActs::device(const Intent& in, rt::Time now) {
  if (hand_ == nullptr) return refused("the page has no hold of the device in this run");
  if (!in.scale_given && !in.yaw_given && !in.clutch_given)
    return refused("nothing is asked of the device");
  // What a press of the clutch means then is said in page_hand.hpp.
  const auto& samples = console_.seen().haptic;
  const bool forces =
      !samples.empty() &&
      samples.back().device_state == static_cast<std::uint8_t>(drivers::DeviceState::kForce);
  const bool lets_go = in.clutch_given && !in.clutch && !in.scale_given && !in.yaw_given;
  if (!forces && !lets_go)
    return refused("the device's forces are off: press and release its own clutch first");
  const double most = box_.graph().config().haptic.scale;
  PageHand::Mapping mapping{device_share_, std::nullopt};
  // The page shows rounded figures: what it shows as the most is the most.
  constexpr double kRounded = 1.001;
  if (in.scale_given)
    mapping.share = in.scale > most * kRounded ? in.scale / most : std::min(1.0, in.scale / most);
  if (in.yaw_given) mapping.yaw_W_rad = in.yaw_rad;
  if ((in.scale_given || in.yaw_given) && !hand_->map(mapping, now)) {
    char text[96];
    std::snprintf(text, sizeof text, "the scale may be %.2f to %.2f in this scene (haptic.scale)",
                  PageHand::kLeastShare * most, most);
    return refused(text);
  }
  device_share_ = mapping.share;
  if (in.scale_given) events_.add(now, "device", "scale " + two_digits(in.scale));
  if (in.yaw_given) events_.add(now, "device", "turned to the page's view");
  if (!in.clutch_given) return done();
  hand_->hold_clutch(in.clutch);
  events_.add(now, "device", in.clutch ? "clutch held" : "clutch let go");
  return done();
}

double DeskActs::device_scale() const {
  return box_.graph().config().haptic.scale * (hand_ == nullptr ? 1.0 : hand_->share());
}

void DeskActs::left() {
  if (hand_ != nullptr) hand_->hold_clutch(false);
  for (Hold* h : {&engage_hold_, &touching_.hold, &drive_hold_}) h->lose();
  objects_.forget();
}
void DeskActs::joined() {
  for (Hold* h : {&engage_hold_, &touching_.hold, &drive_hold_}) h->renew();
}

void DeskActs::keep(rt::Time now, const Answer& answer) {
  const auto& seen = console_.seen();
  keep_stop(now);
  keep_engage(now, answer);
  keep_drive(now);
  watch_keep_outs(now);
  keep_hand(now);
  keep_clear(now, answer);
  keep_objects(now, answer);
  keep_sessions(now, answer);
  steps_.touch = steps_.touch || (!seen.haptic.empty() && seen.haptic.back().in_contact);
  steps_.mark = steps_.mark || seen.task.marks > goals_.asked;  // one of the hand
  steps_.object = steps_.object || seen.objects_named > 0;
}

}  // namespace teletact
