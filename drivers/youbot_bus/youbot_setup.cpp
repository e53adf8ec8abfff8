#include "drivers/youbot_bus/youbot_setup.hpp"

#include <array>
#include <cmath>
#include <cstdio>
#include <limits>
#include <numbers>

#include "drivers/tmcl/motor_faults.hpp"
#include "drivers/tmcl/youbot_parameters.hpp"
#include "drivers/youbot/motor_flags.hpp"

namespace drivers::youbot_bus {

namespace {

namespace axis = tmcl::axis;

constexpr double kWheelGear = 9405.0 / 364.0, kTicksPerTurn = 4000;
constexpr int kStandRpm = 5, kStandCycles = 10;  // at the stop
constexpr int kFindCycles = 5000;                // of the commutation
constexpr int kHomeCycles = 75000;               // the longest travel, 338 degrees, and a third
constexpr int kSettleCycles = 100;
constexpr int kRampCycles = 200;  // of a start, whose current is no stop's

// Source: youbot_driver, config/youbot-manipulator.cfg, by joint.
constexpr std::array<JointFacts, 5> kJoints{{{156, -580000, -1000, 2000, -1},
                                             {156, -260000, -1000, 500, -1},
                                             {100, -320000, -1000, 1000, 1},
                                             {71, -155000, -1000, 500, -1},
                                             {71, -255000, -5000, 500, -1}}};

bool has(const DriveInputs& in, std::uint32_t flag) noexcept { return (in.flags & flag) != 0; }

tmcl::Request calibrated(tmcl::Command c, std::int32_t value) {
  return {0, static_cast<std::uint8_t>(c), tmcl::global::kCalibrated, tmcl::global::kUserBank,
          value};
}

void hold(DriveSession& s, std::size_t i) {
  s.set(i, {s.inputs(i).position_ticks, ControllerMode::kPosition});
}

// Wheels off, joints where they are.
void rest(DriveSession& s) {
  s.stop_all();
  for (const std::size_t i : s.drives())
    if (s.boards()[i].kind == BoardKind::kJoint && has(s.inputs(i), motor_flag::kInitialised))
      hold(s, i);
}

rt::Error stopped(DriveSession& s, const std::string& why) {
  const std::string bus = s.failed();
  rest(s);
  (void)s.cycle();
  return rt::Error{bus.empty() ? why : bus};
}

// The first firmware's inputs end at flag 15, so axis parameter 156 has its timeout and I2t. One
// that refuses to tell has no such flags.
rt::Result<std::uint32_t> flags_of(DriveSession& s, std::size_t i, const DriveInputs& in) {
  if (s.input_bytes(i) != kNarrowInputBytes) return in.flags;
  const auto all = s.ask(
      i, {0, static_cast<std::uint8_t>(tmcl::Command::kGetAxisParameter), axis::kFlags, 0, 0}, 3);
  if (all) return in.flags | static_cast<std::uint32_t>(all.value());
  if (!s.failed().empty()) return rt::Error{all.error()};
  return in.flags;
}

// "under-voltage, hall sensor error"; empty: none.
std::string faults_text(std::uint32_t flags) {
  std::string text;
  const tmcl::MotorFaults faults = tmcl::faults_of(flags);
  for (int k = 0; k < faults.count; ++k)
    text +=
        (text.empty() ? "" : ", ") + std::string(faults.entry[static_cast<std::size_t>(k)]->name);
  if ((flags & motor_flag::kI2tExceeded) != 0) text += ": let it cool down, teletact youbot setup";
  return text;
}

// What a board tells of itself, and what it does not.
class Look {
 public:
  Look(DriveSession& s, std::size_t i) : s_(s), i_(i) {}
  // The value of a parameter; `missing`: it was not told.
  std::int32_t parameter(std::uint8_t number, const char* name, std::int32_t missing) {
    const auto v = s_.get(i_, number);
    if (v) return v.value();
    miss(std::string(name) + " (axis parameter " + std::to_string(number) + ")", v.error());
    return missing;
  }
  bool is_homed() {
    const auto v = s_.ask(i_, calibrated(tmcl::Command::kGetGlobal, 0));
    if (!v) miss("whether it is homed (user variable 16)", v.error());
    return v && v.value() == 1;
  }
  tmcl::Firmware firmware() {
    const auto v = s_.firmware(i_);
    if (!v) miss("firmware", v.error());
    return v ? v.value() : tmcl::Firmware{};
  }
  std::uint32_t flags(const DriveInputs& in) {
    const auto v = flags_of(s_, i_, in);
    return v ? v.value() : in.flags;
  }
  [[nodiscard]] const std::string& missed() const { return missed_; }

 private:
  // Of a mailbox that is dead one line, whatever was asked.
  void miss(const std::string& what, const std::string& error) {
    const std::string name = s_.name(i_) + ": ";
    const std::string why = error.starts_with(name) ? error.substr(name.size()) : error;
    if (s_.is_silent(i_))
      missed_ = "its mailbox has been silent for 5 s";
    else
      missed_ += (missed_.empty() ? "does not tell its " : "; nor its ") + what + ": " + why;
  }
  DriveSession& s_;
  std::size_t i_;
  std::string missed_;
};

DriveReport look(DriveSession& s, std::size_t i) {
  DriveReport r;
  r.position = i;
  r.name = s.name(i);
  Look board(s, i);
  r.firmware = board.firmware();
  constexpr std::int32_t kUntold = -1;
  const auto volts = board.parameter(axis::kSupplyVoltage, "supply voltage", kUntold);
  const auto adc = board.parameter(axis::kTemperature, "temperature", kUntold);
  const auto found = board.parameter(axis::kInitialised, "commutation", kUntold);
  r.max_current_mA = board.parameter(axis::kMaxCurrent, "greatest current", kUntold);
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  r.supply_V = volts == kUntold ? kNone : 0.01 * volts;
  r.temperature_C = adc == kUntold ? kNone : tmcl::driver_temperature_C(adc);
  const DriveInputs in = s.inputs(i);
  r.flags = board.flags(in);
  r.position_ticks = in.position_ticks;
  r.current_mA = in.current_mA;
  // Flag 15 of the process data is the same, where the mailbox does not tell.
  r.commutated = found == kUntold ? has(in, motor_flag::kInitialised) : found == 1;
  std::string homing;
  if (s.boards()[i].kind == BoardKind::kJoint) {
    r.homed = board.is_homed();
    if (!r.homed && !s.is_silent(i)) homing = "not homed: teletact youbot setup";
  }
  // Homing follows the commutation.
  const std::string next = r.commutated ? homing : "no commutation: teletact youbot setup";
  r.wrong = board.missed();
  for (const std::string& more : {faults_text(r.flags), next})
    if (!more.empty()) r.wrong += (r.wrong.empty() ? "" : "; ") + more;
  return r;
}

rt::Error too_fast(const BoardPlace& b, double rad_per_s) {
  std::array<char, 96> text{};
  std::snprintf(text.data(), text.size(), ": %.3g rad/s is beyond its limit of %.3g rad/s",
                rad_per_s, most_jog_rad_per_s(b));
  return {b.name() + text.data()};
}

}  // namespace

const JointFacts& joint_facts(int number) noexcept {
  return kJoints[static_cast<std::size_t>(number - 1)];
}

double most_jog_rad_per_s(const BoardPlace& b) noexcept {
  constexpr double kWheelMost = 3;
  return b.kind == BoardKind::kJoint ? joint_facts(b.number).most_rad_per_s : kWheelMost;
}

double gear_of(const BoardPlace& b) noexcept {
  return b.kind == BoardKind::kJoint ? joint_facts(b.number).gear : kWheelGear;
}

rt::Result<std::vector<DriveReport>> check(DriveSession& s) {
  std::vector<DriveReport> out;
  for (const std::size_t i : s.drives()) {
    out.push_back(look(s, i));
    if (!s.failed().empty()) return rt::Error{s.failed()};
  }
  return out;
}

rt::Result<bool> clear_timeouts(DriveSession& s) {
  // All of them, though one does not take it.
  std::string first;
  for (const std::size_t i : s.drives()) {
    const auto done = s.put(i, axis::kClearTimeout, 1);
    if (!s.failed().empty()) return rt::Error{s.failed()};
    if (!done && first.empty()) first = done.error();
  }
  if (!first.empty()) return rt::Error{first};
  return true;
}

rt::Result<int> clear_i2t(DriveSession& s) {
  int cleared = 0;
  for (const std::size_t i : s.drives()) {
    const auto before = flags_of(s, i, s.inputs(i));
    if (!before) return rt::Error{before.error()};
    if ((before.value() & motor_flag::kI2tExceeded) == 0) continue;
    // Refused while the winding is hot, and by a firmware that knows no such clear.
    (void)s.put(i, axis::kClearI2t, 0);
    if (!s.failed().empty() || !s.cycle()) return rt::Error{s.failed()};
    const auto after = flags_of(s, i, s.inputs(i));
    if (!after) return rt::Error{after.error()};
    cleared += (after.value() & motor_flag::kI2tExceeded) == 0 ? 1 : 0;
  }
  return cleared;
}

rt::Result<std::string> above_current(DriveSession& s, std::int32_t most_mA) {
  for (const std::size_t i : s.drives()) {
    const auto has = s.get(i, axis::kMaxCurrent);
    if (!has) return rt::Error{has.error()};
    if (has.value() > most_mA)
      return s.name(i) + " may take " + std::to_string(has.value()) + " mA (axis parameter 6)";
  }
  return std::string{};
}

rt::Result<bool> commutate(DriveSession& s, const Progress& say) {
  if (const auto done = clear_timeouts(s); !done) return done;
  std::vector<std::size_t> without;
  for (const std::size_t i : s.drives()) {
    const auto found = s.get(i, axis::kInitialised);
    if (!found) return rt::Error{found.error()};
    if (found.value() == 1) continue;
    const auto firmware = s.firmware(i);
    if (!firmware) return rt::Error{firmware.error()};
    const bool slow = firmware.value().version >= 200;
    s.set(i, slow ? DriveOutputs{100, ControllerMode::kVelocity}
                  : DriveOutputs{0, ControllerMode::kInitialise});
    without.push_back(i);
  }
  const bool all = without.empty() || s.cycle_until(kFindCycles, [&] {
    std::size_t found = 0;
    for (const std::size_t i : without) {
      if (!has(s.inputs(i), motor_flag::kInitialised)) continue;
      // A wheel turns no further than it has to; a joint has no brake.
      if (s.boards()[i].kind != BoardKind::kJoint)
        s.set(i, {});
      else if (s.command(i).mode != ControllerMode::kPosition)
        hold(s, i);
      ++found;
    }
    return found == without.size();
  });
  rest(s);
  if (!all) {
    for (const std::size_t i : without)
      if (!has(s.inputs(i), motor_flag::kInitialised))
        return stopped(s, s.name(i) + ": commutation not found within 5 s");
    return stopped(s, "commutation not found");
  }
  for (int i = 0; i < 10; ++i) (void)s.cycle();
  say(std::to_string(without.size()) + " of " + std::to_string(s.drives().size()) +
      " drives have found their commutation, the others knew it");
  return true;
}

rt::Result<bool> home_arm(DriveSession& s, int arm, const Progress& say,
                          std::vector<HomedJoint>* measured) {
  const auto joints = s.joints(arm);
  if (joints.empty()) return rt::Error{"there is no arm " + std::to_string(arm)};
  std::array<int, 5> stands{};
  std::array<bool, 5> there{};
  std::array<HomedJoint, 5> found{};
  for (std::size_t j = 0; j < joints.size(); ++j)
    s.set(joints[j], {static_cast<std::int32_t>(kJoints[j].gear), ControllerMode::kVelocity});
  int cycles = 0;
  const bool all = s.cycle_until(kHomeCycles, [&] {
    ++cycles;
    std::size_t n = 0;
    for (std::size_t j = 0; j < joints.size(); ++j) {
      const DriveInputs in = s.inputs(joints[j]);
      const bool pushes = std::abs(in.current_mA) > kJoints[j].homing_mA &&
                          std::abs(in.velocity_rpm) < kStandRpm && cycles > kRampCycles;
      stands[j] = pushes ? stands[j] + 1 : 0;
      if (!there[j] && stands[j] >= kStandCycles) {
        there[j] = true;
        found[j] = {arm, static_cast<int>(j) + 1, 0, in.current_mA > 0 ? 1 : -1, in.current_mA};
        s.set(joints[j], {0, ControllerMode::kCurrent});
        say(s.name(joints[j]) + " has its stop");
      }
      n += there[j] ? 1 : 0;
    }
    return n == joints.size();
  });
  if (!all) {
    std::string missing;
    for (std::size_t j = 0; j < joints.size(); ++j)
      if (!there[j]) missing += (missing.empty() ? "" : ", ") + s.name(joints[j]);
    return stopped(s, "homing: no stop found by " + missing);
  }
  for (int i = 0; i < kSettleCycles; ++i)
    if (!s.cycle()) return stopped(s, "");
  for (std::size_t j = 0; j < joints.size(); ++j) {
    const std::size_t i = joints[j];
    found[j].offset_ticks = s.inputs(i).position_ticks;
    if (const auto done = s.put(i, axis::kActualPosition, 0); !done) return done;
    if (const auto done = s.ask(i, calibrated(tmcl::Command::kSetGlobal, 1)); !done)
      return rt::Error{done.error()};
  }
  if (!s.cycle()) return stopped(s, "");
  if (measured != nullptr) measured->insert(measured->end(), found.begin(), found.end());
  for (const std::size_t i : joints) hold(s, i);
  return s.cycle() ? rt::Result<bool>(true) : rt::Result<bool>(stopped(s, ""));
}

rt::Result<bool> jog(DriveSession& s, std::size_t i, double rad_per_s, double seconds) {
  const BoardPlace& b = s.boards()[i];
  const int sign = b.kind == BoardKind::kJoint ? joint_facts(b.number).sign : 1;
  const double rpm = sign * rad_per_s * 60 / (2 * std::numbers::pi) * gear_of(b);
  if (!(std::abs(rad_per_s) <= most_jog_rad_per_s(b))) return too_fast(b, rad_per_s);
  const auto setpoint = static_cast<std::int32_t>(std::lround(rpm));
  double brake_ticks = 0;
  if (b.kind == BoardKind::kJoint) {
    const auto homed = s.ask(i, calibrated(tmcl::Command::kGetGlobal, 0));
    if (!homed) return rt::Error{homed.error()};
    if (homed.value() != 1)
      return rt::Error{b.name() +
                       " is not homed: its limits are not known (teletact youbot setup)"};
    const auto rpm_per_s = s.get(i, axis::kAcceleration);
    if (!rpm_per_s) return rt::Error{rpm_per_s.error()};
    if (rpm_per_s.value() <= 0)
      return rt::Error{b.name() +
                       ": its acceleration (parameter 11) is 0, so it can not be braked"};
    brake_ticks = rpm * rpm / (2.0 * rpm_per_s.value()) / 60 * kTicksPerTurn;
  }
  bool at_limit = false;
  rest(s);
  s.set(i, {setpoint, ControllerMode::kVelocity});
  // By time: cycles may come late.
  const auto cycles = static_cast<int>(seconds * 1000);
  const rt::Time end = s.now() + rt::Nanos{static_cast<std::int64_t>(seconds * 1e9)};
  const bool ended = s.cycle_until(cycles, [&] {
    if (s.now() >= end) return true;
    if (b.kind != BoardKind::kJoint) return false;
    // It is stopped where its brake still ends within the limit.
    const JointFacts& f = joint_facts(b.number);
    const double at = s.inputs(i).position_ticks;
    at_limit = setpoint > 0 ? at + brake_ticks >= f.high_ticks : at - brake_ticks <= f.low_ticks;
    return at_limit;
  });
  if (!ended && !s.failed().empty()) return stopped(s, "");
  // A joint brakes by its speed loop, then holds: without torque it would sink.
  s.set(i,
        b.kind == BoardKind::kJoint ? DriveOutputs{0, ControllerMode::kVelocity} : DriveOutputs{});
  for (int k = 0; k < kSettleCycles; ++k) (void)s.cycle();
  rest(s);
  if (!s.cycle()) return stopped(s, "");
  if (at_limit) return rt::Error{b.name() + " has reached its limit"};
  return true;
}

}  // namespace drivers::youbot_bus
