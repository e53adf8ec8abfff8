// Where the virtual clock's job records of one box go: to a store on the disk, or to memory,
// bounded either way.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "rt/store/memory_log.hpp"
#include "tools/host/run_options.hpp"
#include "tools/host/store_watch.hpp"
#include "tools/scene/page_hook.hpp"

namespace teletact {

class JobKeeper {
 public:
  // In memory: about five minutes of the default scene's tasks.
  static constexpr std::size_t kMostInMemory = 400000;

  // `log`: the header; gets the records, with a store when the run ends. Throws std::runtime_error
  // naming the folder.
  JobKeeper(const DemoOptions& options, rt::Box box, rt::RunLog& log);
  void add(const rt::JobRecord& record) {
    if (store_)
      store_->add(record);
    else
      memory_.add(record);
  }
  void look(const tasks::ModeMsg& mode, drivers::Spared spared, rt::Time now) {
    if (watch_) watch_->look(mode, spared, now);
  }
  void finish(const std::vector<BoxTotals>& totals);

 private:
  rt::RunLog& log_;
  rt::MemoryLog memory_;
  std::string folder_;
  RefusedFiles refused_;
  std::unique_ptr<rt::RunStore> store_;
  std::unique_ptr<StoreWatch> watch_;
};

// Of both boxes of a run. `run` holds their logs.
class JobKeepers {
 public:
  JobKeepers(const DemoOptions& options, VirtualRun& run) : options_(options), run_(run) {}
  // Once the logs have their headers.
  void start(rt::Time operator_epoch, rt::Time robot_epoch);
  void add(bool of_operator, const rt::JobRecord& record) {
    (of_operator ? *operator_ : *robot_).add(record);
    if (options_.page != nullptr) options_.page->job(record);
  }
  void look(const tasks::ModeMsg& op, const tasks::ModeMsg& robot, drivers::Spared spared,
            std::int64_t host_ns) {
    if (operator_) operator_->look(op, spared, kOperatorClock.from_host(host_ns));
    if (robot_) robot_->look(robot, spared, kRobotClock.from_host(host_ns));
  }
  void finish();
  // What the consoles saw, beside the stores.
  void save_views() const;

 private:
  const DemoOptions& options_;
  VirtualRun& run_;
  std::unique_ptr<JobKeeper> operator_, robot_;
};

}  // namespace teletact
