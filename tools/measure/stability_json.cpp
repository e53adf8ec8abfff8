#include "tools/measure/stability_json.hpp"

#include <cmath>
#include <nlohmann/json.hpp>

namespace teletact {

using nlohmann::ordered_json;

namespace {

// JSON has no NaN and no infinity.
ordered_json number_or_null(double v) {
  return std::isfinite(v) ? ordered_json(v) : ordered_json(nullptr);
}

}  // namespace

struct StabilityRecord::Rows {
  ordered_json checks = ordered_json::array();
};

StabilityRecord::StabilityRecord() : rows_(std::make_unique<Rows>()) {}
StabilityRecord::~StabilityRecord() = default;

void StabilityRecord::take(const stability::Case& c, const stability::Setting& s,
                           const stability::Gated& gated) {
  for (const stability::Run& run : gated.runs) {
    ordered_json head;
    head["case"] = c.id;
    head["name"] = c.name;
    head["run"] = run.name;
    head["method"] = s.method;
    head["layer"] = s.layer;
    head["placement"] = s.place.name;
    head["speed_mm_per_s"] = 1e3 * s.speed;
    head["tip_radius_mm"] = 1e3 * s.tip_radius_m;
    head["incidence_deg"] = s.fused != nullptr ? ordered_json(s.fused->incidence_deg) : nullptr;
    head["noise"] = s.fused != nullptr && s.fused->noise;
    for (const stability::Check& check : run.checks) {
      ordered_json row = head;
      row["check"] = check.name;
      row["value"] = number_or_null(check.value);
      row["limit"] = number_or_null(check.limit);
      row["optimum"] = number_or_null(check.optimum);
      row["optimum_is"] =
          std::isnan(check.optimum) ? ordered_json(nullptr) : stability::name_of(check.by);
      row["met"] = check.met();
      row["alone"] = number_or_null(check.alone.ours);
      row["alone_optimum"] = number_or_null(check.alone.optimum);
      row["field_bound"] = check.field_bound();
      rows_->checks.push_back(std::move(row));
    }
  }
}

std::string StabilityRecord::json(const Metrics& metrics) const {
  ordered_json out = ordered_json::parse(metrics.json());
  out["checks"] = rows_->checks;
  return out.dump(1, ' ', false, ordered_json::error_handler_t::replace) + "\n";
}

void add_metrics(Metrics& metrics, int id, const StabilityTally& t) {
  const std::string name = "stability.case" + std::to_string(id) + ".";
  metrics.add(name + "pass", t.within == t.settings ? 1 : 0, "1");
  metrics.add(name + "margin", t.margin, "1");
  metrics.add(name + "controller.pass", t.controller_passes() ? 1 : 0, "1");
  metrics.add(name + "controller.margin", t.controller_margin(), "1");
  metrics.add(name + "settings", t.settings, "1");
  metrics.add(name + "within", t.within, "1");
  metrics.add(name + "field_bound", t.field_bound, "1");
  metrics.add(name + "j_raw_N", t.j_raw_N, "N");
  metrics.add(name + "j_N", t.j_N, "N");
  metrics.add(name + "guard_share", t.guard_share, "1");
  metrics.add(name + "lag_ms", t.lag_ms, "ms");
  metrics.add(name + "position_mm", t.position_mm, "mm");
  metrics.add(name + "off_mm", t.off_mm, "mm");
  metrics.add(name + "step_p50_us", t.cpu_p50_us, "us");
  metrics.add(name + "step_p99_us", t.cpu_p99_us, "us");
  metrics.add(name + "step_max_us", t.cpu_max_us, "us");
}

void add_beside(Metrics& metrics, int id, const std::string& method, bool layer,
                const StabilityTally& t) {
  const std::string name =
      "stability.case" + std::to_string(id) + "." + method + (layer ? "." : ".layer_off.");
  metrics.add(name + "within", t.within, "1");
  metrics.add(name + "margin", t.margin, "1");
  metrics.add(name + "j_raw_N", t.j_raw_N, "N");
  metrics.add(name + "j_N", t.j_N, "N");
  metrics.add(name + "guard_share", t.guard_share, "1");
  metrics.add(name + "lag_ms", t.lag_ms, "ms");
  metrics.add(name + "position_mm", t.position_mm, "mm");
  metrics.add(name + "step_p99_us", t.cpu_p99_us, "us");
}

}  // namespace teletact
