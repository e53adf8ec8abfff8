#include "drivers/youbot_bus/gripper_setup.hpp"

#include <utility>

#include "drivers/tmcl/youbot_parameters.hpp"

namespace drivers::youbot_bus {

namespace {

constexpr std::uint8_t kModule = 1, kBars = 2;
constexpr std::uint8_t kMaxSpeed = 4, kMaxCurrent = 6, kStandbyCurrent = 7, kBarIsThere = 8,
                       kStallFilter = 173, kStallThreshold = 174;
constexpr std::int32_t kTravel_counts = 66000;
constexpr int kLookCycles = 100, kLooks = 40;

tmcl::Request request(tmcl::Command c, std::uint8_t type, std::uint8_t bar, std::int32_t value) {
  return {kModule, static_cast<std::uint8_t>(c), type, bar, value};
}

tmcl::Request gripper_calibrated(tmcl::Command c, std::int32_t value) {
  return request(c, tmcl::global::kCalibrated, tmcl::global::kUserBank, value);
}

// Both bars.
rt::Result<bool> tell(DriveSession& s, std::size_t i, tmcl::Command c, std::uint8_t type,
                      std::int32_t value) {
  for (std::uint8_t bar = 0; bar < kBars; ++bar)
    if (const auto done = s.ask(i, request(c, type, bar, value)); !done)
      return rt::Error{done.error()};
  return true;
}

// By so many counts, the raw ones: below zero is open.
rt::Result<bool> move(DriveSession& s, std::size_t i, std::int32_t counts) {
  constexpr std::uint8_t kRelative = 1;
  if (auto told = tell(s, i, tmcl::Command::kMoveToPosition, kRelative, counts); !told) return told;
  for (int look = 0; look < kLooks; ++look) {
    for (int k = 0; k < kLookCycles; ++k)
      if (!s.cycle()) return rt::Error{s.failed()};
    bool there = true;
    for (std::uint8_t bar = 0; bar < kBars; ++bar) {
      const auto r = s.ask(i, request(tmcl::Command::kGetAxisParameter, kBarIsThere, bar, 0));
      if (!r) return rt::Error{r.error()};
      there = there && r.value() == 1;
    }
    if (there) return true;
  }
  return true;
}

rt::Result<bool> read_bars(DriveSession& s, GripperReport& r) {
  for (std::uint8_t bar = 0; bar < kBars; ++bar) {
    GripperBar& b = r.bars[bar];
    const std::array<std::pair<std::uint8_t, std::int32_t*>, 3> wanted{
        {{kMaxSpeed, &b.max_speed},
         {kMaxCurrent, &b.max_current},
         {kStandbyCurrent, &b.standby_current}}};
    for (const auto& [number, into] : wanted) {
      const auto v = s.ask(r.position, request(tmcl::Command::kGetAxisParameter, number, bar, 0));
      if (!v) return rt::Error{v.error()};
      *into = v.value();
    }
  }
  return true;
}

}  // namespace

rt::Result<std::vector<GripperReport>> look_at_grippers(DriveSession& s) {
  std::vector<GripperReport> out;
  for (const int arm : {1, 2}) {
    const auto joints = s.joints(arm);
    if (joints.empty()) continue;
    GripperReport r;
    r.position = joints.back();
    r.name = "arm " + std::to_string(arm) + " gripper";
    // No gripper: nobody answers, or the joint says that it knows none.
    constexpr int kFewAsks = 3;
    const auto homed =
        s.ask(r.position, gripper_calibrated(tmcl::Command::kGetGlobal, 0), kFewAsks);
    if (!s.failed().empty()) return rt::Error{s.failed()};
    if (!homed) continue;
    r.calibrated = homed.value() == 1;
    // Its exact text is not published: one that can not be read is no reason against it.
    if (const auto firmware = s.gripper_firmware(r.position)) r.firmware = firmware.value();
    if (const auto read = read_bars(s, r); !read) r.wrong = read.error();
    if (!s.failed().empty()) return rt::Error{s.failed()};
    out.push_back(std::move(r));
  }
  return out;
}

rt::Result<bool> set_up_gripper(DriveSession& s, const GripperReport& g, const Progress& say) {
  const std::size_t i = g.position;
  using tmcl::Command;
  if (auto done = tell(s, i, Command::kSetAxisParameter, kStallThreshold, 50); !done) return done;
  if (auto done = tell(s, i, Command::kSetAxisParameter, kStallFilter, 1); !done) return done;
  if (g.calibrated) return true;
  if (auto done = move(s, i, -kTravel_counts); !done) return done;
  if (auto done = move(s, i, kTravel_counts); !done) return done;
  if (auto done = tell(s, i, Command::kMotorStop, 0, 0); !done) return done;
  if (auto done = tell(s, i, Command::kSetAxisParameter, tmcl::axis::kActualPosition, 0); !done)
    return done;
  if (const auto done = s.ask(i, gripper_calibrated(Command::kSetGlobal, 1)); !done)
    return rt::Error{done.error()};
  say(g.name + " has been opened and closed, and is 0 there");
  return true;
}

}  // namespace drivers::youbot_bus
