// The twenty hard cases of touching a sampled surface, each as a scene, a hand path and limits.
//
// Every run is judged by an optimum that shares no code with the renderer, one of three:
//   field optimum    the path-constrained nearest point on the same samples
//                    (tools/measure/support/field_optimum.hpp)
//   guarded optimum  the field optimum's force behind the slew guard
//   exact            an ideal spring on the device, in the same hand
// A figure over its limit is failed, whatever the optimum does, and reported with the optimum's own
// figure. Where that is over the limit too, it comes from the samples, as they are asked to be
// rendered; it is failed all the same.
//
// Frames: S of the solid, W of the grid (X_WS of the placement).  SI.
#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <span>
#include <string>
#include <vector>

#include "tools/measure/stability/fused_field.hpp"
#include "tools/measure/stability/ray_cast.hpp"
#include "tools/measure/support/haptic_rig.hpp"
#include "tools/measure/support/haptic_score.hpp"

namespace stability {

struct Setting {
  rig::Placement place;
  double speed = 0.1;  // of the hand, m/s
  std::string method = "constrained";
  bool judged = true;                // run the field optimum beside
  bool controller = true;            // the passivity controller of cases 1 to 19
  bool layer = true;                 // false: no slew guard, no fade-in, no passivity controller
  const FusedView* fused = nullptr;  // the solid as the product fuses it, not its own samples
  double tip_radius_m = 0;           // on samples: 0 runs both, with 0 and with 3 mm
};

enum class Yardstick : std::uint8_t { kField, kGuarded, kExact };
[[nodiscard]] const char* name_of(Yardstick by);  // "field optimum", "guarded optimum", "exact"

// A figure and the optimum's own.
struct Pair {
  double ours = std::numeric_limits<double>::quiet_NaN(), optimum = ours;
};

struct Check {
  std::string name;
  double value = 0, limit = 0;
  double optimum = std::numeric_limits<double>::quiet_NaN();  // its own figure
  Yardstick by = Yardstick::kField;
  bool binds = true;  // false: the optimum's figure stands beside, but less than it can be had
  // Where in the run we are over the limit and the optimum, thereabouts, is not or less far; NaN:
  // nowhere, or not known.
  Pair alone{};
  bool gate =
      false;  // kept by every run; a force that is cut at its limit has no margin to speak of
  [[nodiscard]] bool met() const { return value <= limit + 1e-9; }  // NaN is not
  // Failed, and so is the optimum in the same run, as far, wherever we are: the samples' doing.
  [[nodiscard]] bool field_bound() const {
    return !met() && binds && as_far(value, optimum, limit) && std::isnan(alone.ours);
  }
  // To within a twentieth, or the optimum's resolution: 0.05 mm, 0.05 N at 1 N/mm.
  static bool as_far(double ours, double optimum, double limit) {
    return optimum > limit + 1e-9 && ours - optimum <= std::max(0.05, 0.05 * ours);
  }
  // Share of the limit that is left. Where nothing is allowed, and for a gate, all of it or none.
  [[nodiscard]] double margin() const {
    if (limit > 0 && std::isfinite(value) && !(gate && met())) return (limit - value) / limit;
    return met() ? 1 : -1;
  }
};

struct Run {
  int id = 0;
  std::string name;  // variant, placement, speed
  std::vector<rig::Row> rows;
  rig::Figures figures;
  std::vector<rig::Optimum> optimum;
  std::vector<Check> checks;
  std::string note;  // closed form and other figures printed beside
};

struct Case {
  int id;
  const char* name;
  const char* must;      // the limits, short
  const char* baseline;  // published figures of the nearest-point baseline, 1 / 10 steps
  const char* chai3d;    // and of CHAI3D 3.3 on a mesh
  std::vector<Run> (*run)(const Setting&);
};
[[nodiscard]] std::span<const Case> cases();

// --- shared by the files of cases
struct Limits {
  double j = 0.15;      // N a tick, at least 1.2 K |dh| + 0.02
  bool crease = false;  // 0.33 N, guard in use in at most 6 % of the contact ticks
  bool optimum = true;  // force and position against the field optimum
  bool side = false;    // one surface alone: the pull stays on its side
};
// What is asked of the same rig behind the way.
using After = std::function<void(rig::Rig&, Run&)>;
// Fused: the camera leans to `lean` of S.
[[nodiscard]] rig::Scene still_scene(const Setting& s,
                                     std::function<double(const rig::Vec3&)> solid,
                                     const rig::Vec3& lean = rig::Vec3::UnitX());
// Cases that are repeated on fused fields.
[[nodiscard]] bool on_fused_fields(int id);
// Cases that a round tip of any radius up to kTipMost_m can run on samples; 20 is about a point.
inline constexpr double kTipMost_m = 0.004;  // every path begins 5 mm off
[[nodiscard]] bool takes_tip(int id);
[[nodiscard]] std::vector<FusedView> fused_views();
[[nodiscard]] Run slide(int id, const std::string& name, const Setting& s, rig::Scene scene,
                        const rig::Path& path, const Limits& limits, const After& after = {});
// On samples with a tip of 0 and of 3 mm, the hand as deep under where the tip's centre rests.
[[nodiscard]] std::vector<Run> with_both_tips(const Setting& s,
                                              std::vector<Run> (*runs)(const Setting&));
// How much higher the hand's way is for the tip.
[[nodiscard]] double raised_m(const Setting& s);
[[nodiscard]] std::string title(const std::string& name, const Setting& s);
void add(Run& run, std::string name, double value, double limit,
         double optimum = std::numeric_limits<double>::quiet_NaN(),
         Yardstick by = Yardstick::kField);
// What the rows of every run have to keep: finite, at most 12 N. The other gates: gates.hpp.
void add_gates(Run& run);
[[nodiscard]] double deviation(const std::vector<double>& v);
[[nodiscard]] double angle_deg(const rig::Vec3& f, const rig::Vec3& n);

std::vector<Run> case_floor(const Setting&);
std::vector<Run> case_concave_corner(const Setting&);
std::vector<Run> case_friction_corner(const Setting&);
std::vector<Run> case_groove(const Setting&);
std::vector<Run> case_room_corner(const Setting&);
std::vector<Run> case_convex_edge(const Setting&);
std::vector<Run> case_rim_press(const Setting&);
std::vector<Run> case_plates(const Setting&);
std::vector<Run> case_slots(const Setting&);
std::vector<Run> case_saddle(const Setting&);
std::vector<Run> case_noise(const Setting&);
std::vector<Run> case_step(const Setting&);
std::vector<Run> case_rise(const Setting&);
std::vector<Run> case_vanish(const Setting&);
std::vector<Run> case_deep_press(const Setting&);
std::vector<Run> case_border(const Setting&);
std::vector<Run> case_start_inside(const Setting&);
std::vector<Run> case_friction_hold(const Setting&);
std::vector<Run> case_texture(const Setting&);
std::vector<Run> case_closed_loop(const Setting&);

}  // namespace stability
