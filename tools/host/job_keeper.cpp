#include "tools/host/job_keeper.hpp"

#include <stdexcept>

#include "rt/store/read_store.hpp"

namespace teletact {

JobKeeper::JobKeeper(const DemoOptions& options, rt::Box box, rt::RunLog& log)
    : log_(log), memory_(log, kMostInMemory) {
  if (options.store_folder.empty()) return;
  folder_ = options.store_folder + (box == rt::Box::kOperator ? "/operator.run" : "/robot.run");
  rt::StoreOptions store = options.store;
  store.block_bytes = std::size_t{256} << 10U;  // nobody is to look at it while it runs
  store_ = std::make_unique<rt::RunStore>(folder_, log, store);
  // Simulated time is worth nothing without its records; a box that drives goes on without them.
  if (const std::string problem = store_->problem(); !problem.empty())
    throw std::runtime_error(folder_ + ": " + problem);
  watch_ = std::make_unique<StoreWatch>(*store_, box, folder_, refused_);
}

void JobKeeper::finish(const std::vector<BoxTotals>& totals) {
  for (const BoxTotals& t : totals) log_.find(t.task)->totals = t.totals;
  if (!store_) return;
  std::vector<rt::RunFileTotals> trailer;
  for (const BoxTotals& b : totals) trailer.push_back({b.task, b.totals});
  store_->finish(trailer, 0);
  watch_.reset();
  store_.reset();
  auto read = rt::read_run(folder_, kOfReport);
  if (!read) throw std::runtime_error(read.error());
  // The header in memory knows more of a task than the file does: names of its variants, its
  // parent.
  rt::RunLog got = std::move(read).value();
  for (rt::TaskLog& t : log_.tasks) {
    rt::TaskLog* from = got.find(t.id);
    if (from == nullptr) continue;
    t.jobs = std::move(from->jobs);
    t.past = std::move(from->past);
  }
  log_.told = std::move(got.told);
}

void JobKeepers::start(rt::Time operator_epoch, rt::Time robot_epoch) {
  run_.op.log.epoch_ns = rt::ns_of(operator_epoch);
  run_.robot.log.epoch_ns = rt::ns_of(robot_epoch);
  operator_ = std::make_unique<JobKeeper>(options_, rt::Box::kOperator, run_.op.log);
  robot_ = std::make_unique<JobKeeper>(options_, rt::Box::kRobot, run_.robot.log);
  if (options_.page == nullptr) return;
  options_.page->tasks(run_.op.log);
  options_.page->tasks(run_.robot.log);
}

void JobKeepers::finish() {
  operator_->finish(run_.op.totals);
  robot_->finish(run_.robot.totals);
}

void JobKeepers::save_views() const {
  if (options_.store_folder.empty()) return;
  const bool op = save_half(options_.store_folder, run_.op);
  if (!save_half(options_.store_folder, run_.robot) || !op)
    throw std::runtime_error(options_.store_folder + ": what the consoles saw can not be written");
}

}  // namespace teletact
