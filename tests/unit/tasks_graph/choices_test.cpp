// What the scene and the calibration leave to choose from, and what the request for the host is
// made of.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <stdexcept>

#include "tasks/contract/messages.hpp"
#include "tasks/graph/calibration.hpp"
#include "tasks/graph/host_request.hpp"
#include "tasks/graph/static_choices.hpp"

namespace {

using tasks::Calibration;
using tasks::ChoiceLimits;
using tasks::TaskId;
using testing::HasSubstr;

constexpr auto kFusion = static_cast<std::size_t>(TaskId::kFusion);

Calibration measured(double ms10, double ms20) {
  Calibration c;
  c.host = "test";
  for (int level = 0; level < 3; ++level) {
    for (const bool coarse : {false, true}) {
      auto& r = c.rows.emplace_back();
      r.name = "fusion";
      r.choice = coarse ? "20 mm" : "10 mm";
      r.level = level;
      r.p999_us = 1000 * (coarse ? ms20 : ms10) / (level + 1);
    }
  }
  return c;
}

TEST(Choices, BestFirstAndTheSceneOverrides) {
  auto options = tasks::voxel_options({});
  ASSERT_EQ(options.size(), 2U);
  EXPECT_EQ(options[0].name, "10 mm");
  EXPECT_EQ(options[1].name, "20 mm");
  ChoiceLimits named;
  named.named_voxel_m = 0.02;
  options = tasks::voxel_options(named);
  ASSERT_EQ(options.size(), 1U);
  EXPECT_EQ(options[0].name, "20 mm");
  named.named_voxel_m = 0.0125;  // one that only this scene has, coarser than 10 mm
  options = tasks::voxel_options(named);
  ASSERT_EQ(options.size(), 1U);
  EXPECT_EQ(options[0].name, "12.5 mm");
  EXPECT_EQ(options[0].budgets_us, tasks::kVoxelChoices[0].budgets_us);
  auto specs = tasks::make_specs({}, named);
  const auto a = rt::admit(tasks::make_request(specs, {0, 1, 2, 3}, {}));
  ASSERT_TRUE(a.admitted) << a.refusal;
  specs = rt::settled_as(a, specs);
  EXPECT_DOUBLE_EQ(tasks::chosen_voxel_m(specs[kFusion], named), 0.0125);
}

TEST(Choices, AWindowThatTheHandOutrunsIsRuledOut) {
  ChoiceLimits limits;
  limits.patch_nodes = 64;
  limits.needed_half_extent_m = 0.6;
  const auto options = tasks::voxel_options(limits);
  EXPECT_THAT(options[0].ruled_out, HasSubstr("reaches 0.315 m"));
  EXPECT_EQ(options[1].ruled_out, "");
  limits.needed_half_extent_m = 1;
  const auto a = rt::admit(tasks::make_request(tasks::make_specs({}, limits), {0, 1, 2, 3}, {}));
  EXPECT_FALSE(a.admitted);
  EXPECT_THAT(a.refusal, HasSubstr("'fusion' has no choice left"));
}

TEST(Choices, CalibrationDecides) {
  const auto chosen = [](const Calibration& c) {
    const auto a = rt::admit(tasks::make_request(tasks::make_specs(c), {0, 1}, {}));
    return a.admitted ? a.tasks[kFusion].choice : a.refusal;
  };
  EXPECT_EQ(chosen(measured(12, 6)), "10 mm");
  EXPECT_EQ(chosen(measured(90, 12)), "20 mm");
  EXPECT_THAT(chosen(measured(200, 150)), HasSubstr("floor of the static choices: fusion 20 mm"));
}

tasks::CalibrationRow& row_of(Calibration& c, const std::string& choice, int level) {
  for (auto& r : c.rows) {
    if (r.choice == choice && r.level == level) return r;
  }
  throw std::logic_error("no such row");
}

// The finest voxel that fits, with whatever levels it takes: but never one that does not track.
TEST(Choices, WhatDoesNotTrackIsNeverAdmitted) {
  const auto admitted = [](const Calibration& c) {
    return rt::admit(tasks::make_request(tasks::make_specs(c), {0, 1}, {}));
  };
  Calibration c = measured(70, 15);  // at 10 mm the last level fits alone
  const auto a = admitted(c);
  ASSERT_TRUE(a.admitted) << a.refusal;
  ASSERT_EQ(a.tasks[kFusion].choice, "10 mm");
  row_of(c, "10 mm", 0).claimed_share = 1;
  row_of(c, "10 mm", 2).claimed_share = 0.9;
  const auto b = admitted(c);
  ASSERT_TRUE(b.admitted) << b.refusal;
  EXPECT_EQ(b.tasks[kFusion].choice, "20 mm");
  EXPECT_EQ(tasks::make_specs(c)[kFusion].choices[0].variants.size(), 2U);

  c = measured(12, 6);
  row_of(c, "10 mm", 0).off_mm = 60;
  EXPECT_EQ(admitted(c).tasks[kFusion].choice, "20 mm");
  row_of(c, "20 mm", 0).tracked_share = 0.4;
  const auto none = admitted(c);
  EXPECT_FALSE(none.admitted);
  EXPECT_THAT(none.refusal, HasSubstr("10 mm: it claims a pose 60 mm off, 50 mm are allowed"));
  EXPECT_THAT(none.refusal, HasSubstr("20 mm: it is lost on 60.0 % of the stored images"));
  // A recording's reference is good to 2 cm a metre.
  c = measured(12, 6);
  c.recording = "some/folder";
  row_of(c, "10 mm", 0).off_mm = 59;
  EXPECT_EQ(admitted(c).tasks[kFusion].choice, "10 mm");
  row_of(c, "10 mm", 0).off_mm = 61;
  EXPECT_EQ(admitted(c).tasks[kFusion].choice, "20 mm");
  // Where the scene constrains no frame all are alike, and nothing is told.
  c = measured(12, 6);
  for (auto& r : c.rows) r.tracked_share = 1, r.claimed_share = 0.02;
  EXPECT_EQ(admitted(c).tasks[kFusion].choice, "10 mm");
}

TEST(Choices, AFileKeepsThemAndCoverIsChecked) {
  Calibration c = measured(20, 10);
  EXPECT_FALSE(c.covers(c, tasks::make_specs(c))) << "the other tasks have no rows";
  for (const auto& row : tasks::kTaskTable) {
    for (int level = 0; level < 4; ++level) {
      if (row.id == TaskId::kFusion || row.variants[static_cast<std::size_t>(level)].name.empty())
        continue;
      auto& r = c.rows.emplace_back();
      r.name = row.name;
      r.level = level;
      r.p999_us = 10;
    }
  }
  row_of(c, "10 mm", 1).claimed_share = 0.9875;
  row_of(c, "10 mm", 1).off_mm = 12.25;
  const std::string file = testing::TempDir() + "choices.toml";
  tasks::save_calibration(file, c);
  const auto back = tasks::load_calibration(file);
  ASSERT_TRUE(back.has_value()) << back.error();
  EXPECT_TRUE(back.value().covers(c, tasks::make_specs(back.value())));
  ASSERT_NE(back.value().find("fusion", "10 mm", 1), nullptr);
  EXPECT_DOUBLE_EQ(back.value().find("fusion", "10 mm", 1)->p999_us, 10'000);
  EXPECT_EQ(back.value().find("fusion", "", 1), nullptr);
  EXPECT_DOUBLE_EQ(back.value().find("fusion", "10 mm", 1)->claimed_share, 0.9875);
  EXPECT_DOUBLE_EQ(back.value().find("fusion", "10 mm", 1)->off_mm, 12.25);
  EXPECT_LT(back.value().find("fusion", "20 mm", 1)->claimed_share, 0) << "not measured";
  c.rows.pop_front();
  EXPECT_FALSE(c.covers(c, tasks::make_specs(c)));
}

TEST(Request, PoolRowsFollowTheTable) {
  tasks::PoolConfig pool;
  const auto specs = tasks::make_specs(measured(20, 10));
  EXPECT_EQ(tasks::make_request(specs, {0, 1}, {}, pool).tasks.size(),
            static_cast<std::size_t>(tasks::kTaskCount));
  pool.fusion_workers = 2;
  const auto r = tasks::make_request(specs, {0, 1, 2, 3}, {}, pool);
  ASSERT_EQ(r.tasks.size(), static_cast<std::size_t>(tasks::kTaskCount) + 2);
  EXPECT_EQ(r.tasks.back().name, "fusion_worker2");
  EXPECT_EQ(r.tasks.back().parent, "fusion");
  const auto a = rt::admit(r);
  ASSERT_TRUE(a.admitted) << a.refusal;
  EXPECT_GT(a.tasks[kFusion].join_wait.count(), 0);
  EXPECT_GT(a.tasks.back().J.count(), 0);
  EXPECT_EQ(a.tasks.back().choice, a.tasks[kFusion].choice);
}

// Measured with one thread: what is left to fusion itself is declared, as a share. Measured with
// workers: as it is.
TEST(Request, BudgetsOfAPool) {
  tasks::PoolConfig pool;
  pool.fusion_workers = 1;
  Calibration c = measured(20, 10);
  const auto specs = tasks::make_specs(c);
  const rt::Nanos alone = specs[kFusion].choices[0].variants[0].budget;
  const auto declared = tasks::make_request(specs, {0, 1}, {}, pool, c);
  const auto ms = [](rt::Nanos d) { return 1e-6 * static_cast<double>(d.count()); };
  EXPECT_NEAR(ms(declared.tasks[kFusion].choices[0].variants[0].budget),
              tasks::kOwnShare * ms(alone), 1e-6);
  EXPECT_NEAR(ms(declared.tasks.back().choices[0].variants[0].budget),
              tasks::kWorkerShare * ms(alone), 1e-6);
  for (int level = 0; level < 3; ++level) {
    for (const char* choice : {"10 mm", "20 mm"}) {
      auto& r = c.rows.emplace_back();
      r.name = tasks::kWorkerRow;
      r.choice = choice;
      r.level = level;
      r.p999_us = 5000;
    }
  }
  const auto known = tasks::make_request(specs, {0, 1}, {}, pool, c);
  EXPECT_EQ(known.tasks[kFusion].choices[0].variants[0].budget, alone);
  EXPECT_NEAR(ms(known.tasks.back().choices[0].variants[0].budget), 6.0, 1e-6);
  rt::TaskSpec worker = known.tasks.back();
  worker.choice = "20 mm";
  ASSERT_NE(c.find(worker, 1), nullptr);
  EXPECT_EQ(c.find(worker, 1)->name, tasks::kWorkerRow);
}

TEST(Request, EveryModeOfSupervisionIsAnalysed) {
  const auto r = tasks::make_request(tasks::make_specs(measured(90, 12)), {0, 1}, {});
  const auto a = rt::admit(r);
  ASSERT_TRUE(a.admitted) << a.refusal;
  const auto table = rt::analyse_modes(r, a, tasks::mode_sets(r, a));
  EXPECT_EQ(table.refusal, "");
  ASSERT_EQ(table.modes.size(), 5U);
  for (const auto from : {tasks::Mode::kInit, tasks::Mode::kHold, tasks::Mode::kSafeStop}) {
    for (const auto to : {tasks::Mode::kHold, tasks::Mode::kEngaged, tasks::Mode::kRampDown})
      EXPECT_TRUE(
          table.gate.may_enter(static_cast<std::size_t>(from), static_cast<std::size_t>(to)));
  }
  EXPECT_EQ(table.modes[static_cast<std::size_t>(tasks::Mode::kEngaged)].name, "engaged");
  const auto held = rt::admit(rt::largest_of(r, a, table));
  ASSERT_TRUE(held.admitted);
  for (std::size_t i = 0; i < a.tasks.size(); ++i) EXPECT_EQ(held.tasks[i].C, a.tasks[i].C);
}

}  // namespace
