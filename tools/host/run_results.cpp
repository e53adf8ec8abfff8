#include "tools/host/run_results.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

#include "rt/audit/histogram.hpp"
#include "rt/audit/task_past.hpp"
#include "rt/quantile.hpp"
#include "tasks/contract/table.hpp"
#include "tools/host/run_truth.hpp"
#include "tools/host/task_times.hpp"

namespace teletact {

namespace {

// Frames that fusion took, and frames that a newer one had replaced before fusion looked: the
// numbers of the frames that its jobs used tell both. Of a piece of the run the first frame of it
// counts as the one behind the last before.
std::pair<std::uint64_t, std::uint64_t> frames_seen(const rt::TaskLog& fusion, bool piece) {
  std::uint64_t newest = 0, seen = 0, before = 0;
  if (fusion.past) {
    newest = fusion.past->newest_input;
    seen = fusion.past->inputs_seen;
  }
  for (const auto& j : fusion.jobs) {
    if (piece && newest == 0 && j.input_seq[0] > 0) before = newest = j.input_seq[0] - 1;
    if (j.input_seq[0] > newest) ++seen, newest = j.input_seq[0];
  }
  newest -= before;
  return {seen, newest - std::min(newest, seen)};
}

constexpr double kLateShareLimit = 0.05;

bool real_time(const OperatorHalf& op, const RobotHalf& robot) {
  return op.log.not_realtime.empty() && robot.log.not_realtime.empty();
}

const rt::TaskLog* task_of(const OperatorHalf& op, const RobotHalf& robot, tasks::TaskId id) {
  for (const auto* log : {&op.log, &robot.log}) {
    for (const auto& t : log->tasks) {
      if (t.id == static_cast<std::uint16_t>(id)) return &t;
    }
  }
  return nullptr;
}

}  // namespace

TouchedPlaces touched_of(const OperatorHalf& op) {
  return touched_places(op.view.visits, op.view.haptic, op.epoch_ns, op.view.touched_past);
}

namespace {

HapticTally haptic_tally(const RunInfo& info, const OperatorHalf& op) {
  HapticTally t = op.view.haptic_past;
  for (const auto& s : op.view.haptic) t.add(s, info.touch_N_per_m);
  return t;
}

// p99.9 of the start lateness beyond the sentinel's; none: no sample.
std::optional<double> late_beyond_sentinel_us(const rt::RunLog& log, const rt::TaskLog& task) {
  std::vector<std::int64_t> late = rt::late_minus_sentinel(log, task);
  if (task.past && task.past->late_minus_sentinel.count() > 0) {
    rt::SignedHistogram all = task.past->late_minus_sentinel;
    for (const std::int64_t ns : late) all.record(ns);
    return 1e-3 * static_cast<double>(all.quantile(0.999));
  }
  if (late.empty()) return std::nullopt;
  return 1e-3 * static_cast<double>(rt::quantile_in_place(std::span(late), 0.999));
}

void add_haptic_metrics(const RunInfo& info, const OperatorHalf& op, const RobotHalf& robot,
                        Metrics& m) {
  const rt::TaskLog* task = task_of(op, robot, tasks::TaskId::kHaptic);
  if (task != nullptr) {
    const rt::TaskBlame b = rt::blame(op.log, *task);
    rt::TaskTotals totals{b.completed, 0, b.aborted, b.skipped, 0};
    for (const auto& t : op.totals) {
      if (t.task == task->id) totals = t.totals;
    }
    const auto miss = [&](rt::Cause c) {
      return static_cast<double>(b.misses[static_cast<std::size_t>(c)]);
    };
    // Releases dropped after the last recorded job have no record to blame them on.
    const std::uint64_t tail = totals.skipped > b.skipped ? totals.skipped - b.skipped : 0;
    m.add("haptic.releases",
          static_cast<double>(totals.completed + totals.aborted + totals.skipped), "1");
    m.add("haptic.completed", static_cast<double>(totals.completed), "1");
    m.add("haptic.skipped", static_cast<double>(totals.skipped), "1");
    m.add("haptic.aborted", static_cast<double>(totals.aborted), "1");
    m.add("haptic.miss_total", static_cast<double>(b.miss_total + tail), "1");
    m.add("haptic.miss_own", miss(rt::Cause::kOwn), "1");
    m.add("haptic.miss_platform", miss(rt::Cause::kPlatform), "1");
    m.add("haptic.miss_charged", miss(rt::Cause::kCharged), "1");
    m.add("haptic.miss_queued", miss(rt::Cause::kQueued), "1");
    m.add("haptic.miss_carried", miss(rt::Cause::kCarried), "1");
    m.add("haptic.miss_unknown", miss(rt::Cause::kUnknown) + static_cast<double>(tail), "1");
    m.add("haptic.cpu_p50_us", 1e-3 * static_cast<double>(cpu_quantile(*task, 0.5)), "us");
    m.add("haptic.cpu_p99_us", 1e-3 * static_cast<double>(cpu_quantile(*task, 0.99)), "us");
    if (const auto late = late_beyond_sentinel_us(op.log, *task))
      m.add("haptic.late_minus_sentinel_p999_us", *late, "us");
    const auto late_platform =
        static_cast<double>(b.late[static_cast<std::size_t>(rt::Cause::kPlatform)]);
    m.add("platform.late_share",
          jobs_of(*task) == 0 ? 0 : late_platform / static_cast<double>(jobs_of(*task)), "1");
  }
  const HapticTally t = haptic_tally(info, op);
  const auto n = static_cast<double>(std::max<std::uint64_t>(1, t.ticks));
  m.add("haptic.force_max_N", t.force_N, "N");
  m.add("haptic.force_step_max_N", t.step_N, "N");
  m.add("haptic.force_step_raw_max_N", t.step_raw_N, "N");
  m.add("haptic.contact_share", static_cast<double>(t.contact) / n, "1");
  m.add("haptic.contacts", static_cast<double>(t.contacts), "1");
  m.add("haptic.guard_share",
        static_cast<double>(t.guard) / static_cast<double>(std::max<std::uint64_t>(1, t.contact)),
        "1");
  m.add("haptic.reach_max", t.reach, "1");
  m.add("haptic.clutched_share", static_cast<double>(t.clutched) / n, "1");
  m.add("haptic.device_brakes", op.view.device_brakes, "1");
  m.add("operator.engages", op.view.engages, "1");
  m.add("operator.clears", op.view.clears, "1");
  m.add("haptic.not_finite", static_cast<double>(t.not_finite), "1");
}

void add_method_metrics(const RunInfo& info, const OperatorHalf& op, Metrics& m) {
  if (info.touch_method.empty()) return;
  const HapticTally t = haptic_tally(info, op);
  m.add("haptic.method", info.touch_method, "name");
  m.add("haptic.jumps", static_cast<double>(t.jumps), "1");
  m.add("haptic.flips", static_cast<double>(t.flips), "1");
}

void add_robot_metrics(const OperatorHalf& op, const RobotHalf& robot, Metrics& m) {
  const auto& truth = robot.view.truth;
  m.add("robot.path_m", truth.empty() ? 0 : truth.back().path_m, "m");
  m.add("robot.collisions", truth.empty() ? 0 : truth.back().collisions, "1");
  m.add("robot.tracking_error_max_m", robot.view.tracking_error_max_m, "m");
  if (!op.view.paths.empty() && !truth.empty()) {
    const auto& path = op.view.paths.back();
    const auto& end = path.points[static_cast<std::size_t>(path.size - 1)];
    m.add("robot.goal_error_m", std::hypot(truth.back().x_m - end[0], truth.back().y_m - end[1]),
          "m");
    m.add("robot.mark_error_m",
          std::hypot(truth.back().x_m - path.marked_W.x(), truth.back().y_m - path.marked_W.y()),
          "m");
  }
  m.add("robot.held_s", op.view.held_s, "s");
  if (op.view.world.follows_camera) {
    m.add("robot.stated_error_max_m", op.view.error_max_m, "m");
    m.add("robot.unsure_s", op.view.unsure_s, "s");
  }
  double worst = -1;
  for (const auto& a : op.view.arrived) {
    const auto true_WB = true_base_at(robot, a.stamp), X_OB = odometry_at(robot, a.stamp);
    if (!true_WB || !X_OB) continue;
    worst = std::max(worst, std::hypot(true_WB->x - a.goal_x_m, true_WB->y - a.goal_y_m));
    if (&a == &op.view.arrived.back())
      m.add("robot.goal_error_uncorrected_m",
            std::hypot(true_WB->x - X_OB->x, true_WB->y - X_OB->y), "m");
  }
  m.add("robot.arrivals", static_cast<double>(op.view.arrivals), "1");
  if (worst >= 0) m.add("robot.arrival_error_max_m", worst, "m");
  if (op.view.arrivals > 0 && !op.view.paths.empty()) {
    m.add("scene.touch_to_goal_ms",
          1e3 * rt::seconds(op.view.first_arrival - op.view.paths.front().mark_stamp), "ms");
  }
}

}  // namespace

std::vector<OrdinaryShare> ordinary_shares(const RunInfo& info, const OperatorHalf& op,
                                           const RobotHalf& robot) {
  std::vector<OrdinaryShare> out;
  if (op.ordinary.span_ns <= 0 || robot.ordinary.span_ns <= 0) return out;
  const std::pair<const char*, std::int64_t OrdinaryCpu::*> threads[] = {
      {"link", &OrdinaryCpu::link_ns},
      {"console", &OrdinaryCpu::console_ns},
      {"camera_twin", &OrdinaryCpu::camera_twin_ns}};
  for (const auto& load : info.best_effort) {
    for (const auto& [name, cpu] : threads) {
      if (load.name != name) continue;
      double share = 0;
      for (const auto* o : {&op.ordinary, &robot.ordinary})
        share += static_cast<double>(o->*cpu) / static_cast<double>(o->span_ns);
      out.push_back({name, share, load.share});
    }
  }
  return out;
}

std::string beyond_admission(const RunInfo& info, const OperatorHalf& op, const RobotHalf& robot) {
  if (info.virtual_clock || info.admission.tasks.empty()) return {};
  double beyond = 0;
  std::string who;
  for (const auto& o : ordinary_shares(info, op, robot)) {
    if (o.share <= o.declared) continue;
    beyond += o.share - o.declared;
    char text[80];
    std::snprintf(text, sizeof text, "%s%s %.3f of a core, declared %.3f", who.empty() ? "" : ", ",
                  o.name.c_str(), o.share, o.declared);
    who += text;
  }
  if (beyond <= std::max(0.0, info.admission.spare)) return {};
  char text[160];
  std::snprintf(text, sizeof text,
                "%.3f of a core beyond what was declared; the admitted cores have %.3f to spare: "
                "give the boxes another core",
                beyond, std::max(0.0, info.admission.spare));
  return "ordinary threads took more CPU than declared (" + who + "): " + text;
}

std::string not_measured(const RunInfo& info, const OperatorHalf& op, const RobotHalf& robot,
                         const Metrics& m) {
  if (!info.not_real_time.empty()) return info.not_real_time;
  if (info.virtual_clock) return "simulated time says nothing of this machine's timing";
  std::string why = real_time(op, robot) ? "" : "no real-time rights (teletact doctor)";
  for (const auto& row : m.rows()) {
    if (row.name != "platform.late_share" || row.value <= kLateShareLimit) continue;
    char text[120];
    std::snprintf(text, sizeof text,
                  "%.1f %% of the haptic starts were late by the platform, above %.0f %%",
                  100 * row.value, 100 * kLateShareLimit);
    why += (why.empty() ? "" : "; ") + std::string(text);
  }
  return why;
}

// Of firm tasks how many a job makes; of hard ones all together, which is to be 0. Only where the
// program counts.
static void add_allocation_metrics(const OperatorHalf& op, const RobotHalf& robot, Metrics& m) {
  double hard = -1;
  for (const auto* log : {&op.log, &robot.log}) {
    for (const rt::TaskLog& t : log->tasks) {
      const TaskAllocations a = allocations_of(t);
      if (a.jobs == 0) continue;
      if (t.spec.task_class == rt::TaskClass::kHard) {
        hard = std::max(0.0, hard) + a.total;
        continue;
      }
      m.add(t.spec.name + ".allocations_p50", a.p50, "1");
      m.add(t.spec.name + ".allocations_p99", a.p99, "1");
      m.add(t.spec.name + ".allocations_max", a.max, "1");
    }
  }
  if (hard >= 0) m.add("hard.allocations", hard, "1");
}

static void add_fusion_metrics(const RunInfo& info, const OperatorHalf& op, const RobotHalf& robot,
                               Metrics& m) {
  FusionTally fused = op.view.fusion_past;
  for (const auto& s : op.view.fusion) fused.add(s);
  std::uint64_t consumed = fused.consumed, tracked = fused.tracked, claimed = fused.claimed;
  if (info.recording) {
    // The last frame is held: of its repetitions only the first is one of the recording.
    m.add("fusion.held_frames", static_cast<double>(consumed - info.recorded.frames), "1");
    consumed = info.recorded.frames;
    tracked = info.recorded.tracked;
    claimed = info.recorded.claimed;
    if (info.recorded.ate_first_pose_mm >= 0)
      m.add("fusion.ate_first_pose_mm", info.recorded.ate_first_pose_mm, "mm");
  }
  if (info.ate_first_pose_mm >= 0) m.add("fusion.ate_first_pose_mm", info.ate_first_pose_mm, "mm");
  m.add("fusion.frames", static_cast<double>(consumed), "1");
  m.add("fusion.frames_tracked", static_cast<double>(tracked), "1");
  m.add("fusion.frames_claimed", static_cast<double>(claimed), "1");
  m.add("fusion.frames_moving", static_cast<double>(fused.moving), "1");
  m.add("fusion.moving_cells_max", fused.moving_cells, "1");
  if (op.view.objects.seq != 0) {
    m.add("fusion.objects_named", op.view.objects_named, "1");
    m.add("fusion.objects", op.view.objects.size, "1");
  }
  const auto* fusion = task_of(op, robot, tasks::TaskId::kFusion);
  if (fusion == nullptr) return;
  const auto [seen, lost] = frames_seen(*fusion, info.piece);
  m.add("fusion.frames_overwritten", static_cast<double>(lost), "1");
  m.add("fusion.frames_overwritten_share",
        static_cast<double>(lost) / static_cast<double>(std::max<std::uint64_t>(1, seen + lost)),
        "1");
  m.add("fusion.cpu_p50_ms", 1e-6 * static_cast<double>(cpu_quantile(*fusion, 0.5)), "ms");
  m.add("fusion.cpu_p99_ms", 1e-6 * static_cast<double>(cpu_quantile(*fusion, 0.99)), "ms");
}

static void add_visit_metrics(const OperatorHalf& op, Metrics& m) {
  if (op.view.visits.empty()) return;
  const TouchedPlaces touched = touched_of(op);
  m.add("visits.count", static_cast<double>(touched.visits.size()), "1");
  m.add("visits.met", touched.met(), "1");
  for (std::size_t k = 0; k < touched.touched.size(); ++k)
    m.add(std::string("visits.") + name_of(static_cast<TouchPlace::Kind>(k)), touched.touched[k],
          "1");
}

static void add_run_metrics(const RunInfo& info, const OperatorHalf& op, const RobotHalf& robot,
                            Metrics& m) {
  m.add("run.realtime", real_time(op, robot) && !info.virtual_clock ? 1 : 0, "1");
  m.add("run.measured", not_measured(info, op, robot, m).empty() ? 1 : 0, "1");
  if (info.paced) {
    m.add("run.wall_s", info.wall_s, "s");
    m.add("run.lag_s", info.lag_s, "s");
  }
  m.add("run.stopped_early", info.stopped_early.empty() ? 0 : 1, "1");
  m.add("run.problems", static_cast<double>(info.problems.size()), "1");
  if (!info.virtual_clock) return;
  char hash[20];
  std::snprintf(hash, sizeof hash, "%016llx", static_cast<unsigned long long>(info.sched_hash));
  m.add("run.sched_hash", std::string(hash), "hash");
  std::snprintf(hash, sizeof hash, "%016llx", static_cast<unsigned long long>(info.log_hash));
  m.add("run.log_hash", std::string(hash), "hash");
}

void add_metrics(const RunInfo& info, const OperatorHalf& op, const RobotHalf& robot, Metrics& m) {
  add_haptic_metrics(info, op, robot, m);
  add_method_metrics(info, op, m);
  add_fusion_metrics(info, op, robot, m);
  if (op.force_check.samples > 0)
    m.add("haptic.force_error_p95", op.force_check.relative_error_p95, "1");
  m.add("haptic.force_samples", static_cast<double>(op.force_check.samples), "1");
  add_visit_metrics(op, m);
  m.add("mark.count", op.view.task.marks, "1");
  m.add("plan.paths", op.view.task.paths, "1");
  add_robot_metrics(op, robot, m);
  m.add("log.dropped", static_cast<double>(op.view.log_dropped + robot.view.log_dropped), "1");
  m.add("audit.dropped", static_cast<double>(op.dropped_records + robot.dropped_records), "1");
  m.add("effects.constructed", static_cast<double>(info.effects.size()), "1");
  add_link_metrics(op.link, op.link_round_trip_ns, m);
  for (const auto& o : ordinary_shares(info, op, robot)) {
    m.add("best_effort." + o.name + "_share", o.share, "1");
    m.add("best_effort." + o.name + "_declared", o.declared, "1");
  }
  add_allocation_metrics(op, robot, m);
  if (!info.admission.tasks.empty()) m.add("admission.spare_share", info.admission.spare, "1");
  add_run_metrics(info, op, robot, m);
}

}  // namespace teletact
