// The operator's console, without a screen. An ordinary thread calls it every 20 ms or so (the
// process's main thread, or an actor on the virtual clock). It watches samples, views and maps,
// plays the operator's script (engage, points for the hand), and keeps what the report needs.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "tasks/graph/limits.hpp"
#include "tools/host/view_tally.hpp"
#include "tools/pictures/link_seen.hpp"
#include "tools/scene/box_devices.hpp"
#include "tools/touch/force_act.hpp"
#include "tools/touch/touch_script.hpp"

namespace teletact {

// The base stood at the end of its path, by what the desk knows.
struct Arrival {
  rt::Time stamp{};  // of planning's word, operator's clock
  std::uint64_t path_seq = 0;
  double goal_x_m = 0, goal_y_m = 0;  // the path's end, in W
  double error_m = 0;                 // stated, of the base's place
};

// What the operator box's console has seen.
struct OperatorView {
  std::vector<tasks::HapticSample> haptic;
  std::vector<tasks::FusionSample> fusion;
  // Of samples that are older and gone (view_tally.hpp).
  HapticTally haptic_past;
  FusionTally fusion_past;
  Decimated<tasks::HapticSample> haptic_thin;
  std::vector<Touched> touched_past;  // by visit
  // Each path once, as it was first published: the first, and the newest kWholePaths.
  std::vector<tasks::Path> paths;
  tasks::TaskState task;
  tasks::CameraPose camera;
  tasks::ObjectList objects;        // newest; seq 0: objects are switched off
  std::uint32_t objects_named = 0;  // largest serial seen
  tasks::ModeMsg mode;
  drivers::RobotState robot;
  std::unique_ptr<tasks::SceneView> view = std::make_unique<tasks::SceneView>();
  std::unique_ptr<perception::CostMap> map = std::make_unique<perception::CostMap>();
  // The same at the moment when most of it moved; seq 0: nothing ever did.
  std::unique_ptr<tasks::SceneView> moving_view = std::make_unique<tasks::SceneView>();
  std::unique_ptr<perception::CostMap> moving_map = std::make_unique<perception::CostMap>();
  tasks::OdometryFrame world;  // newest
  double error_max_m = 0;      // largest stated error of the base's place
  double unsure_s = 0;         // time with goals not engaged for it
  // Time with a mark to drive to during which goals were not engaged for any other reason, and the
  // newest such reason. The base stands then.
  double held_s = 0;
  tasks::Held held = tasks::Held::kNo;
  std::int32_t held_ms = 0, held_limit_ms = 0;
  std::vector<Arrival> arrived;  // the newest of `arrivals`
  std::uint64_t arrivals = 0;
  rt::Time first_arrival{};
  std::uint32_t points_resolved = 0;
  std::vector<Visit> visits;        // of a hand that chooses its places
  std::uint64_t log_dropped = 0;    // records of the tasks' logs that did not fit
  std::uint32_t device_brakes = 0;  // times the operator had to enable the forces again
  std::uint32_t engages = 0;        // acts of the operator; more than one: again after a fault
  std::uint32_t clears = 0;         // acts of the operator: a safe stop, of either box, cleared
  std::uint32_t edits = 0;          // acts of the operator: asked of the scene
  std::vector<std::string_view> beyond;  // edges whose newest value is beyond its limits now
};

// Why the base stands, in words: "robot state 512 ms old, limit 500 ms". Empty for kNo.
[[nodiscard]] std::string held_text(tasks::Held held, std::int32_t measured_ms,
                                    std::int32_t limit_ms);

// How the way ends, or why there is none, where it is worth a word: "1.15 m short of the goal:
// ...". Else empty.
[[nodiscard]] std::string goal_text(const tasks::TaskState& task);

using TakeLine = std::function<void(std::string_view)>;  // one line of a task's log

class OperatorConsole {
 public:
  OperatorConsole(OperatorBox& box, const Scene& scene, rt::Time epoch);
  void tick(rt::Time now);
  // Between two ticks: a piece of the mesh does not wait for the next one.
  void glance(rt::Time now);
  // From now on the tasks' log lines go to this file, and to `also`; `refused`: once, when the disk
  // does not take a line. By an ordinary thread, with every tick.
  void log_to(rt::NonRealtime& nrt, const std::string& path, TakeLine also = {},
              std::function<void()> refused = {});
  // A line of the box itself among them.
  void say(rt::Time now, std::string_view text) {
    if (log_) log_->say(rt::ns_of(now), "box", text);
  }
  [[nodiscard]] const OperatorView& seen() const noexcept { return seen_; }
  [[nodiscard]] OperatorView take() { return std::move(seen_); }  // ends its use
  [[nodiscard]] const LinkSeen& link() const noexcept { return link_; }
  void ramp_down() noexcept { box_.graph().requests().ramp_down.store(true); }
  [[nodiscard]] std::string status_line(rt::Time now) const;
  // What the hand chose since the last call, a line each; mostly empty.
  [[nodiscard]] std::string news() { return touch_script_.news(); }
  // From now on a person at a page asks for all that the script would have asked for: engage,
  // clear, edits. What is asked is counted as the script's acts are.
  void leave_to_page() noexcept { page_ = true; }
  void count(std::uint32_t OperatorView::*act) noexcept { ++(seen_.*act); }
  // Who else takes the mesh. kNone: nobody wants any, and fusion makes none; kWhole: it has
  // nothing, deltas count from one with `restart` on. `take` sees each delta that counts.
  enum class MeshWanted : std::uint8_t { kNone, kDeltas, kWhole };
  struct MeshTaker {
    std::function<MeshWanted()> wants;
    std::function<void(const perception::MeshDelta&)> take;
  };
  void mesh_also_to(MeshTaker taker) { mesh_taker_ = std::move(taker); }
  // From now on it asks nothing of the scene, and does not say what it has taken of the mesh.
  void leave_the_scene() noexcept { edits_scene_ = false; }
  // The mesh as far as it was told to this console; empty where the scene asks for none.
  [[nodiscard]] const perception::MeshStore& mesh() const noexcept { return mesh_; }

 private:
  void drain(rt::Time now);
  void take_samples();
  void see_scene(rt::Time now);
  void see_world(rt::Time now);
  void see_task(rt::Time now);
  template <tasks::EdgeId kEdge>
  auto newest(rt::Time now);
  void fold_samples();
  void keep_what_moves();
  void resolve_points(rt::Time now);
  void mind_device(rt::Time now);
  void mind_held(const tasks::OdometryFrame& newest);
  [[nodiscard]] std::string stands() const;
  void engage(rt::Time now);
  void clear(rt::Time now);
  enum class Judges : std::uint8_t { kNo, kYes };
  void take_mesh(rt::Time now, Judges judges);
  template <class View>
  void judge(const View& view, tasks::EdgeId edge, rt::Time now);
  void edit(rt::Time now);
  [[nodiscard]] bool surface_at(const std::array<double, 2>& pixel, int du, int dv,
                                perception::Vec3& p_W) const;
  OperatorBox& box_;
  const Scene& scene_;
  rt::Time epoch_;
  OperatorView seen_;
  std::size_t next_point_ = 0;
  int camera_width_px_;
  ForceAct force_act_;
  TouchScript touch_script_;
  std::vector<tasks::LimitWatch> watches_;  // of what the console reads, by kLimitTable's order
  rt::Time fusion_heard_{};
  rt::Nanos mesh_lag_{0};  // from the newest image in the mesh to its arrival
  rt::Time held_since_{}, stopped_since_{}, pressed_since_{};
  bool followed_ = false;  // an engage has been followed in this run
  bool engage_shown_ = false, edits_scene_ = true, page_ = false;
  std::size_t next_edit_ = 0;
  std::ptrdiff_t most_moving_px_ = 0;
  perception::MeshStore mesh_;
  LinkSeen link_;
  MeshTaker mesh_taker_;
  std::unique_ptr<rt::LogDrain> log_;
};

// At the end of a run: <folder>/scene.ply, where the scene asks for a mesh, and options.save_map.
// Throws std::runtime_error naming the file.
void save_scene(rt::NonRealtime& nrt, const OperatorConsole& console,
                const tasks::FusionTask& fusion, const std::string& folder,
                const std::string& map_file);

struct TruthSample {
  rt::Time stamp{};
  double x_m = 0, y_m = 0, yaw_rad = 0, path_m = 0;
  std::uint32_t collisions = 0;
};

struct RobotView {
  std::vector<tasks::RobotSample> robot;
  std::vector<TruthSample> truth;
  // Of samples that are older and gone.
  Decimated<tasks::RobotSample> robot_past;
  Decimated<TruthSample> truth_past;
  tasks::ModeMsg mode;
  double tracking_error_max_m = 0;
  std::uint64_t log_dropped = 0;
  bool mode_beyond = false;  // the newest mode is beyond its limits now
};

class RobotConsole {
 public:
  explicit RobotConsole(RobotBox& box);
  void tick(rt::Time now);
  void log_to(rt::NonRealtime& nrt, const std::string& path, TakeLine also = {},
              std::function<void()> refused = {});
  // A line of the box itself among them.
  void say(rt::Time now, std::string_view text) {
    if (log_) log_->say(rt::ns_of(now), "box", text);
  }
  [[nodiscard]] const RobotView& seen() const noexcept { return seen_; }
  [[nodiscard]] RobotView take() { return std::move(seen_); }

 private:
  RobotBox& box_;
  tasks::LimitWatch mode_in_;
  RobotView seen_;
  std::unique_ptr<rt::LogDrain> log_;
};

}  // namespace teletact
