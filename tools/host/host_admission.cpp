#include "tools/host/host_admission.hpp"

#include <algorithm>
#include <cstdio>
#include <optional>

#include "tasks/graph/calibration.hpp"
#include "tasks/graph/frame_phase.hpp"
#include "tasks/graph/picture_cost.hpp"
#include "tools/scene/box_devices.hpp"
#include "tools/scene/page_hook.hpp"

namespace teletact {

namespace {

bool names(const config::Section& s, const std::string& section, const std::string& key) {
  for (const auto& f : s.fields()) {
    const auto* sub = std::get_if<std::unique_ptr<config::Section>>(&f->value);
    if (f->key != section || sub == nullptr) continue;
    const std::size_t dot = key.find('.');
    return dot == std::string::npos ? (*sub)->named(key)
                                    : names(**sub, key.substr(0, dot), key.substr(dot + 1));
  }
  return false;
}

// What a refusal says beside its figures.
std::string ray_cast_text(const tasks::Calibration& given, std::int64_t job_us) {
  const std::string asks = "; haptic.method = \"force_shading\" ";
  if (given.ray_cast) return asks + "is included in the measured costs of fusion and haptic";
  char text[120];
  std::snprintf(text, sizeof text,
                "adds %.1f ms to a job of fusion and %.2f ms to a tick of haptic",
                1e-3 * static_cast<double>(job_us), 1e-3 * tasks::kReduction_us);
  return asks + text;
}

// What one box asks of a host that it has for itself.
void keep_box(rt::AdmissionRequest& r, rt::Box box, const tasks::BestEffortShares& shares) {
  std::erase_if(r.tasks, [box](const rt::TaskSpec& t) { return t.box != box; });
  std::erase_if(r.platform, [box](const rt::PlatformTask& p) { return p.spec.box != box; });
  std::erase_if(r.best_effort, [box](const rt::BestEffortLoad& b) {
    return b.name == "camera_twin" && box != rt::Box::kRobot;
  });
  for (rt::BestEffortLoad& b : r.best_effort) {
    if (b.name == "console")
      b.share = shares.console + (box == rt::Box::kOperator ? shares.page : 0);
    else if (b.name != "camera_twin")
      b.share *= 0.5;  // declared for both boxes
  }
  std::erase_if(r.degrade_order, [&r](const std::string& name) {
    return std::none_of(r.tasks.begin(), r.tasks.end(),
                        [&name](const rt::TaskSpec& t) { return t.name == name; });
  });
}

// Modes, and what the registry gets, of a request that was admitted.
void add_modes(HostPlan& plan) {
  plan.modes = rt::analyse_modes(plan.request, plan.admission,
                                 tasks::mode_sets(plan.request, plan.admission));
  plan.refusal = plan.modes.refusal;
  plan.held = rt::largest_of(plan.request, plan.admission, plan.modes);
  plan.held_rows = rt::admit(plan.held);
  if (plan.refusal.empty() && !plan.held_rows.admitted)
    plan.refusal = "modes that exclude each other: " + plan.held_rows.refusal;
}

}  // namespace

std::int64_t ray_cast_us(const Scene& scene) {
  if (!scene.graph.haptic.asks_for_ray_cast()) return 0;
  const std::int64_t parts = scene.graph.fusion.surface_periods;
  return (tasks::kRayCast_us + parts - 1) / parts;
}

namespace {

tasks::PictureCost picture_cost_of(const Scene& scene) {
  const auto& pictures = scene.graph.capture.pictures;
  // A recording is opened for its size only where that counts.
  return pictures.on_demand() ? tasks::picture_cost(pictures, camera_of(scene))
                              : tasks::PictureCost{};
}

}  // namespace

tasks::Calibration as_asked(const tasks::Calibration& given, const Scene& scene) {
  const auto& pictures = scene.graph.capture.pictures;
  const tasks::PictureCost cost = picture_cost_of(scene);
  tasks::Calibration c = tasks::with_pictures(tasks::with_ray_cast(given, ray_cast_us(scene)),
                                              pictures.dialect(), cost.encode_us);
  if (c.link_share >= 0 && c.pictures != given.pictures) c.link_share += cost.decode_share;
  return c;
}

tasks::ChoiceLimits choice_limits(const Scene& scene) {
  tasks::ChoiceLimits limits;
  const auto& fusion = scene.graph.fusion;
  if (names(scene.schema, "fusion", "tsdf.voxel_size_m"))
    limits.named_voxel_m = fusion.tsdf.voxel_size_m;
  limits.patch_nodes = fusion.patch_nodes;
  limits.needed_half_extent_m = tasks::FusionTask::needed_half_extent(
      scene.device.speed_limit_m_per_s, scene.graph.haptic.scale);
  limits.ray_cast_us = ray_cast_us(scene);
  limits.encode_us = picture_cost_of(scene).encode_us;
  return limits;
}

tasks::BestEffortShares declared_shares(const Scene& scene, const tasks::Calibration& calibration,
                                        bool page) {
  tasks::BestEffortShares shares;
  // The camera's twin renders on an ordinary thread; a recording needs none.
  if (scene.rgbd_dir.empty()) shares.camera_twin = tasks::declared_twin_share(calibration);
  if (page) shares.page = kPageShare;
  // Declared for both boxes together, although one of them decodes.
  shares.link = 0.5 * declared_link_share(scene, calibration);
  return shares;
}

double declared_link_share(const Scene& scene, const tasks::Calibration& calibration) {
  const bool with_codecs =
      calibration.link_share >= 0 && calibration.pictures == scene.graph.capture.pictures.dialect();
  return tasks::declared_link_share(calibration) +
         (with_codecs ? 0 : picture_cost_of(scene).decode_share);
}

namespace {

HostPlan admit_some(const Scene& scene, const tasks::Calibration& given,
                    const std::vector<int>& cpus, tasks::BestEffortShares shares,
                    const std::string& only_choice, std::optional<rt::Box> box) {
  HostPlan plan;
  const tasks::ChoiceLimits limits = choice_limits(scene);
  const tasks::Calibration calibration = as_asked(given, scene);
  std::vector<rt::TaskSpec> specs = tasks::make_specs(calibration, limits);
  for (rt::TaskSpec& s : specs) {
    for (rt::StaticChoice& c : s.choices) {
      if (!only_choice.empty() && c.name != only_choice)
        c.ruled_out = "another one is being measured";
    }
  }
  plan.request = tasks::make_request(specs, cpus, shares, scene.graph.pool, calibration);
  for (std::size_t i = 0; i < plan.request.tasks.size(); ++i) {
    if (!box || plan.request.tasks[i].box == *box)
      plan.ids.push_back(static_cast<std::uint16_t>(i));
  }
  if (box) {
    keep_box(plan.request, *box, shares);
    std::erase_if(specs, [box](const rt::TaskSpec& s) { return s.box != *box; });
  }
  plan.admission = rt::admit(plan.request);
  plan.refusal = plan.admission.refusal;
  if (!plan.refusal.empty() && limits.ray_cast_us > 0)
    plan.refusal += ray_cast_text(given, limits.ray_cast_us);
  if (!plan.admission.admitted) return plan;
  plan.specs = rt::settled_as(plan.admission, specs);
  if (!box) tasks::set_fusion_phase(plan.specs, plan.admission, calibration, scene.link.way());
  plan.workers = rt::settled_as(plan.admission, plan.request.tasks);
  plan.workers.erase(plan.workers.begin(),
                     plan.workers.begin() + static_cast<std::ptrdiff_t>(plan.specs.size()));
  for (std::size_t i = 0; i < plan.specs.size(); ++i) {
    if (plan.ids[i] != tasks::index_of(tasks::TaskId::kFusion)) continue;
    for (rt::TaskSpec& w : plan.workers) w.offset = plan.specs[i].offset;
    plan.voxel_m = tasks::chosen_voxel_m(plan.specs[i], limits);
  }
  add_modes(plan);
  return plan;
}

}  // namespace

HostPlan admit_host(const Scene& scene, const tasks::Calibration& given,
                    const std::vector<int>& cpus, tasks::BestEffortShares shares,
                    const std::string& only_choice) {
  return admit_some(scene, given, cpus, shares, only_choice, std::nullopt);
}

HostPlan admit_box(const Scene& scene, const tasks::Calibration& given,
                   const std::vector<int>& cpus, tasks::BestEffortShares shares, rt::Box box) {
  return admit_some(scene, given, cpus, shares, {}, box);
}

std::string admission_text(const HostPlan& plan) {
  return rt::report_table(plan.admission) + rt::mode_report(plan.modes);
}

rt::PlacedTask placed_task(const HostPlan& plan, std::size_t task) {
  const rt::AdmittedTask& row = plan.admission.tasks[task];
  rt::PlacedTask p;
  p.spec = task < plan.specs.size() ? plan.specs[task] : plan.workers[task - plan.specs.size()];
  p.id = plan.ids[task];
  p.core = row.cpu;
  p.priority = row.priority;
  p.level = row.level;
  p.last_level = row.last_level;
  return p;
}

rt::RunLog log_header(const std::vector<rt::PlacedTask>& placed, rt::Box box,
                      const tasks::Calibration& calibration) {
  rt::RunLog log;
  for (const auto& p : placed) {
    if (p.spec.box != box) continue;
    rt::TaskLog t;
    t.spec = p.spec;
    t.id = p.id;
    t.core = p.core;
    t.priority = p.priority;
    t.level = p.level;
    if (const auto* row = calibration.find(p.spec, p.level)) {
      t.work_min = static_cast<std::uint64_t>(row->work_min);
      t.work_max = static_cast<std::uint64_t>(row->work_max);
    }
    log.tasks.push_back(std::move(t));
  }
  return log;
}

}  // namespace teletact
