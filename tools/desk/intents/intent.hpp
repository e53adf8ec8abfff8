// What a page asks for, read from its JSON: docs/console_protocol.md, Intents. Strict: each act has
// its keys and no others, each key its type and range. Whatever is wrong refuses the whole intent,
// with one line that names the key.
#pragma once

#include <array>
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "perception/geometry/pose.hpp"
#include "rt/result.hpp"

namespace teletact {

enum class Act : std::uint8_t {
  kEngage,
  kHold,
  kClear,
  kToken,
  kHand,
  kDrive,
  kMark,
  kGoTo,
  kCancel,
  kDraw,
  kErase,
  kForget,
  kUndo,
  kNote,
  kRecord,
  kDevice,
  kSelect,
  kAccept,
  kSave,
  kOpen,
  kUnmark,
};
inline constexpr std::array<std::string_view, 21> kActNames = {
    "engage", "hold",   "clear",  "token",  "hand",   "drive", "mark",
    "go_to",  "cancel", "draw",   "erase",  "forget", "undo",  "note",
    "record", "device", "select", "accept", "save",   "open",  "unmark"};
[[nodiscard]] constexpr std::string_view name_of(Act a) noexcept {
  return kActNames[static_cast<std::size_t>(a)];
}

struct DrawnObstacle {
  std::uint16_t id = 0;
  bool box = false;  // else a disc about centre_W, radius half_m[0]
  perception::Vec3 centre_W{0, 0, 0}, half_m{0, 0, 0};
  double yaw_rad = 0;
};

struct Intent {
  Act act = Act::kHold;
  bool hold_engage = false, hold_hand = false, hold_drive = false;    // token
  bool press = false, button = false, clutch = false;                 // hand, device
  bool on = false, turns = false, fresh = false;                      // record, go_to, select
  bool scale_given = false, clutch_given = false, yaw_given = false;  // device
  double vx = 0, vy = 0, wz = 0;                                      // drive: body, m/s, rad/s
  double yaw_rad = 0, scale = 1, u = 0, v = 0;
  int sign = 1;
  std::uint32_t proposal = 0;
  std::uint16_t obstacle_id = 0;                                      // erase; 0: all
  std::uint64_t mark_id = 0;                                          // unmark
  perception::Vec3 p_W{0, 0, 0}, normal_W{0, 0, 0}, half_m{0, 0, 0};  // hand, go_to, forget
  std::vector<perception::Vec3> points_W;                             // mark
  DrawnObstacle obstacle;
  std::string text;  // note; name of accept, save, open
};

struct IntentLimits {
  static constexpr double kPlace_m = 1000, kHalf_m = 20, kSpeed_m_per_s = 2, kTurn_rad_per_s = 3;
  static constexpr double kPage_s = 1e12;  // a page's own time
  static constexpr std::size_t kMostPoints = 128, kMostText = 200, kMostName = 40;
};

// `act` and `id` of the envelope are not looked at again.
[[nodiscard]] rt::Result<Intent> read_intent(std::string_view act, const nlohmann::json& intent);

}  // namespace teletact
