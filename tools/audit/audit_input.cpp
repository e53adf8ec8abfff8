#include "tools/audit/audit_input.hpp"

#include <algorithm>
#include <cstdio>
#include <map>
#include <stdexcept>

#include "rt/audit/task_past.hpp"

namespace teletact {

namespace {

rt::RunLog read_log(const std::string& file, const rt::StorePiece& piece,
                    std::vector<rt::StoreEvent>& events) {
  if (!rt::is_store(file)) {
    auto log = rt::read_run(file, piece);
    if (!log) throw std::runtime_error(log.error());
    return std::move(log).value();
  }
  auto store = rt::read_store(file, piece);
  if (!store) throw std::runtime_error(store.error());
  auto& own = store.value().events;
  events.insert(events.end(), own.begin(), own.end());
  return std::move(store.value().log);
}

// Seconds since its start: of its epoch, or of its first job where it names none.
double end_of(const rt::RunLog& log) {
  std::int64_t first = log.epoch_ns, last = 0;
  for (const rt::TaskLog& t : log.tasks) {
    const std::int64_t from = t.past && t.past->jobs > 0 ? t.past->first_release_ns
                              : t.jobs.empty()           ? 0
                                                         : t.jobs.front().release_ns;
    if (log.epoch_ns == 0 && from != 0 && (first == 0 || from < first)) first = from;
    if (t.past) last = std::max(last, t.past->last_end_ns);
    for (const auto& j : t.jobs) last = std::max(last, j.end_ns);
  }
  return std::max(0.0, 1e-9 * static_cast<double>(last - first));
}

}  // namespace

AuditInput read_files(const std::vector<std::string>& files, const rt::StorePiece& piece) {
  AuditInput in;
  for (const auto& f : files) {
    if (!rt::is_black_box(f)) {
      in.logs.push_back(read_log(f, piece, in.events));
      continue;
    }
    if (!piece.all()) throw std::runtime_error(f + ": --from and --to are for the log of a run");
    auto box = rt::read_black_box(f);
    if (!box) throw std::runtime_error(box.error());
    in.boxes.emplace_back(f, std::move(box).value());
    in.logs.push_back(in.boxes.back().second.log);
  }
  std::vector<const rt::RunLog*> logs;
  for (const auto& log : in.logs) logs.push_back(&log);
  check_piece(files, logs, piece);
  return in;
}

void check_piece(const std::vector<std::string>& files, const std::vector<const rt::RunLog*>& logs,
                 const rt::StorePiece& piece) {
  const auto has_jobs = [](const rt::RunLog* log) {
    return std::any_of(log->tasks.begin(), log->tasks.end(), [](const rt::TaskLog& t) {
      return !t.jobs.empty() || (t.past && t.past->jobs > 0);
    });
  };
  if (piece.all() || std::any_of(logs.begin(), logs.end(), has_jobs)) return;
  double end_s = 0;
  for (const auto& file : files) {
    const auto whole = rt::read_run(file);
    if (whole) end_s = std::max(end_s, end_of(whole.value()));
  }
  char text[96];
  std::snprintf(text, sizeof text, "nothing of the run lies in that piece (it ends at %.6g s)",
                end_s);
  throw std::runtime_error(text);
}

std::vector<AuditedTask> tasks_of(const std::vector<rt::RunLog>& logs) {
  std::vector<AuditedTask> out;
  std::map<std::string, int> times;
  for (const auto& log : logs) {
    for (const auto& t : log.tasks) {
      const int n = ++times[t.spec.name];
      out.push_back({&log, &t, t.spec.name + (n > 1 ? "_" + std::to_string(n) : "")});
    }
  }
  return out;
}

}  // namespace teletact
