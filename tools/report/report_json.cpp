#include <algorithm>
#include <nlohmann/json.hpp>

#include "tools/report/report.hpp"

namespace teletact {

namespace {

nlohmann::ordered_json pairs_json(const std::vector<std::pair<std::string, std::string>>& rows) {
  auto out = nlohmann::ordered_json::object();
  for (const auto& [name, value] : rows) out[name] = value;
  return out;
}

nlohmann::ordered_json task_json(const ReportTask& t) {
  nlohmann::ordered_json j;
  j["name"] = t.name;
  j["box"] = t.box;
  j["class"] = t.task_class;
  j["policy"] = t.policy;
  j["rate_hz"] = t.rate_hz;
  j["core"] = t.core;
  j["priority"] = t.priority;
  j["budget_us"] = t.budget_us;
  j["level"] = t.level;
  j["response_bound_us"] = t.analysis_response_us;
  j["releases"] = t.releases;
  j["completed"] = t.completed;
  j["skipped"] = t.skipped;
  j["aborted"] = t.aborted;
  j["misses"] = {{"all", t.misses},      {"own", t.own},         {"queued", t.queued},
                 {"carried", t.carried}, {"charged", t.charged}, {"platform", t.platform},
                 {"unknown", t.unknown}};
  const std::pair<const char*, const ReportTask::Quantiles*> quantiles[] = {
      {"cpu_us", &t.cpu_us}, {"lateness_us", &t.lateness_us}, {"response_us", &t.response_us}};
  for (const auto& [name, q] : quantiles) {
    j[name] = {{"p50", q->p50}, {"p99", q->p99}, {"p99.9", q->p999}, {"max", q->max}};
  }
  if (t.allocations_max >= 0)
    j["allocations"] = {{"p50", t.allocations_p50}, {"max", t.allocations_max}};
  j["slack_us"] = {{"p50", t.slack_us.p50},
                   {"p1", t.slack_us.p1},
                   {"p0.1", t.slack_us.p01},
                   {"min", t.slack_us.least}};
  const std::pair<const char*, const std::vector<plot::Bins>*> histograms[] = {
      {"cpu_us", &t.cpu_histogram},
      {"lateness_us", &t.lateness_histogram},
      {"response_us", &t.response_histogram},
      {"slack_us", &t.slack_histogram}};
  for (const auto& [name, all] : histograms) {
    auto& list = j["histograms"][name] = nlohmann::ordered_json::array();
    for (const auto& b : *all) {
      list.push_back(
          {{"of", b.name}, {"lower", b.lower}, {"upper_end", b.upper_end}, {"count", b.count}});
    }
  }
  return j;
}

}  // namespace

std::string report_json(const ReportData& d) {
  auto out = nlohmann::ordered_json::parse(d.metrics.json());
  out["title"] = d.title;
  out["started"] = d.started;
  out["command_line"] = d.command;
  out["host_facts"] = pairs_json(d.host);
  out["seeds"] = pairs_json(d.seeds);
  auto& verdict_list = out["verdicts"] = nlohmann::ordered_json::array();
  for (const auto& v : d.verdicts) {
    const char* state = v.state == ReportVerdict::State::kGood   ? "good"
                        : v.state == ReportVerdict::State::kNote ? "note"
                                                                 : "bad";
    verdict_list.push_back({{"state", state}, {"text", v.text}});
  }
  auto& tasks = out["tasks"] = nlohmann::ordered_json::array();
  for (const auto& t : d.tasks) tasks.push_back(task_json(t));
  auto& admission = out["admission"];
  admission["choices"] = d.choices;
  admission["steps"] = d.steps;
  auto& modes = admission["modes"] = nlohmann::ordered_json::array();
  for (const auto& m : d.modes) {
    modes.push_back({{"name", m.name},
                     {"admitted", m.refusal.empty()},
                     {"refusal", m.refusal},
                     {"fullest_core", m.utilisation},
                     {"least_slack_ms", m.slack_ms}});
  }
  admission["table"] = d.admission;
  auto& effects = out["effects"] = nlohmann::ordered_json::array();
  for (const auto& [name, key] : d.effects) effects.push_back({{"name", name}, {"key", key}});
  auto& faults = out["faults"] = nlohmann::ordered_json::array();
  for (const auto& [name, count] : d.faults) faults.push_back({{"fault", name}, {"count", count}});
  out["calibration"] = d.calibration;
  out["config"] = d.config_toml;
  out["files"] = d.files;
  return out.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n";
}

}  // namespace teletact
