#include "tools/audit/run_piece.hpp"

#include <algorithm>
#include <functional>
#include <iterator>
#include <span>

#include "tasks/contract/table.hpp"

namespace teletact {

namespace {

// Known of the whole run alone: acts and states that no sample tells, and what compares with its
// end.
constexpr const char* kOfTheWhole[] = {"haptic.device_brakes",
                                       "operator.engages",
                                       "operator.clears",
                                       "haptic.force_error_p95",
                                       "haptic.force_samples",
                                       "fusion.objects",
                                       "fusion.objects_named",
                                       "mark.count",
                                       "plan.paths",
                                       "robot.goal_error_m",
                                       "robot.mark_error_m",
                                       "robot.held_s",
                                       "robot.stated_error_max_m",
                                       "robot.unsure_s",
                                       "scene.touch_to_goal_ms",
                                       "log.dropped",
                                       "audit.dropped",
                                       "link.round_trip_ms",
                                       "best_effort."};
constexpr const char* kOfTicks[] = {"haptic.force_max_N",
                                    "haptic.force_step_max_N",
                                    "haptic.force_step_raw_max_N",
                                    "haptic.contact_share",
                                    "haptic.contacts",
                                    "haptic.guard_share",
                                    "haptic.reach_max",
                                    "haptic.clutched_share",
                                    "haptic.not_finite",
                                    "haptic.jumps",
                                    "haptic.flips",
                                    "visits."};
constexpr const char* kOfFrames[] = {"fusion.frames", "fusion.frames_tracked",
                                     "fusion.frames_claimed", "fusion.frames_moving",
                                     "fusion.moving_cells_max"};
constexpr const char* kOfLink[] = {"link."};
constexpr const char* kOfRobot[] = {"robot.tracking_error_max_m"};
constexpr const char* kOfTruth[] = {"robot.path_m", "robot.collisions", "robot.arrival_error_max_m",
                                    "robot.goal_error_uncorrected_m"};

// Cuts lists of what has a time stamp.
class Crop {
 public:
  Crop(const rt::StorePiece& piece, std::int64_t epoch_ns) : piece_(piece), epoch_ns_(epoch_ns) {}
  [[nodiscard]] bool holds(rt::Time t) const {
    const double at_s = 1e-9 * static_cast<double>(rt::ns_of(t) - epoch_ns_);
    return at_s >= piece_.from_s && at_s < piece_.to_s;
  }
  template <class T>
  void operator()(std::vector<T>& samples, rt::Time T::*at) const {
    std::erase_if(samples, [&](const T& s) { return !holds(s.*at); });
  }
  // Samples of which the older ones have gone. False: the piece begins before the first that is
  // there.
  template <class T>
  [[nodiscard]] bool whole(std::vector<T>& samples, bool some_gone) const {
    const bool all = !some_gone || (!samples.empty() && !holds_before(samples.front().stamp));
    (*this)(samples, &T::stamp);
    return all;
  }

 private:
  [[nodiscard]] bool holds_before(rt::Time t) const {
    return piece_.from_s < 1e-9 * static_cast<double>(rt::ns_of(t) - epoch_ns_);
  }
  rt::StorePiece piece_;
  std::int64_t epoch_ns_;
};

void crop_operator(const rt::StorePiece& piece, OperatorHalf& op,
                   const std::function<void(std::span<const char* const>)>& leave_out) {
  const Crop crop(piece, op.epoch_ns);
  OperatorView& v = op.view;
  if (!crop.whole(v.haptic, v.haptic_past.ticks > 0)) leave_out(kOfTicks);
  if (!crop.whole(v.fusion, v.fusion_past.consumed > 0)) leave_out(kOfFrames);
  if (!crop.whole(op.link.newest, op.link.past.pictures + op.link.past.states > 0))
    leave_out(kOfLink);
  crop(v.haptic_thin.kept, &tasks::HapticSample::stamp);
  crop(v.paths, &tasks::Path::made);
  crop(v.arrived, &Arrival::stamp);
  std::erase_if(v.visits,
                [&](const Visit& s) { return s.from_s < piece.from_s || s.from_s >= piece.to_s; });
  v.arrivals = v.arrived.size();
  v.haptic_past = {};
  v.fusion_past = {};
  v.touched_past.clear();
  op.link.past = {};
  op.totals.clear();
  // Pictures and maps are of one instant each.
  for (auto* view : {v.view.get(), v.moving_view.get()}) {
    if (!crop.holds(view->fused)) view->seq = 0;
  }
  for (auto* map : {v.map.get(), v.moving_map.get()}) {
    if (crop.holds(map->fused)) continue;
    map->seq = 0;
    map->moving_count = 0;
  }
}

void crop_robot(const rt::StorePiece& piece, RobotHalf& robot,
                const std::function<void(std::span<const char* const>)>& leave_out) {
  const Crop crop(piece, robot.epoch_ns);
  RobotView& v = robot.view;
  if (!crop.whole(v.robot, v.robot_past.seen > 0)) leave_out(kOfRobot);
  if (!crop.whole(v.truth, v.truth_past.seen > 0)) leave_out(kOfTruth);
  crop(v.robot_past.kept, &tasks::RobotSample::stamp);
  crop(v.truth_past.kept, &TruthSample::stamp);
  v.tracking_error_max_m = 0;
  for (const auto& s : v.robot)
    v.tracking_error_max_m =
        std::max(v.tracking_error_max_m, static_cast<double>(s.tracking_error_m));
  if (!v.truth.empty()) {
    const TruthSample first = v.truth.front();
    for (TruthSample& t : v.truth) {
      t.path_m -= first.path_m;
      t.collisions -= first.collisions;
    }
  }
  robot.totals.clear();
}

}  // namespace

std::vector<std::string> crop_to(const rt::StorePiece& piece, OperatorHalf& op, RobotHalf& robot) {
  std::vector<std::string> out(std::begin(kOfTheWhole), std::end(kOfTheWhole));
  const auto leave_out = [&](std::span<const char* const> names) {
    out.insert(out.end(), names.begin(), names.end());
  };
  crop_operator(piece, op, leave_out);
  crop_robot(piece, robot, leave_out);
  // Frames are numbered through the run; of parts only the newest number is known.
  for (const rt::TaskLog& t : op.log.tasks) {
    if (t.past && t.id == static_cast<std::uint16_t>(tasks::TaskId::kFusion))
      out.insert(out.end(), {"fusion.frames_overwritten", "fusion.frames_overwritten_share"});
  }
  return out;
}

Metrics without(const Metrics& all, const std::string& command,
                const std::vector<std::string>& left_out) {
  Metrics m(command);
  for (const Metrics::Row& r : all.rows()) {
    const bool out = std::any_of(left_out.begin(), left_out.end(), [&](const std::string& name) {
      return name.back() == '.' ? r.name.starts_with(name) : r.name == name;
    });
    if (out) continue;
    if (r.is_text)
      m.add(r.name, r.text, r.unit);
    else
      m.add(r.name, r.value, r.unit);
  }
  return m;
}

}  // namespace teletact
