// Parts of a run's report: the figures of a task from its jobs; what went well and what did not.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

#include "tasks/contract/table.hpp"
#include "tools/host/run_results.hpp"
#include "tools/host/task_times.hpp"

namespace teletact {

namespace {

const char* const kPolicies[] = {"skip", "catch_up", "abort", "degrade"};

ReportTask::Quantiles quantiles(const rt::Histogram& h) {
  const auto us = [&](double q) { return static_cast<double>(h.quantile(q)) * 1e-3; };
  return {us(0.5), us(0.99), us(0.999), static_cast<double>(h.max()) * 1e-3};
}

// By the graph's table; a file of another table gets a number.
std::string level_name(const rt::TaskLog& task, int level) {
  if (task.id < tasks::kTaskTable.size()) {
    const auto& row = tasks::kTaskTable[task.id];
    const auto at = static_cast<std::size_t>(level);
    if (row.name == task.spec.name && at < row.variants.size() && !row.variants[at].name.empty())
      return std::string(row.variants[at].name);
  }
  return "level " + std::to_string(level);
}

plot::Bins bins(const std::string& name, const rt::Histogram& h) {
  // Half-octave bins from 1 us: fine enough to see modes, coarse enough to read.
  plot::Bins b;
  b.name = name;
  std::vector<double> edges;
  for (double e = 1.0; e < 1e6; e *= std::sqrt(2.0)) edges.push_back(e);
  std::vector<double> count(edges.size(), 0);
  h.for_each([&](std::int64_t lower_ns, std::int64_t, std::uint64_t n) {
    const double us = static_cast<double>(lower_ns) * 1e-3;
    const auto it = std::upper_bound(edges.begin(), edges.end(), us);
    count[it == edges.begin() ? 0 : static_cast<std::size_t>(it - edges.begin() - 1)] +=
        static_cast<double>(n);
  });
  std::size_t last = 0;
  for (std::size_t i = 0; i < count.size(); ++i) {
    if (count[i] > 0) last = i;
  }
  b.lower.assign(edges.begin(), edges.begin() + static_cast<std::ptrdiff_t>(last + 1));
  b.count.assign(count.begin(), count.begin() + static_cast<std::ptrdiff_t>(last + 1));
  b.upper_end = edges[std::min(last + 1, edges.size() - 1)];
  return b;
}

rt::Histogram sentinel_of(const rt::RunLog& log, int core) {
  rt::Histogram h;
  if (const auto past = log.past_sentinels.find(core); past != log.past_sentinels.end())
    h = past->second;
  for (const auto& s : log.sentinels) {
    if (s.core == core) h.record(s.late_ns);
  }
  return h;
}

using State = ReportVerdict::State;

// By name; 0 where there is none.
class Values {
 public:
  explicit Values(const Metrics& m) : metrics_(m) {}
  [[nodiscard]] double operator()(const std::string& name) const {
    for (const auto& r : metrics_.rows()) {
      if (r.name == name) return r.value;
    }
    return 0.0;
  }
  [[nodiscard]] bool known(const std::string& name) const {
    const auto& rows = metrics_.rows();
    return std::any_of(rows.begin(), rows.end(), [&](const auto& r) { return r.name == name; });
  }

 private:
  const Metrics& metrics_;
};

// What libraries took from the heap within the steps; where the program counts.
void add_allocations(const ReportData& d, std::vector<ReportVerdict>& verdicts) {
  std::string firm;
  double hard = -1;
  char text[100];
  for (const ReportTask& t : d.tasks) {
    if (t.allocations_max < 0) continue;
    if (t.task_class == "hard") {
      hard = std::max(hard, t.allocations_max);
      continue;
    }
    std::snprintf(text, sizeof text, "%s %.0f a job, at most %.0f; ", t.name.c_str(),
                  t.allocations_p50, t.allocations_max);
    firm += text;
  }
  if (firm.empty() && hard < 0) return;
  std::snprintf(text, sizeof text, "hard tasks %s", hard > 0 ? "ALLOCATE" : "none");
  verdicts.push_back({hard > 0 ? ReportVerdict::State::kBad : ReportVerdict::State::kGood,
                      "allocations by libraries: " + firm + text});
}

// Each place that the hand chose, and what came of it.
void add_visits(const OperatorHalf& op, ReportData& d) {
  const TouchedPlaces touched = touched_of(op);
  for (std::size_t i = 0; i < op.view.visits.size(); ++i) {
    const Touched& t = touched.visits[i];
    char text[80];
    std::snprintf(text, sizeof text, ": %.2f s in contact, largest force %.2f N", t.contact_s,
                  t.force_max_N);
    const Visit& v = op.view.visits[i];
    d.verdicts.push_back(
        {t.met() ? State::kGood : State::kNote, "touch" + text_of(v) +
                                                    (t.met()     ? std::string(text)
                                                     : v.pressed ? std::string(": nothing met")
                                                                 : std::string())});
  }
}

// `untimed`: why nothing that is timed counts; empty: it does.
void add_touch(const RunInfo& info, const OperatorHalf& op, const Values& value,
               const std::string& untimed, ReportData& d) {
  char text[240];
  std::snprintf(
      text, sizeof text,
      "haptic: %.0f releases = %.0f completed + %.0f skipped + %.0f aborted; misses %.0f, own %.0f",
      value("haptic.releases"), value("haptic.completed"), value("haptic.skipped"),
      value("haptic.aborted"), value("haptic.miss_total"), value("haptic.miss_own"));
  if (value.known("haptic.releases"))
    d.verdicts.push_back({value("haptic.miss_own") == 0 ? State::kGood
                          : untimed.empty()             ? State::kBad
                                                        : State::kNote,
                          text});
  if (!value.known("haptic.contacts")) return;
  std::snprintf(text, sizeof text,
                "touch: %.0f contacts, largest force %.2f N, share of time in contact %.2f",
                value("haptic.contacts"), value("haptic.force_max_N"),
                value("haptic.contact_share"));
  d.verdicts.push_back({value("haptic.contacts") > 0 ? State::kGood : State::kNote,
                        text + (info.touch_method.empty() ? "" : "; method " + info.touch_method)});
  add_visits(op, d);
}

void add_objects(const OperatorHalf& op, ReportData& d) {
  if (op.view.objects.seq == 0) return;
  char text[240];
  const auto& list = op.view.objects;
  std::snprintf(text, sizeof text, "objects: %u named, %d held; answer to the newest mark: %s",
                op.view.objects_named, list.size,
                std::string(perception::text_of(list.answer)).c_str());
  d.verdicts.push_back({State::kNote, text});
  for (std::int32_t i = 0; i < list.size; ++i) {
    const auto& e = list.entries[static_cast<std::size_t>(i)];
    const perception::Vec3 c = e.X_WO * e.centre_m;
    std::snprintf(text, sizeof text,
                  "object %u: centre (%.3f, %.3f, %.3f) m, extent %.0f x %.0f x %.0f mm, colour "
                  "%u %u %u%s",
                  e.serial, c.x(), c.y(), c.z(), 1e3 * e.extent_m.x(), 1e3 * e.extent_m.y(),
                  1e3 * e.extent_m.z(), e.colour.r, e.colour.g, e.colour.b,
                  e.seen ? "" : ", not in view");
    d.verdicts.push_back({State::kNote, text});
  }
}

void add_fusion(const RunInfo& info, const OperatorHalf& op, const Values& value, ReportData& d) {
  char text[240];
  std::snprintf(text, sizeof text, "fusion: %.0f of %.0f frames tracked",
                value("fusion.frames_tracked"), value("fusion.frames"));
  if (value.known("fusion.frames"))
    d.verdicts.push_back(
        {value("fusion.frames_tracked") == value("fusion.frames") ? State::kGood : State::kNote,
         text});
  if (!info.piece) add_objects(op, d);
}

void add_robot(const OperatorHalf& op, const Values& value, ReportData& d) {
  char text[240];
  if (!value.known("mark.count")) {  // of a piece of the run
    std::snprintf(text, sizeof text, "robot: %.2f m driven, %.0f collisions", value("robot.path_m"),
                  value("robot.collisions"));
    if (value.known("robot.path_m"))
      d.verdicts.push_back({value("robot.collisions") == 0 ? State::kGood : State::kBad, text});
    return;
  }
  std::snprintf(text, sizeof text,
                "robot: %.0f marks, %.0f paths, %.2f m driven, goal error %.3f m, %.0f collisions",
                value("mark.count"), value("plan.paths"), value("robot.path_m"),
                value("robot.goal_error_m"), value("robot.collisions"));
  d.verdicts.push_back({value("robot.collisions") == 0 ? State::kGood : State::kBad, text});
  if (op.view.held_s > 0) {
    std::snprintf(text, sizeof text, "the robot was held for %.1f s with a mark to drive to: %s",
                  op.view.held_s,
                  held_text(op.view.held, op.view.held_ms, op.view.held_limit_ms).c_str());
    d.verdicts.push_back({State::kNote, text});
  }
  if (op.view.world.follows_camera) {
    std::snprintf(text, sizeof text,
                  "place of the robot: stated to %.0f mm at the worst, %.1f s stood for it",
                  1e3 * op.view.error_max_m, op.view.unsure_s);
    d.verdicts.push_back({op.view.unsure_s > 0 ? State::kNote : State::kGood, text});
  }
}

// Of the real clock.
void add_machine(const RunInfo& info, const OperatorHalf& op, const RobotHalf& robot,
                 const Values& value, const std::string& untimed, ReportData& d) {
  char text[240];
  std::snprintf(text, sizeof text,
                "machine: %.2f %% of the haptic starts were late by the platform",
                100 * value("platform.late_share"));
  d.verdicts.push_back(
      {untimed.empty() ? State::kGood : State::kNote,
       text + (untimed.empty() ? "" : "; timing NOT MEASURED in this run: " + untimed)});
  const State beyond = beyond_admission(info, op, robot).empty() ? State::kNote : State::kBad;
  for (const auto& o : ordinary_shares(info, op, robot)) {
    const bool within = o.share <= o.declared;
    std::snprintf(text, sizeof text, "ordinary thread %s: %.3f of a core, declared %.3f%s",
                  o.name.c_str(), o.share, o.declared,
                  within                   ? ""
                  : beyond == State::kNote ? "; the admitted cores can spare it"
                                           : "");
    d.verdicts.push_back({within ? State::kGood : beyond, text});
  }
  for (const auto* log : {&op.log, &robot.log}) {
    for (const auto& what : log->not_realtime)
      d.verdicts.push_back({State::kNote, "NOT REAL-TIME: " + what});
  }
  if (!info.give_rights.empty())
    d.verdicts.push_back({State::kNote, "to be real-time: " + info.give_rights});
}

}  // namespace

ReportTask report_task(const rt::RunLog& log, const rt::TaskLog& task,
                       const std::vector<BoxTotals>& totals, bool virtual_clock) {
  ReportTask r;
  r.name = task.spec.name;
  r.box = task.spec.box == rt::Box::kOperator ? "operator" : "robot";
  r.task_class = task.spec.task_class == rt::TaskClass::kHard ? "hard" : "firm";
  r.policy = kPolicies[static_cast<int>(task.spec.policy)];
  r.rate_hz = task.spec.rate.hz();
  r.core = task.core;
  r.priority = task.priority;
  const int level = last_level_of(task);
  r.budget_us = static_cast<double>(task.spec.budget_of(level).count()) * 1e-3;
  r.level = level_name(task, level);
  const rt::TaskBlame b = rt::blame(log, task);
  const auto cause = [&](rt::Cause c) { return b.misses[static_cast<std::size_t>(c)]; };
  r.completed = b.completed;
  r.aborted = b.aborted;
  r.skipped = b.skipped;
  for (const auto& t : totals) {
    if (t.task == task.id) {
      r.completed = t.totals.completed;
      r.aborted = t.totals.aborted;
      r.skipped = t.totals.skipped;
    }
  }
  const std::uint64_t tail = r.skipped > b.skipped ? r.skipped - b.skipped : 0;
  r.releases = r.completed + r.aborted + r.skipped;
  r.misses = b.miss_total + tail;
  r.own = cause(rt::Cause::kOwn);
  r.queued = cause(rt::Cause::kQueued);
  r.platform = cause(rt::Cause::kPlatform);
  r.carried = cause(rt::Cause::kCarried);
  r.charged = cause(rt::Cause::kCharged);
  r.unknown = cause(rt::Cause::kUnknown) + tail;
  if (const TaskAllocations a = allocations_of(task); a.jobs > 0) {
    r.allocations_p50 = a.p50;
    r.allocations_max = a.max;
  }
  const TaskTimes times = times_of(task);
  const rt::Histogram sentinel = sentinel_of(log, task.core);
  r.cpu_us = quantiles(times.cpu);
  r.lateness_us = quantiles(times.lateness);
  r.response_us = quantiles(times.response);
  const auto slack = [&](double q) { return 1e-3 * static_cast<double>(times.slack.quantile(q)); };
  r.slack_us = {slack(0.5), slack(0.01), slack(0.001),
                1e-3 * static_cast<double>(times.slack.least())};
  r.cpu_histogram = {bins("CPU", times.cpu)};
  r.lateness_histogram = {bins("task", times.lateness)};
  r.response_histogram = {bins("response", times.response)};
  if (!times.slack.above.empty()) r.slack_histogram.push_back(bins("left", times.slack.above));
  if (!times.slack.below.empty()) {
    r.slack_histogram.push_back(bins("deadline passed by", times.slack.below));
    r.slack_histogram.back().colour = "#b03a2e";
  }
  if (!virtual_clock && sentinel.count() > 0)
    r.lateness_histogram.push_back(bins("sentinel", sentinel));
  return r;
}

void add_verdicts(const RunInfo& info, const OperatorHalf& op, const RobotHalf& robot,
                  const Metrics& m, ReportData& d) {
  for (const auto& p : info.problems) d.verdicts.push_back({State::kBad, p});
  if (!info.not_real_time.empty()) d.verdicts.push_back({State::kNote, info.not_real_time});
  for (const auto& n : info.notes) d.verdicts.push_back({State::kNote, n});
  if (!info.stopped_early.empty()) d.verdicts.push_back({State::kNote, info.stopped_early});
  const Values value(m);
  const std::string untimed = not_measured(info, op, robot, m);
  add_touch(info, op, value, untimed, d);
  add_fusion(info, op, value, d);
  add_robot(op, value, d);
  add_allocations(d, d.verdicts);
  if (!info.virtual_clock) add_machine(info, op, robot, value, untimed, d);
}

}  // namespace teletact
