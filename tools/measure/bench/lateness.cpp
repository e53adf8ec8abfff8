#include "tools/measure/bench/lateness.hpp"

#include <cstddef>
#include <stdexcept>
#include <string>
#include <vector>

#include "rt/audit/blame.hpp"
#include "rt/quantile.hpp"

namespace teletact {

const rt::TaskLog& task_of(const rt::RunLog& log, std::string_view name) {
  for (const auto& t : log.tasks)
    if (t.spec.name == name) return t;
  throw std::runtime_error("the run has no task " + std::string(name));
}

rt::TaskLog released_in(const rt::TaskLog& task, std::int64_t from_ns, std::int64_t to_ns) {
  rt::TaskLog out = task;
  out.past.reset();
  out.totals.reset();
  std::erase_if(out.jobs, [&](const rt::JobRecord& j) {
    return j.release_ns < from_ns || j.release_ns >= to_ns;
  });
  return out;
}

double late_p99_us(const rt::RunLog& log, std::string_view task, std::int64_t from_ns,
                   std::int64_t to_ns) {
  std::vector<double> us;
  for (const auto ns :
       rt::late_minus_sentinel(log, released_in(task_of(log, task), from_ns, to_ns)))
    us.push_back(1e-3 * static_cast<double>(ns));
  return rt::quantile_or_nan(us, 0.99);
}

std::uint64_t own_misses(const rt::RunLog& log) {
  std::uint64_t all = 0;
  for (const auto& t : log.tasks)
    all += rt::blame(log, t).misses[static_cast<std::size_t>(rt::Cause::kOwn)];
  return all;
}

}  // namespace teletact
