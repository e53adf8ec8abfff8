#include "tools/bus/youbot_command.hpp"

#include <array>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <optional>
#include <thread>

#include "drivers/youbot_bus/chain_wait.hpp"
#include "drivers/youbot_bus/ethercat_youbot.hpp"
#include "drivers/youbot_bus/gripper_setup.hpp"
#include "drivers/youbot_bus/youbot_setup.hpp"
#include "tools/files/today.hpp"
#include "tools/files/whole_file.hpp"

namespace teletact {

namespace yb = drivers::youbot_bus;

namespace {

constexpr const char* kWord = "move";

// The chain in OP, its timeout flags cleared. Nothing is told to move.
struct Robot {
  explicit Robot(const YoubotOptions& o) : bus(choice(o)) {
    if (!o.bus.iface.empty())
      std::printf("Drives that still hold an arm let it go now: support it.\n");
    const std::string chain = o.expect.empty() ? "any" : o.expect;
    if (o.wait_s > 0) wait(chain, o.wait_s);
    const auto there = yb::bring_up(bus.token(), bus.master(), chain);
    if (!there) throw CouldNotDo(there.error());
    kind = there.value();
    session.emplace(bus.token(), bus.master(), bus.port(), kind);
    std::printf("youBot %s: %zu slaves\n", yb::to_text(kind), session->boards().size());
    // A board that does not take it is named in the table.
    (void)yb::clear_timeouts(*session);
    if (!session->failed().empty()) throw CouldNotDo(session->failed());
  }
  static EtherCatChoice choice(const YoubotOptions& o) {
    EtherCatChoice c = o.bus;
    c.end_stops = true;
    return c;
  }
  void wait(const std::string& chain, double seconds) {
    const rt::Time end = bus.port().now() + rt::nanos_from_seconds(seconds);
    std::string told;
    require(yb::await_chain(bus.token(), bus.port(), chain, [&](const std::string& missing) {
      if (missing != told) std::printf("%s\n", missing.c_str());
      std::fflush(stdout);
      told = missing;
      return bus.port().now() < end;
    }));
  }
  template <class T>
  static T require(rt::Result<T> r) {
    if (!r) throw CouldNotDo(r.error());
    return std::move(r.value());
  }
  EtherCatSession bus;
  yb::ChainKind kind = yb::ChainKind::kBase;
  std::optional<yb::DriveSession> session;
};

// Frames go on while a person thinks, all outputs motor stop: else the slaves' watchdogs expire.
bool confirmed(yb::DriveSession& s, std::istream& person, const std::string& what) {
  std::printf("%s\nKeep clear of it, an arm supported by hand, the emergency stop within reach.\n",
              what.c_str());
  std::printf("Type '%s' to go on, anything else to stop: ", kWord);
  std::fflush(stdout);
  std::atomic<bool> answered{false};
  std::thread frames([&] {
    while (!answered.load() && s.cycle()) {
    }
  });
  std::string word;
  std::getline(person, word);
  answered.store(true);
  frames.join();
  if (word == kWord) return true;
  std::printf("\nnot confirmed: nothing has moved\n");
  return false;
}

yb::Progress printed() {
  return [](const std::string& line) { std::printf("  %s\n", line.c_str()); };
}

std::string version_text(const drivers::tmcl::Firmware& f) {
  if (f.controller == 0) return "-";
  std::array<char, 40> text{};
  std::snprintf(text.data(), text.size(), "%d %d.%02d", f.controller, f.version / 100,
                f.version % 100);
  return text.data();
}

// NaN: the board did not tell it.
std::string told(double value, int digits) {
  if (std::isnan(value)) return "-";
  std::array<char, 40> text{};
  std::snprintf(text.data(), text.size(), "%.*f", digits, value);
  return text.data();
}

nlohmann::ordered_json print(const std::vector<yb::GripperReport>& grippers) {
  nlohmann::ordered_json all = nlohmann::ordered_json::array();
  for (const yb::GripperReport& g : grippers) {
    std::printf("%-6zu %-18s %d %d.%02d  speed %d, %d, current %d, %d  %s\n", g.position + 1,
                g.name.c_str(), g.firmware.controller, g.firmware.version / 100,
                g.firmware.version % 100, g.bars[0].max_speed, g.bars[1].max_speed,
                g.bars[0].max_current, g.bars[1].max_current,
                !g.wrong.empty() ? g.wrong.c_str()
                : g.calibrated   ? "ready"
                                 : "not calibrated: teletact youbot setup");
    nlohmann::ordered_json bars = nlohmann::ordered_json::array();
    for (const yb::GripperBar& b : g.bars)
      bars.push_back({{"max_speed", b.max_speed},
                      {"max_current", b.max_current},
                      {"standby_current", b.standby_current}});
    all.push_back({{"slave", g.position + 1},
                   {"gripper", g.name},
                   {"controller", g.firmware.controller},
                   {"firmware", g.firmware.version},
                   {"calibrated", g.calibrated},
                   {"bars", bars}});
  }
  return all;
}

int print(const YoubotOptions& o, const std::vector<yb::DriveReport>& reports,
          const std::vector<yb::GripperReport>& grippers) {
  nlohmann::ordered_json all = nlohmann::ordered_json::array();
  bool good = true;
  std::printf("%-6s %-18s %-10s %-6s %-6s %-6s %-10s %s\n", "slave", "drive", "firmware", "V", "C",
              "max A", "ticks", "state");
  for (const yb::DriveReport& r : reports) {
    std::printf("%-6zu %-18s %-10s %6s %6s %6s %10d  %s\n", r.position + 1, r.name.c_str(),
                version_text(r.firmware).c_str(), told(r.supply_V, 1).c_str(),
                told(r.temperature_C, 1).c_str(),
                told(r.max_current_mA < 0 ? std::nan("") : 1e-3 * r.max_current_mA, 2).c_str(),
                r.position_ticks, r.wrong.empty() ? "ready" : r.wrong.c_str());
    all.push_back({{"slave", r.position + 1},
                   {"drive", r.name},
                   {"controller", r.firmware.controller},
                   {"firmware", r.firmware.version},
                   {"flags", r.flags},
                   {"supply_V", r.supply_V},
                   {"temperature_C", r.temperature_C},
                   {"position_ticks", r.position_ticks},
                   {"current_mA", r.current_mA},
                   {"max_current_mA", r.max_current_mA},
                   {"commutated", r.commutated},
                   {"homed", r.homed},
                   {"wrong", r.wrong}});
    good = good && r.wrong.empty();
  }
  const auto held = print(grippers);
  if (!o.json.empty()) {
    const nlohmann::ordered_json whole{
        {"command", "youbot"}, {"drives", all}, {"grippers", held}, {"ready", good}};
    write_whole_file(o.json, whole.dump(2) + "\n");
  }
  return good ? 0 : 1;
}

void write_calibration(const std::string& path, const yb::Calibration& c) {
  const std::string wrong = yb::why_refused(c);
  if (!wrong.empty()) throw CouldNotDo("homing measured what can not be: " + wrong);
  write_whole_file(path, yb::calibration_text(c));
  std::printf("what homing measured is in %s\n", path.c_str());
  if (!c.has_serials())
    std::printf("The boards have no serial numbers: this file can not tell two robots apart.\n");
}

struct ToMove {
  int without_commutation = 0;
  std::array<bool, 3> homes{};              // by arm, 1 and 2
  std::vector<yb::GripperReport> grippers;  // all there are
  [[nodiscard]] bool anything() const {
    bool grips = false;
    for (const yb::GripperReport& g : grippers) grips = grips || !g.calibrated;
    return without_commutation > 0 || homes[1] || homes[2] || grips;
  }
};

ToMove to_move(const YoubotOptions& o, yb::DriveSession& s) {
  ToMove out;
  for (const yb::DriveReport& r : Robot::require(yb::check(s))) {
    out.without_commutation += r.commutated ? 0 : 1;
    const yb::BoardPlace& b = s.boards()[r.position];
    if (b.kind == yb::BoardKind::kJoint && (!r.homed || !o.calibration.empty()))
      out.homes[static_cast<std::size_t>(b.arm)] = true;
  }
  out.grippers = Robot::require(yb::look_at_grippers(s));
  return out;
}

std::string what_moves(const ToMove& to) {
  std::string what = "Will move:";
  if (to.without_commutation > 0)
    what += "\n  " + std::to_string(to.without_commutation) +
            " drives, a little, to find their commutation";
  for (const int arm : {1, 2})
    if (to.homes[static_cast<std::size_t>(arm)])
      what += "\n  arm " + std::to_string(arm) +
              ", every joint to its stop at 6 degrees a second, up to a minute";
  for (const yb::GripperReport& g : to.grippers)
    if (!g.calibrated) what += "\n  " + g.name + ", open and then closed, up to 8 s";
  return what;
}

void say_that_it_is_let_go(const yb::DriveSession& s) {
  if (!s.joints(1).empty())
    std::printf(
        "The arm has no brakes: its drives hold it as long as this command runs, and are told to\n"
        "stop at its end. Support it.\n");
}

}  // namespace

int run_youbot_check(const YoubotOptions& o) {
  Robot robot(o);
  const auto drives = Robot::require(yb::check(*robot.session));
  const int code = print(o, drives, Robot::require(yb::look_at_grippers(*robot.session)));
  robot.bus.finish();
  return code;
}

int run_youbot_setup(const YoubotOptions& o, std::istream& person) {
  Robot robot(o);
  yb::DriveSession& s = *robot.session;
  if (const int n = Robot::require(yb::clear_i2t(s)); n > 0)
    std::printf("I2t cleared of %d drives that have cooled down\n", n);
  const ToMove to = to_move(o, s);
  if (!o.calibration.empty() && !to.homes[1])
    throw std::runtime_error("--calibration " + o.calibration +
                             ": a base alone has no arm to home");
  if (to.anything()) {
    if (!confirmed(s, person, what_moves(to))) return 1;
    if (!s.failed().empty()) throw CouldNotDo(s.failed());
    (void)Robot::require(yb::commutate(s, printed()));
    yb::Calibration found{today(), robot.kind, yb::identities(robot.bus.master().slaves()), {}};
    for (const int arm : {1, 2})
      if (to.homes[static_cast<std::size_t>(arm)])
        (void)Robot::require(yb::home_arm(s, arm, printed(), &found.joints));
    for (const yb::GripperReport& g : to.grippers)
      (void)Robot::require(yb::set_up_gripper(s, g, printed()));
    if (!o.calibration.empty()) write_calibration(o.calibration, found);
  } else {
    std::printf("nothing has to move\n");
  }
  const auto drives = Robot::require(yb::check(s));
  const int code = print(o, drives, Robot::require(yb::look_at_grippers(s)));
  say_that_it_is_let_go(s);
  robot.bus.finish();
  return code;
}

namespace {

// The slave that may be moved as it is asked for.
std::size_t to_jog(const YoubotOptions& o, Robot& robot) {
  yb::DriveSession& s = *robot.session;
  const std::size_t i = robot.bus.slave(o.slave);
  if (!s.boards()[i].is_drive())
    throw std::runtime_error("--slave " + std::to_string(o.slave) + ": the " + s.name(i) +
                             " has no motor");
  if (const double most = yb::most_jog_rad_per_s(s.boards()[i]);
      std::abs(o.speed_rad_per_s) > most) {
    std::array<char, 128> why{};
    std::snprintf(why.data(), why.size(), "--speed %.3g: at most %.3g rad/s for the ",
                  o.speed_rad_per_s, most);
    throw std::runtime_error(why.data() + s.name(i));
  }
  return i;
}

}  // namespace

int run_youbot_jog(const YoubotOptions& o, std::istream& person) {
  Robot robot(o);
  yb::DriveSession& s = *robot.session;
  const std::size_t i = to_jog(o, robot);
  char text[160];
  std::snprintf(text, sizeof text, "Will move: %s, at %.3g rad/s for %.3g s%s", s.name(i).c_str(),
                o.speed_rad_per_s, o.seconds,
                "; drives without commutation find it first, all of them, a little");
  if (!confirmed(s, person, text)) return 1;
  (void)Robot::require(yb::commutate(s, printed()));
  const auto before = s.inputs(i).position_ticks;
  (void)Robot::require(yb::jog(s, i, o.speed_rad_per_s, o.seconds));
  const auto after = s.inputs(i).position_ticks;
  std::printf("%s: from %d to %d ticks\n", s.name(i).c_str(), before, after);
  if (!o.json.empty()) {
    const nlohmann::ordered_json whole{
        {"command", "youbot"},  {"slave", o.slave},
        {"drive", s.name(i)},   {"speed_rad_per_s", o.speed_rad_per_s},
        {"seconds", o.seconds}, {"from_ticks", before},
        {"to_ticks", after}};
    write_whole_file(o.json, whole.dump(2) + "\n");
  }
  say_that_it_is_let_go(s);
  robot.bus.finish();
  return 0;
}

}  // namespace teletact
