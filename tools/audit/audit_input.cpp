#include "tools/audit/audit_input.hpp"

#include <map>
#include <stdexcept>

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
  return in;
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
