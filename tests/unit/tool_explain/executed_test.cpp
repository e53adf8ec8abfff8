// What no key of a scene asks for is neither built nor executed, counted where it is built and
// where it is executed (rt/effect_count.hpp), in runs of every shipped scene.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <set>
#include <sstream>

#include "rt/effect_count.hpp"
#include "tests/support/whole.hpp"
#include "tests/unit/tasks_fusion/recording.hpp"
#include "tools/host/calibrate.hpp"
#include "tools/host/effect_costs.hpp"
#include "tools/host/run_options.hpp"
#include "tools/measure/effect_bench.hpp"
#include "tools/record/recording_setup.hpp"
#include "tools/scene/effect_catalogue.hpp"

namespace teletact {
namespace {

namespace fs = std::filesystem;

rt::Startup& startup() {
  static rt::Startup s;
  return s;
}

struct Counted {
  std::vector<std::string> built, ran;
  std::int64_t in_contact = 0;  // releases of the haptic task
  double way_m = 0;             // of the base
};

Counted count(Scene& scene, double seconds) {
  for (auto& c : rt::effect_counts) c.built = 0, c.ran = 0;
  DemoOptions options;
  options.seconds = seconds;
  options.rgbd_dir = scene.rgbd_dir;
  options.virtual_clock = options.quiet = true;
  options.cores = 2;  // the smaller variants: faster
  const VirtualRun r = run_virtual(startup().token(), scene, options, reference_calibration());
  Counted out;
  for (std::size_t i = 0; i < rt::kEffects; ++i) {
    if (rt::effect_counts[i].built > 0) out.built.emplace_back(rt::kEffectNames[i]);
    if (rt::effect_counts[i].ran > 0) out.ran.emplace_back(rt::kEffectNames[i]);
  }
  out.in_contact = std::count_if(r.op.view.haptic.begin(), r.op.view.haptic.end(),
                                 [](const auto& h) { return h.in_contact; });
  if (!r.robot.view.truth.empty()) out.way_m = r.robot.view.truth.back().path_m;
  return out;
}

Counted counted_in(const std::string& scene_file, const std::vector<std::string>& overrides,
                   double seconds) {
  const auto scene = load_scene(scene_file, overrides);
  return count(*scene, seconds);
}

// Until the hand has touched: half a second into its first press, and where it marks until a while
// after that, so that the base drives. 1.5 s of a scene whose hand does nothing.
struct Until {
  double seconds = 1.5;
  bool touches = false, drives = false;
};
Until until_touched(const Scene& scene) {
  Until u;
  double t = scene.hand.start_after_s;
  for (const auto& segment : scene.hand.segments) {
    if (segment.kind == "press" && !u.touches)
      u.touches = true, u.seconds = t + segment.time_s + 0.5;
    t += segment.time_s;
    if (segment.kind == "button_up" && !u.drives) u.drives = true, u.seconds = t + 1.5;
  }
  return u;
}

// By the file alone, not by what was built: it names the effect's key.
bool names_key(const Scene& scene, const std::string& key) {
  std::istringstream path(key);
  const config::Section* at = &scene.schema;
  std::string word;
  bool named = false;
  while (std::getline(path, word, '.')) {
    const config::Section::Field* found = nullptr;
    for (const auto& field : at->fields())
      if (field->key == word) found = field.get();
    if (found == nullptr) throw std::logic_error(key + " is no key of a scene");
    named = found->named;
    if (const auto* list = std::get_if<config::Section::List>(&found->value))
      named = !list->items.empty();
    if (const auto* down = std::get_if<std::unique_ptr<config::Section>>(&found->value))
      at = down->get();
  }
  return named;
}

std::vector<std::string> asked_by(const std::string& scene_file) {
  const auto scene = load_scene(scene_file, {});
  std::vector<std::string> names;
  for (const EffectRow& row : effect_catalogue())
    if (names_key(*scene, row.key)) names.emplace_back(row.name);
  return names;
}

// Of `names` those that are not in `asked`.
std::vector<std::string> beyond(const std::vector<std::string>& names,
                                const std::vector<std::string>& asked) {
  std::vector<std::string> out;
  for (const std::string& n : names)
    if (std::find(asked.begin(), asked.end(), n) == asked.end()) out.push_back(n);
  return out;
}

TEST(Executed, EveryEffectOfTheCatalogueIsCounted) {
  ASSERT_EQ(effect_catalogue().size(), rt::kEffects);
  std::set<std::string> names;
  for (const auto name : rt::kEffectNames) {
    EXPECT_NE(effect_named(std::string(name)), nullptr) << name;
    names.emplace(name);
  }
  EXPECT_EQ(names.size(), rt::kEffects);
}

// Of each the start; until it touches and drives: few of them in every run (tests::whole).
TEST(Executed, OfEveryShippedSceneOnlyWhatItAsksFor) {
  int scenes = 0, touched = 0, driven = 0;
  for (const auto& entry :
       fs::directory_iterator(fs::path(find_config("scenes", "empty_room")).parent_path())) {
    if (entry.path().extension() != ".toml") continue;
    const std::string name = entry.path().stem().string();
    SCOPED_TRACE(name);
    auto asked = asked_by(entry.path().string());
    const auto scene = load_scene(entry.path().string(), {});
    if (name.find("recording") != std::string::npos && tests::have_recording()) {
      // Nobody scripted the hand of `any_recording`: the program does, as in `teletact demo
      // --rgbd`.
      scene->rgbd_dir = tests::recording_folder();
      if (set_up_recording(startup().token(), *scene, 12).scripted)
        asked.emplace_back("device: hand");
    }
    Until until = until_touched(*scene);
    // Without images there is nothing to touch in them.
    if (name.find("recording") != std::string::npos && scene->rgbd_dir.empty()) until = {};
    if (!tests::whole() && name != "default_room" && name != "arm") until = {};
    const Counted c = count(*scene, until.seconds);
    std::printf("  %-14s %4.1f s: %lld ms in contact, %.2f m\n", name.c_str(), until.seconds,
                static_cast<long long>(c.in_contact), c.way_m);
    EXPECT_THAT(c.built, testing::UnorderedElementsAreArray(asked));
    EXPECT_THAT(beyond(c.ran, asked), testing::IsEmpty());
    if (until.touches) {
      EXPECT_THAT(beyond(asked, c.ran), testing::IsEmpty()) << "as far as nothing is touched";
      EXPECT_GT(c.in_contact, 100);
    }
    if (until.drives) {
      EXPECT_GT(c.way_m, 0.02);
    }
    ++scenes;
    touched += until.touches;
    driven += until.drives;
  }
  EXPECT_GE(scenes, 8);
  EXPECT_GE(touched, tests::whole() ? 5 : 2);
  EXPECT_GE(driven, tests::whole() ? 5 : 1);
}

// Until the hand touches and the base drives: all that is asked for, and nothing else.
TEST(Executed, WhatTheDefaultSceneAsksForIsExecuted) {
  const std::string file = find_config("scenes", "default_room");
  const auto asked = asked_by(file);
  const Counted c = counted_in(file, {}, 6);
  EXPECT_THAT(c.ran, testing::UnorderedElementsAreArray(asked));
}

// The counts see what is there: each effect of touch and of the twins, asked for beside a scene
// that does not.
TEST(Executed, OneThatTheSceneDoesNotAskForIsSeen) {
  const std::string file = find_config("scenes", "empty_room");
  const auto asked = asked_by(file);
  EXPECT_THAT(asked, testing::IsEmpty());
  const std::vector<std::pair<std::string, std::string>> more{
      {"camera.noise.axial=1", "camera noise: axial"},
      {"camera.noise.lateral_px=0.3", "camera noise: lateral_px"},
      {"camera.noise.edge_dropout=0.5", "camera noise: edge_dropout"},
      {"camera.noise.flying=0.02", "camera noise: flying"},
      {"device.coulomb_N=0.1", "device: device_friction"},
      {"device.quantum_m=1e-5", "device: position_quantum"},
      {"device.gravity_mass_kg=0.2", "device: gravity"},
      {"link.shape.delay_ms=30", "link shape"},
      {"haptic.friction_static=0.3", "touch: friction"},
      {"haptic.texture_amplitude_m=0.0002", "touch: texture"},
      {"haptic.viscosity_N_s_per_m=1", "touch: viscosity"},
      {"haptic.method=\"force_shading\"", "touch: force shading"}};
  std::vector<std::string> keys, names;
  for (const auto& [key, name] : more) keys.push_back(key), names.push_back(name);
  const Counted c = counted_in(file, keys, 1);
  EXPECT_THAT(beyond(c.built, asked), testing::UnorderedElementsAreArray(names));
  EXPECT_THAT(beyond(c.ran, asked), testing::UnorderedElementsAreArray(names));
}

TEST(EffectCosts, TheTableThatExplainPrintsIsOfThisCatalogue) {
  const auto costs = load_effect_costs(find_config("limits", "effect_costs"));
  ASSERT_TRUE(costs) << costs.error();
  EXPECT_NE(costs.value().host, "");
  for (const EffectRow& row : effect_catalogue()) {
    const EffectCost* cost = costs.value().of(row.name);
    if (std::string(row.name) == "device: hand") {
      EXPECT_EQ(cost, nullptr);
      continue;
    }
    ASSERT_NE(cost, nullptr) << row.name;
    EXPECT_GE(cost->floor_us, 0);
    EXPECT_NE(cost_text(cost).find(cost->job), std::string::npos);
  }
  EXPECT_EQ(cost_text(nullptr), "cost not measured");
}

// An effect that does work costs its payer more than none. A busy machine needs more rounds for it:
// of each job the least of all rounds counts, and two rounds that something else disturbed may tell
// of any difference, either way.
TEST(EffectCosts, AnEffectIsMeasuredAgainstTheSameRunWithoutIt) {
  std::ostringstream progress;
  EffectCosts c;
  for (int rounds = 2; rounds <= 16; rounds *= 2) {
    c = measure_effects(startup().token(), progress, 1.0, rounds, "camera noise: axial");
    if (c.rows.size() == 1 && c.rows[0].told() && c.rows[0].us > 0) break;
  }
  ASSERT_EQ(c.rows.size(), 1U);
  EXPECT_EQ(c.rows[0].job, "a job of capture");
  EXPECT_GT(c.rows[0].us, 50) << "a deviate for each of 200,000 pixels";
  EXPECT_TRUE(c.rows[0].told());
  EXPECT_GT(c.missed(), 0) << "one of many is not the table";
  EXPECT_THROW((void)measure_effects(startup().token(), progress, 1.0, 1, "no such"),
               std::runtime_error);
}

}  // namespace
}  // namespace teletact
