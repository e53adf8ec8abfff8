#include "tools/measure/accuracy/moving_study.hpp"

#include <atomic>
#include <cmath>
#include <cstdio>
#include <mutex>
#include <sstream>
#include <thread>

#include "tools/measure/accuracy/fusion_study.hpp"
#include "tools/measure/accuracy/moving_peer.hpp"
#include "tools/record/fusion_feed.hpp"
#include "tools/record/scenes.hpp"

namespace teletact {

namespace {

using V = MovingVariant;

bool alone(const MovingRow& r) { return r.variant == V::kAlone; }
bool alone_low(const MovingRow& r) { return alone(r) && r.low(); }
bool alone_high(const MovingRow& r) { return alone(r) && !r.low(); }
bool odometry(const MovingRow& r) { return r.variant == V::kOdometry; }
bool lying_low(const MovingRow& r) { return r.variant == V::kLying && r.low(); }
bool hopeful(const MovingRow& r) { return alone(r) && !r.hopeless(); }

double claimed(const MovingRow& r) { return r.run.claimed; }
double wrong(const MovingRow& r) { return r.run.wrong; }
double above_plain(const MovingRow& r) { return r.above_plain_mm(); }
double iou(const MovingRow& r) { return r.run.mask_iou; }

}  // namespace

const std::vector<MovingCheck>& moving_checks() {
  static const std::vector<MovingCheck> checks{
      {"claimed_share.share30", "claimed, share <= .30", alone_low, claimed, 0.98, true},
      {"ate_mm.share30", "ATE above the plain run's, mm, share <= .30", alone_low, above_plain, 5,
       false},
      {"wrong_claims.share30", "claims more than 20 mm off, share <= .30", alone_low, wrong, 0,
       false},
      {"wrong_claims.share60", "claims more than 50 mm off, share .30 to .60", alone_high, wrong, 0,
       false},
      {"claimed_share.share60", "claimed, share .30 to .45, from rest",
       [](const MovingRow& r) { return alone_high(r) && r.share <= 0.45 && r.sample.from_rest; },
       claimed, 0.5, true},
      {"claimed_again", "frames to a claim after the share falls below .30", alone,
       [](const MovingRow& r) { return r.run.claimed_again; }, 15, false},
      {"odometry.claimed_share", "claimed with odometry", odometry, claimed, 0.95, true},
      {"odometry.ate_mm", "ATE above the plain run's, mm, with odometry", odometry, above_plain, 10,
       false},
      {"odometry.wrong_claims", "wrong claims with odometry (20 mm, above .30 50 mm)", odometry,
       wrong, 0, false},
      {"lying.wrong_claims", "claims more than 20 mm off, odometry lies, share <= .30", lying_low,
       wrong, 0, false},
      {"mask_iou", "IoU of the mask, share >= .05",
       [](const MovingRow& r) { return hopeful(r) && r.share >= 0.05; }, iou, 0.8, true},
      {"mask_iou.share5", "IoU of the mask, share < .05",
       [](const MovingRow& r) { return alone(r) && r.share < 0.05; }, iou, 0.6, true},
      {"masked_still", "still pixels masked, share of a run", alone,
       [](const MovingRow& r) { return r.run.masked_still; }, 0.01, false},
      {"masked_still_p95", "still pixels masked, p95 of a frame", alone,
       [](const MovingRow& r) { return r.run.masked_still_p95; }, 0.03, false},
      {"ghost_cm3", "ghost volume, cm3", alone, [](const MovingRow& r) { return r.run.ghost_cm3; },
       45, false},
      {"ghost_cells", "ghost cells of the cost map", alone,
       [](const MovingRow& r) { return r.run.ghost_cells; }, 0, false},
      {"ghost_nodes", "ghost nodes of a hand's window", alone,
       [](const MovingRow& r) { return r.run.ghost_nodes; }, 0, false},
      {"rest_frames", "frames from at rest to in the mesh",
       [](const MovingRow& r) { return alone(r) && r.share_last < 0.30; },
       [](const MovingRow& r) { return r.run.rest_frames; }, 20, false},
      {"rest_in_cost_map", "of what rests, in the cost map 20 frames later",
       [](const MovingRow& r) { return alone(r) && r.share_last < 0.30; },
       [](const MovingRow& r) { return r.run.rest_cost; }, 0.5, true},
  };
  return checks;
}

std::vector<std::string> failed_checks(const MovingRow& row) {
  std::vector<std::string> failed;
  for (const MovingCheck& c : moving_checks()) {
    if (!c.applies(row)) continue;
    const double v = c.figure(row);
    if (c.at_least ? v < c.limit : v > c.limit) failed.push_back(c.name);
  }
  return failed;
}

std::string line_of(const MovingRow& row) {
  const MovingRun& r = row.run;
  char line[400];
  std::snprintf(
      line, sizeof line,
      "    %g mm level %d %-8s claimed %.3f  ate %.1f (plain %.1f)  worst %.1f mm  wrong %d "
      "from %d  again %.0f  iou %.2f  still masked %.4f p95 %.4f  ghost %.0f cm3 %.0f cells %.0f "
      "nodes "
      " rest %.0f  cpu %.1f ms, at most %.1f:",
      row.setting.voxel_mm, row.setting.level, name_of(row.variant), r.claimed, r.ate_mm,
      row.plain.ate_mm, r.worst_mm, r.wrong, r.first_wrong, r.claimed_again, r.mask_iou,
      r.masked_still, r.masked_still_p95, r.ghost_cm3, r.ghost_cells, r.ghost_nodes, r.rest_frames,
      r.cpu_ms, r.cpu_most_ms);
  std::string text = line;
  const auto failed = failed_checks(row);
  for (const std::string& name : failed) text += " " + name;
  return text + (failed.empty() ? " ok\n" : "\n");
}

std::vector<MovingSetting> settings_of(const MovingSample& sample, const MovingOptions& options) {
  std::vector<MovingSetting> all;
  for (const double voxel_mm : options.voxels_mm) {
    for (const int level : options.levels)
      all.push_back({voxel_mm, level, options.surfaces, options.watch});
  }
  // Movers and halves of the shares come round after twelve samples.
  if (options.spread && !all.empty())
    all = {all[static_cast<std::size_t>(sample.index / 12) % all.size()]};
  return all;
}

std::vector<MovingRow> run_sample(rt::NonRealtime& nrt, const MovingSample& sample,
                                  const MovingOptions& options, std::ostream* said) {
  const MovingFilm film = film_moving(nrt, sample, options.colour, options.incidence);
  std::ostream* debug = options.debug ? said : nullptr;
  if (options.peers && said != nullptr) {
    for (const MovingPeer& peer : run_moving_peers(film)) *said << peer.text();
  }
  std::vector<MovingRow> rows;
  for (const MovingSetting& setting : settings_of(sample, options)) {
    MovingRow row;
    row.sample = sample, row.setting = setting;
    row.share = film.share_most, row.share_last = film.share.back();
    MovingSetting of = setting;
    of.surfaces = false;
    row.plain = run_moving(nrt, sample, film, V::kPlain, of, nullptr);
    for (const V v : {V::kAlone, V::kOdometry, V::kLying}) {
      if (!has_variant(sample, v) || (v != V::kAlone && !options.odometry)) continue;
      row.variant = v;
      of.surfaces = setting.surfaces && v == V::kAlone;
      if (debug != nullptr) *debug << name_of(v) << "\n";
      row.run = run_moving(nrt, sample, film, v, of, debug);
      rows.push_back(row);
    }
  }
  return rows;
}

MovingStudy study_moving(std::ostream& progress, const MovingOptions& options) {
  const int first = options.only >= 0 ? options.only : 0;
  const int end = options.only >= 0 ? options.only + 1 : options.samples;
  std::vector<std::vector<MovingRow>> of(static_cast<std::size_t>(end - first));
  std::atomic<int> next{first};
  std::mutex saying;
  std::string fault;
  const auto work = [&] {
    rt::Startup startup;
    for (int i = next++; i < end; i = next++) {
      try {
        const MovingSample sample = draw_moving_sample(startup.token(), options.seed, i);
        std::ostringstream said;
        auto& rows = of[static_cast<std::size_t>(i - first)];
        rows = run_sample(startup.token(), sample, options, &said);
        const std::lock_guard lock(saying);
        progress << sample.text() << "\n" << said.str();
        for (const MovingRow& row : rows) progress << line_of(row);
        progress.flush();
      } catch (const std::exception& e) {
        const std::lock_guard lock(saying);
        if (fault.empty()) fault = e.what();
        return;
      }
    }
  };
  std::vector<std::thread> crew;
  for (int j = 1; j < options.jobs; ++j) crew.emplace_back(work);
  work();
  for (std::thread& t : crew) t.join();
  if (!fault.empty()) throw std::runtime_error(fault);
  MovingStudy study;
  for (auto& rows : of) {
    for (auto& row : rows) study.rows.push_back(std::move(row));
  }
  return study;
}

std::vector<StaticMask> study_static_masks(std::ostream& progress, double voxel_mm, int frames) {
  rt::Startup startup;
  std::vector<StaticMask> masks;
  for (const std::string& name : scene_names()) {
    progress << "static " << name << "\n";
    const FusionSequence images = synthetic_sequence(startup.token(), scene_named(name), frames);
    tasks::FusionSetup setup;
    setup.camera = images.intrinsics;
    tasks::FusionTask task(startup.token(), fusion_with_voxel(1e-3 * voxel_mm), setup);
    FusionFeed feed(task);
    ClaimedError error;
    StaticMask m{name, 0, 0, 0};
    std::int64_t still = 0, hit = 0;
    for (int f = 0; f < images.size(); ++f) {
      images.frame(f, feed.frame());
      const auto& out = feed.step();
      if (out.camera.claimed) error.add(out.camera.X_WC, *images.truth(f)), m.claimed += 1;
      const auto mask = task.pixel_mask();
      for (int v = 0; v < mask.height; ++v) {
        for (int u = 0; u < mask.width; ++u) {
          if (images.depth_mm(f, u, v) == 0) continue;
          ++still;
          hit += mask.at(u, v) != 0 ? 1 : 0;
        }
      }
    }
    m.masked = static_cast<double>(hit) / static_cast<double>(std::max<std::int64_t>(1, still));
    m.claimed /= std::max(1, images.size());
    m.ate_mm = error.ate_mm();
    masks.push_back(m);
  }
  return masks;
}

}  // namespace teletact
