#include "tasks/graph/host_request.hpp"

#include "tasks/contract/messages.hpp"
#include "tasks/contract/table.hpp"

namespace tasks {

namespace {

rt::Nanos share_of(rt::Nanos d, double share) {
  return rt::Nanos{static_cast<std::int64_t>(static_cast<double>(d.count()) * share)};
}

// As the real executor has them (rt/sched/real_executor.hpp), one in each box's process.
rt::PlatformTask sentinel(const char* name, rt::Box box) {
  rt::PlatformTask p;
  p.spec.name = name;
  p.spec.box = box;
  p.spec.budget = rt::Nanos{6000};
  p.priority = rt::kSentinelPriority;
  p.wakes = rt::PlatformWakes::kAtReleases;
  return p;
}

rt::PlatformTask watchdog(const char* name, rt::Box box) {
  rt::PlatformTask p;
  p.spec.name = name;
  p.spec.box = box;
  p.spec.rate = {100, 1};
  p.spec.budget = rt::Nanos{20000};
  p.priority = rt::kWatchdogPriority;
  p.wakes = rt::PlatformWakes::kOnceABox;
  return p;
}

// Fusion as one that forks, and one row a worker.
void add_pool(const PoolConfig& pool, const Calibration& calibration,
              std::vector<rt::TaskSpec>& tasks) {
  if (pool.fusion_workers == 0) return;
  rt::TaskSpec& fusion = tasks[index_of(TaskId::kFusion)];
  rt::TaskSpec worker = fusion;
  fusion.forks = kForksPerImage;
  worker.parent = fusion.name;
  worker.consecutive_miss_limit = 0;
  for (rt::StaticChoice& c : fusion.choices) {
    for (std::size_t level = 0; level < c.variants.size(); ++level) {
      rt::Variant& v = c.variants[level];
      // Without a measurement: what is declared is the work of one thread.
      if (calibration.find(kWorkerRow, c.name, static_cast<int>(level)) == nullptr)
        v.budget = share_of(v.budget, kOwnShare);
      v.until_last_fork = share_of(v.budget, kBeforeShare);
      v.overlap = share_of(v.budget, kOverlapShare);
    }
  }
  for (rt::StaticChoice& c : worker.choices) {
    for (std::size_t level = 0; level < c.variants.size(); ++level) {
      const auto* row = calibration.find(kWorkerRow, c.name, static_cast<int>(level));
      rt::Variant& v = c.variants[level];
      v.budget = row != nullptr ? row->budget() : share_of(v.budget, kWorkerShare);
    }
  }
  for (int w = 1; w <= pool.fusion_workers; ++w) {
    worker.name = std::string(kWorkerRow) + std::to_string(w);
    tasks.push_back(worker);
  }
}

}  // namespace

void PoolConfig::describe(config::Section& s) {
  s.integer("fusion_workers", fusion_workers, 0, 8, "cores beside fusion's own; 0: none");
}

double declared_link_share(const Calibration& calibration) noexcept {
  const double measured = calibration.link_share;
  return measured < 0 ? 2 * BestEffortShares{}.link : 2 * kSocketsShare + kLinkMargin * measured;
}

double declared_twin_share(const Calibration& calibration) noexcept {
  const double measured = calibration.camera_twin_share;
  return measured < 0 ? kTwinShare : kTwinMargin * measured;
}

rt::AdmissionRequest make_request(const std::vector<rt::TaskSpec>& specs,
                                  const std::vector<int>& cpus, const BestEffortShares& shares,
                                  const PoolConfig& pool, const Calibration& calibration) {
  rt::AdmissionRequest r;
  r.tasks = specs;
  add_pool(pool, calibration, r.tasks);
  r.cpus = cpus;
  // Fusion gets its phase when admission has answered (frame_phase.hpp): off everybody's grid, so
  // that none of its releases counts as an instant at which the sentinel is awake anyway.
  const std::string& fusion = specs[index_of(TaskId::kFusion)].name;
  for (rt::TaskSpec& t : r.tasks) {
    if ((t.name == fusion || t.parent == fusion) && t.offset.count() == 0) t.offset = rt::Nanos{1};
  }
  r.platform = {sentinel("sentinel", rt::Box::kOperator), watchdog("watchdog", rt::Box::kOperator),
                sentinel("robot_sentinel", rt::Box::kRobot),
                watchdog("robot_watchdog", rt::Box::kRobot)};
  r.best_effort = {{"link", 2 * shares.link, {}},
                   {"console", 2 * shares.console + shares.page, {}}};
  if (shares.camera_twin > 0) r.best_effort.push_back({"camera_twin", shares.camera_twin, {}});
  r.degrade_order = {"fusion", "planning", "fusion", "capture", "fusion"};
  return r;
}

std::vector<rt::ModeSet> mode_sets(const rt::AdmissionRequest& request,
                                   const rt::Admission& admission) {
  struct Row {
    Mode mode;
    const char* name;
    bool safe;
  };
  constexpr Row kRows[] = {{Mode::kInit, "init", true},
                           {Mode::kHold, "hold", true},
                           {Mode::kEngaged, "engaged", false},
                           {Mode::kRampDown, "ramp_down", true},
                           {Mode::kSafeStop, "safe_stop", true}};
  std::vector<rt::ModeSet> sets;
  for (const Row& row : kRows) {
    rt::ModeSet set{row.name, row.safe, {}};
    for (std::size_t i = 0; i < request.tasks.size(); ++i) {
      const rt::AdmittedTask& t = admission.tasks[i];
      const bool degrades = request.tasks[i].policy == rt::MissPolicy::kDegrade;
      set.demands.push_back({true, t.level, degrades ? t.last_level : t.level});
    }
    sets.push_back(std::move(set));
  }
  return sets;
}

}  // namespace tasks
