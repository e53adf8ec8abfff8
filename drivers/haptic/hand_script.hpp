// The scripted hand: what the operator's hand wants to do, as a list of timed segments in scene
// coordinates. The device twin's hand model pulls the stylus toward target(); contact decides where
// the tip really ends.
//
//   [[hand.segment]]
//   kind = "move"        # minimum-jerk to standoff_m above the segment's point, in time_s
//   point_m = [0.4, 0, 0.3]
//   normal = [0, 0, 1]   # outward surface normal there; press goes against it
//   standoff_m = 0.05
//   time_s = 1.0
//
// kinds   move         to the point plus standoff along its normal
//         press        from where the target is to depth_m below the point, against the normal
//         slide        from this point to `point_m` at the depth that is reached, constant speed
//                      with soft ends
//         hold         stays
//         button_down, button_up, clutch_down, clutch_up   at the segment's start; then stays for
//                      time_s (may be 0)
// With source = "last" a segment keeps the point of the one before (press again, draw back).
// A point may come later than the script: source = "pixel" with pixel = [u, v] says which image
// point it is, source = "chosen" that the run chooses one; set_point() delivers it in W. A segment
// whose point has not arrived when it starts is passed over in place (held) and counted.
//
// Frames: W world, D haptic base. Pure function of (time since start, points delivered before the
// segment started). target() belongs to one thread and its time must not go back; set_point() may
// come from another one.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <deque>
#include <memory>
#include <string>
#include <vector>

#include "config/schema.hpp"
#include "drivers/haptic/workspace_map.hpp"
#include "perception/geometry/pose.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/time.hpp"

namespace drivers {

struct HandSegmentConfig {
  std::string kind = "hold";
  double time_s = 1.0;
  std::string source = "point";  // or "pixel", "chosen", "last"
  std::array<double, 3> point_m{};
  std::array<double, 3> normal{0, 0, 1};
  std::array<double, 2> pixel{};  // u right, v down, of the image that the run names
  double standoff_m = 0.05;
  double depth_m = 0.005;

  void describe(config::Section& s) {
    s.text(
        "kind", kind,
        {"move", "press", "slide", "hold", "button_down", "button_up", "clutch_down", "clutch_up"},
        "what the hand does");
    s.number("time_s", time_s, 0, 3600, "duration");
    s.text("source", source, {"point", "pixel", "chosen", "last"}, "where the point comes from");
    s.numbers("point_m", point_m, -1000, 1000, "point in W");
    s.numbers("normal", normal, -1, 1, "outward surface normal at the point, in W");
    s.numbers("pixel", pixel, 0, 8192, "image point to be resolved while running");
    s.number("standoff_m", standoff_m, -1, 1, "move: distance from the point along its normal");
    s.number("depth_m", depth_m, -0.2, 0.2, "press: depth of the hand's target below the point");
  }
};

struct HandScriptConfig {
  double start_after_s = 0.0;       // stays at the start point so long
  std::array<double, 3> start_m{};  // offset of the start from the workspace centre, in W
  std::deque<HandSegmentConfig> segments;

  void describe(config::Section& s) {
    s.number("start_after_s", start_after_s, 0, 864000, "rest before the first segment");
    s.numbers("start_m", start_m, -10, 10, "start point relative to the workspace centre, in W");
    s.list(
        "segment", [this](config::Section& item) { segments.emplace_back().describe(item); },
        "one motion of the hand");
  }
};

struct HandTarget {
  perception::Vec3 p_WT = perception::Vec3::Zero();  // where the hand wants the tip
  perception::Vec3 v_WT = perception::Vec3::Zero();  // and how fast
  bool button = false, clutch = false;
  int segment = -1;  // in force; -1 before, size() after
};

class HandScript {
 public:
  // Throws std::invalid_argument naming the segment: zero normal, zero time of a motion.
  HandScript(rt::NonRealtime&, const HandScriptConfig&, const WorkspaceMap&);

  [[nodiscard]] HandTarget target(rt::Nanos since_start) noexcept;
  // Delivers the point of segment `i`, surface point and outward normal in W. False: no such
  // segment, neither a pixel nor a chosen one, already delivered or not finite. Any one thread.
  bool set_point(std::size_t i, const perception::Vec3& p_W,
                 const perception::Vec3& normal_W) noexcept;

  [[nodiscard]] std::size_t size() const noexcept { return count_; }
  [[nodiscard]] const HandSegmentConfig& segment(std::size_t i) const {
    return config_.segments[i];
  }
  // Start of segment i after the script's start; start(size()) is the end.
  [[nodiscard]] rt::Nanos start(std::size_t i) const noexcept { return starts_[i]; }
  [[nodiscard]] rt::Nanos duration() const noexcept { return starts_[count_]; }
  [[nodiscard]] std::uint32_t unresolved() const noexcept { return unresolved_; }
  [[nodiscard]] const WorkspaceMap& map() const noexcept { return map_; }

 private:
  enum class Kind : std::uint8_t {
    kMove,
    kPress,
    kSlide,
    kHold,
    kButtonDown,
    kButtonUp,
    kClutchDown,
    kClutchUp
  };
  struct Slot {
    std::atomic<bool> ready{false};
    perception::Vec3 p_W = perception::Vec3::Zero();
    perception::Vec3 normal_W = perception::Vec3::UnitZ();
  };
  void enter(std::size_t i) noexcept;

  HandScriptConfig config_;
  WorkspaceMap map_;
  std::size_t count_ = 0;
  std::vector<Kind> kinds_;
  std::vector<rt::Nanos> starts_;  // count_ + 1
  std::unique_ptr<Slot[]> slots_;
  // Of the segment in force: from, to, and the surface point it works on.
  int current_ = -1;
  perception::Vec3 from_ = perception::Vec3::Zero(), to_ = perception::Vec3::Zero();
  perception::Vec3 anchor_ = perception::Vec3::Zero(), normal_ = perception::Vec3::UnitZ();
  double offset_ = 0;  // along the normal, from the anchor: negative is depth
  bool button_ = false, clutch_ = false;
  std::uint32_t unresolved_ = 0;
};

}  // namespace drivers
