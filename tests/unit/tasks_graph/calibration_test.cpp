// What a calibration says, holds for and refuses.
#include "tasks/graph/calibration.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <functional>
#include <iterator>

#include "rt/random.hpp"
#include "tasks/graph/host_request.hpp"
#include "tasks/graph/picture_cost.hpp"

namespace {

using tasks::Calibration;
using tasks::CalibrationOrigin;
using tasks::CalibrationRow;
using tasks::TaskId;
using testing::AllOf;
using testing::HasSubstr;

constexpr auto kPlanning = static_cast<std::size_t>(TaskId::kPlanning);
const CalibrationOrigin kHere{"a \"quoted\" CPU\\2", "1.0, gcc", "0123456789abcdef", "/data/desk"};

CalibrationRow row(const std::string& name, const std::string& choice, int level, double p999_us) {
  CalibrationRow r;
  r.name = name;
  r.choice = choice;
  r.level = level;
  r.p999_us = p999_us;
  r.p99_us = 0.9 * p999_us;
  r.p50_us = 0.5 * p999_us;
  r.work_min = 1;
  r.work_max = 5;
  for (std::size_t i = 0; i < r.quantiles_us.size(); ++i)
    r.quantiles_us[i] = p999_us * static_cast<double>(i) / 32;
  return r;
}

Calibration whole() {
  Calibration c;
  static_cast<CalibrationOrigin&>(c) = kHere;
  for (const auto& t : tasks::kTaskTable) {
    for (int level = 0; level < 4; ++level) {
      if (t.variants[static_cast<std::size_t>(level)].name.empty()) break;
      const double us = 1000.0 / (level + 1);
      if (t.id == TaskId::kFusion) {
        c.rows.push_back(row("fusion", "10 mm", level, us));
        c.rows.push_back(row("fusion", "20 mm", level, us));
      } else {
        c.rows.push_back(row(std::string(t.name), "", level, us));
      }
    }
  }
  return c;
}

std::string text_of(const Calibration& c) {
  const std::string file = testing::TempDir() + "calibration_test.toml";
  tasks::save_calibration(file, c);
  std::ifstream in(file);
  return {std::istreambuf_iterator<char>(in), {}};
}

TEST(Calibration, BudgetIsTheLargerOfTheTwoMargins) {
  EXPECT_EQ(row("haptic", "", 0, 20).budget().count(), 30'000);    // + 10 us
  EXPECT_EQ(row("haptic", "", 0, 100).budget().count(), 120'000);  // x 1.2
}

// The images in which somebody moves are fewer than a thousandth may hide.
TEST(Calibration, TheBudgetCoversTheImagesInWhichSomebodyMoves) {
  Calibration c = whole();
  auto at = [&c](int level) -> CalibrationRow& {
    for (auto& r : c.rows) {
      if (r.name == "fusion" && r.choice == "20 mm" && r.level == level) return r;
    }
    throw std::logic_error("no such row");
  };
  auto& r = at(0);
  const auto still_alone = r.budget();
  r.still_p50_us = 0.4 * r.p999_us;
  r.still_p999_us = r.p999_us;
  r.moving_p50_us = r.p999_us;
  r.moving_p999_us = 1.5 * r.p999_us;
  EXPECT_NEAR(rt::seconds(r.budget()), 1.5 * rt::seconds(still_alone), 1e-8);
  // Simulated costs stay within it, and a file keeps it.
  auto specs = tasks::make_specs(c);
  auto fusion = specs[static_cast<std::size_t>(TaskId::kFusion)];
  fusion.choice = "20 mm";
  fusion.variants = fusion.choices[1].variants;
  ASSERT_EQ(fusion.variants[0].budget, r.budget());
  const auto costs = tasks::make_costs(c, {fusion});
  EXPECT_LE(static_cast<double>(costs[0][0].value_ns.back()),
            static_cast<double>(r.budget().count()) / 1.2);
  EXPECT_NEAR(static_cast<double>(costs[0][0].value_ns.back()), 1e3 * r.quantiles_us.back(), 2);
  const auto back = tasks::read_calibration(text_of(c), "c.toml");
  ASSERT_TRUE(back) << back.error();
  EXPECT_EQ(back.value().find("fusion", "20 mm", 0)->budget(), r.budget());
  EXPECT_LT(back.value().find("fusion", "20 mm", 1)->moving_p999_us, 0) << "not told";
  r.moving_p50_us = 2 * r.moving_p999_us;
  EXPECT_FALSE(tasks::read_calibration(text_of(c), "c.toml"));
}

TEST(Calibration, AnAbortedTaskKeepsTheDeclaredBudgetAndCostsWhatItTakes) {
  Calibration c = whole();
  const auto specs = tasks::make_specs(c);
  const auto& planning = specs[kPlanning];
  ASSERT_EQ(planning.policy, rt::MissPolicy::kAbort);
  for (int level = 0; level < planning.levels(); ++level) {
    const auto declared =
        1000 * tasks::kTaskTable[kPlanning].variants[static_cast<std::size_t>(level)].budget_us;
    EXPECT_EQ(planning.budget_of(level).count(), declared);
    EXPECT_EQ(c.find(planning, level)->budget().count(), declared);
  }
  const std::vector<rt::TaskSpec> only{planning};
  const auto costs = tasks::make_costs(c, only);
  EXPECT_EQ(costs[0][0].value_ns.back(), 1'000'000);  // as measured, not scaled to 50 ms
  for (auto& r : c.rows) {
    if (r.name == "planning") r = row("planning", "", r.level, 400'000);
  }
  EXPECT_NEAR(static_cast<double>(tasks::make_costs(c, only)[0][0].value_ns.back()), 50e6 / 1.2, 2);
}

// A scene that touches by the published method pays for its ray cast: declared where it was not
// measured with it.
TEST(Calibration, TheRayCastOfThePublishedMethodIsInTheBudgets) {
  const Calibration c = whole();
  const Calibration same = tasks::with_ray_cast(c, 0);
  EXPECT_FALSE(same.ray_cast);
  EXPECT_EQ(same.find("fusion", "20 mm", 1)->p999_us, c.find("fusion", "20 mm", 1)->p999_us);
  constexpr std::int64_t kJob_us = 7000;
  const Calibration more = tasks::with_ray_cast(c, kJob_us);
  ASSERT_TRUE(more.ray_cast);
  for (std::size_t i = 0; i < c.rows.size(); ++i) {
    const double by = c.rows[i].name == "fusion"   ? kJob_us
                      : c.rows[i].name == "haptic" ? tasks::kReduction_us
                                                   : 0;
    EXPECT_NEAR(more.rows[i].p50_us - c.rows[i].p50_us, by, 1e-9) << c.rows[i].name;
    EXPECT_NEAR(more.rows[i].p999_us - c.rows[i].p999_us, by, 1e-9) << c.rows[i].name;
    for (std::size_t q = 0; q < c.rows[i].quantiles_us.size(); ++q)
      EXPECT_NEAR(more.rows[i].quantiles_us[q] - c.rows[i].quantiles_us[q], by, 1e-9);
    EXPECT_EQ(more.rows[i].moving_p999_us, -1) << "not told apart stays so";
    if (c.rows[i].name == "planning") continue;  // keeps its declared budget
    const auto more_by = std::chrono::microseconds{static_cast<int>(by)};
    EXPECT_GE(more.rows[i].budget(), c.rows[i].budget() + more_by);
  }
  // What was measured with it has it already, and a file keeps that.
  const auto back = tasks::read_calibration(text_of(more), "c.toml");
  ASSERT_TRUE(back) << back.error();
  EXPECT_TRUE(back.value().ray_cast);
  const Calibration twice = tasks::with_ray_cast(back.value(), kJob_us);
  EXPECT_NEAR(twice.find("haptic", "", 0)->p999_us, more.find("haptic", "", 0)->p999_us, 1e-3);
  EXPECT_FALSE(tasks::read_calibration(text_of(c), "c.toml").value().ray_cast);
  // Shared with workers as the rest of a job is.
  Calibration pool = c;
  for (int level = 0; level < 3; ++level)
    pool.rows.push_back(row(std::string(tasks::kWorkerRow), "20 mm", level, 500));
  const Calibration shared = tasks::with_ray_cast(pool, kJob_us);
  EXPECT_NEAR(shared.find(tasks::kWorkerRow, "20 mm", 0)->p50_us - 250,
              tasks::kWorkerShare * kJob_us, 1e-9);
  EXPECT_NEAR(shared.find("fusion", "20 mm", 0)->p50_us - c.find("fusion", "20 mm", 0)->p50_us,
              tasks::kOwnShare * kJob_us, 1e-9);
}

// Without any measurement the declared budgets have it.
TEST(Calibration, TheRayCastIsInTheDeclaredBudgetsToo) {
  tasks::ChoiceLimits asked;
  asked.ray_cast_us = 7000;
  const auto with = tasks::make_specs({}, asked), without = tasks::make_specs({}, {});
  for (std::size_t i = 0; i < with.size(); ++i) {
    if (with[i].name == "fusion") {
      for (std::size_t c = 0; c < with[i].choices.size(); ++c)
        for (std::size_t level = 0; level < 3; ++level)
          EXPECT_EQ((with[i].choices[c].variants[level].budget -
                     without[i].choices[c].variants[level].budget)
                        .count(),
                    1000 * asked.ray_cast_us);
    } else {
      EXPECT_EQ((with[i].budget - without[i].budget).count(),
                with[i].name == "haptic" ? 1000 * tasks::kReduction_us : 0)
          << with[i].name;
    }
  }
}

// A scene that names other picture codecs pays for them: capture what was not measured with one,
// the link its share.
TEST(Calibration, PictureCodecsAreInTheBudgetsOfCaptureAlone) {
  drivers::PictureConfig pictures;
  perception::Intrinsics camera{365, 365, 256, 212, 512, 424};
  const auto none = tasks::picture_cost(pictures, camera);
  EXPECT_EQ(none.encode_us, 0);
  EXPECT_EQ(none.decode_share, 0);
  pictures.depth_codec = "quiet";
  const auto depth = tasks::picture_cost(pictures, camera);
  pictures.colour_codec = "h264";
  const auto both = tasks::picture_cost(pictures, camera);
  EXPECT_GT(depth.encode_us, 0);
  EXPECT_GT(both.encode_us, depth.encode_us);
  EXPECT_GT(both.decode_share, depth.decode_share);
  EXPECT_LE(30e-6 * static_cast<double>(depth.encode_us) + depth.decode_share, 0.25)
      << "what a depth codec may add to two cores";
  camera.width = 256;
  const auto half = tasks::picture_cost(pictures, camera);
  EXPECT_NEAR(static_cast<double>(half.encode_us), 0.5 * static_cast<double>(both.encode_us), 1);
  EXPECT_NEAR(half.decode_share, 0.5 * both.decode_share, 1e-9);
  const Calibration c = whole();
  EXPECT_TRUE(tasks::with_pictures(c, "", 0).pictures.empty());
  const Calibration more = tasks::with_pictures(c, pictures.dialect(), both.encode_us);
  EXPECT_EQ(more.pictures, pictures.dialect());
  for (std::size_t i = 0; i < c.rows.size(); ++i) {
    const double by = c.rows[i].name == "capture" ? static_cast<double>(both.encode_us) : 0;
    EXPECT_NEAR(more.rows[i].p50_us - c.rows[i].p50_us, by, 1e-9) << c.rows[i].name;
    EXPECT_NEAR(more.rows[i].quantiles_us[20] - c.rows[i].quantiles_us[20], by, 1e-9);
  }
  const auto back = tasks::read_calibration(text_of(more), "c.toml");
  ASSERT_TRUE(back) << back.error();
  const Calibration twice = tasks::with_pictures(back.value(), "depth moving, colour jpeg", 4000);
  EXPECT_NEAR(twice.find("capture", "", 0)->p50_us, more.find("capture", "", 0)->p50_us, 1e-3);
  // Without any measurement the declared budgets have it.
  tasks::ChoiceLimits asked;
  asked.encode_us = both.encode_us;
  const auto with = tasks::make_specs({}, asked), without = tasks::make_specs({}, {});
  const auto capture = tasks::index_of(tasks::TaskId::kCapture);
  for (std::size_t i = 0; i < with.size(); ++i) {
    if (with[i].name == "fusion") continue;
    EXPECT_EQ((with[i].budget - without[i].budget).count(),
              i == capture ? 1000 * both.encode_us : 0);
  }
  EXPECT_EQ((with[capture].variants[1].budget - without[capture].variants[1].budget).count(),
            1000 * both.encode_us);
}

TEST(Calibration, AFileKeepsEverything) {
  const Calibration c = whole();
  const auto back = tasks::read_calibration(text_of(c), "c.toml");
  ASSERT_TRUE(back) << back.error();
  const auto& b = back.value();
  EXPECT_EQ(b.host, kHere.host);
  EXPECT_EQ(b.build, kHere.build);
  EXPECT_EQ(b.config, kHere.config);
  EXPECT_EQ(b.recording, kHere.recording);
  ASSERT_EQ(b.rows.size(), c.rows.size());
  for (std::size_t i = 0; i < c.rows.size(); ++i) {
    EXPECT_EQ(b.rows[i].name, c.rows[i].name);
    EXPECT_NEAR(b.rows[i].p999_us, c.rows[i].p999_us, 1e-3);
  }
  EXPECT_TRUE(b.covers(kHere, tasks::make_specs(b)));
}

TEST(Calibration, TheCamerasTwinIsDeclaredAsMeasured) {
  Calibration c = whole();
  EXPECT_EQ(tasks::declared_twin_share(c), tasks::kTwinShare) << "nobody measured it";
  EXPECT_EQ(text_of(c).find("camera_twin_share"), std::string::npos);
  for (const double share : {0.0, 0.04, 0.17, 1.2}) {
    c.camera_twin_share = share;
    const auto back = tasks::read_calibration(text_of(c), "c.toml");
    ASSERT_TRUE(back) << back.error();
    EXPECT_NEAR(back.value().camera_twin_share, share, 1e-4);
    EXPECT_NEAR(tasks::declared_twin_share(back.value()), tasks::kTwinMargin * share, 2e-4);
  }
}

TEST(Calibration, TheLinkIsDeclaredAsMeasured) {
  Calibration c = whole();
  EXPECT_EQ(tasks::declared_link_share(c), 2 * tasks::BestEffortShares{}.link) << "not measured";
  EXPECT_EQ(text_of(c).find("link_share"), std::string::npos);
  double before = 0;
  for (const double share : {0.0, 0.04, 0.17, 1.2}) {
    c.link_share = share;
    const auto back = tasks::read_calibration(text_of(c), "c.toml");
    ASSERT_TRUE(back) << back.error();
    EXPECT_NEAR(back.value().link_share, share, 1e-4);
    EXPECT_LT(back.value().camera_twin_share, 0) << "not its neighbour's";
    const double declared = tasks::declared_link_share(back.value());
    EXPECT_GE(declared, share + 2 * tasks::kSocketsShare);
    EXPECT_GT(declared, before);
    before = declared;
  }
}

TEST(Calibration, HoldsForOneHostProgramConfigurationAndRecording) {
  const Calibration c = whole();
  const auto specs = tasks::make_specs(c);
  EXPECT_EQ(c.lacks(kHere, specs), "");
  const std::vector<std::pair<std::string CalibrationOrigin::*, std::string>> keys{
      {&CalibrationOrigin::host, "another host"},
      {&CalibrationOrigin::build, "another build"},
      {&CalibrationOrigin::config, "another configuration"},
      {&CalibrationOrigin::recording, "another recording"}};
  for (const auto& [key, words] : keys) {
    CalibrationOrigin wanted = kHere;
    wanted.*key += "x";
    EXPECT_THAT(c.lacks(wanted, specs), HasSubstr(words));
    EXPECT_THAT(c.lacks(wanted, specs), HasSubstr(wanted.*key));
    EXPECT_FALSE(c.covers(wanted, specs));
  }
  for (std::size_t i = 0; i < c.rows.size(); ++i) {
    Calibration less = c;
    less.rows.erase(less.rows.begin() + static_cast<std::ptrdiff_t>(i));
    EXPECT_THAT(less.lacks(kHere, specs), HasSubstr("no row of " + c.rows[i].name));
  }
}

TEST(Calibration, ABadFileIsOneLineWithFileKeyValueAndRange) {
  struct Bad {
    std::function<void(Calibration&)> make;
    std::string key, value, allowed;
  };
  const std::vector<Bad> cases{
      {[](Calibration& c) { c.host.clear(); }, "'host'", "''", "name of the machine"},
      {[](Calibration& c) { c.rows[1].name = "fusoin"; }, "task[1].name", "fusoin", "haptic"},
      {[](Calibration& c) { c.rows[0].level = 3; }, "task[0].level", "= 3", "0..0 for haptic"},
      {[](Calibration& c) { c.rows[0].level = 99; }, "task[0].level", "= 99", "15"},
      {[](Calibration& c) { c.rows[0].choice = "20 mm"; }, "task[0].choice", "20 mm", "none"},
      {[](Calibration& c) { c.rows[1].choice.clear(); }, "task[1].choice", "''", "'20 mm'"},
      {[](Calibration& c) { c.rows[0].p50_us = -1; }, "task[0].p50_us", "-1", "0"},
      {[](Calibration& c) { c.rows[0].p50_us = NAN; }, "task[0].p50_us", "nan", "0"},
      {[](Calibration& c) { c.rows[0].p99_us = 7; }, "task[0].p99_us", "= 7", "p50_us (500)"},
      {[](Calibration& c) { c.rows[0].p999_us = 800; }, "task[0].p999_us", "800", "p99_us (900)"},
      {[](Calibration& c) { c.rows[2].work_max = 0; }, "task[2].work_max", "= 0", "work_min (1)"},
      {[](Calibration& c) { c.rows[0].quantiles_us[9] = 3; }, "quantiles_us[9]", "= 3", "before"},
      {[](Calibration& c) { c.camera_twin_share = 65; }, "camera_twin_share", "65", "64"},
      {[](Calibration& c) { c.link_share = 65; }, "link_share", "65", "64"},
      {[](Calibration& c) { c.rows[2] = c.rows[1]; }, "task[2].level", "= 0", "once for fusion"},
  };
  for (const auto& bad : cases) {
    Calibration c = whole();
    bad.make(c);
    const auto back = tasks::read_calibration(text_of(c), "bad.toml");
    ASSERT_FALSE(back) << bad.key;
    EXPECT_THAT(back.error(), AllOf(HasSubstr("bad.toml"), HasSubstr(bad.key), HasSubstr(bad.value),
                                    HasSubstr(bad.allowed)));
    EXPECT_EQ(back.error().find('\n'), std::string::npos) << back.error();
  }
}

// Whatever is accepted has the properties that admission builds on; what is not is one line.
TEST(Calibration, ReadsAnyBytes) {
  const std::string good = text_of(whole());
  const std::uint64_t seed = 20;
  std::printf("seed %llu\n", static_cast<unsigned long long>(seed));
  rt::Random random(seed);
  int accepted = 0;
  for (int trial = 0; trial < 400; ++trial) {
    std::string text = good;
    for (std::int64_t n = random.integer(1, 3); n > 0; --n) {
      const auto at =
          static_cast<std::size_t>(random.integer(0, static_cast<std::int64_t>(text.size()) - 1));
      switch (random.integer(0, 3)) {
        case 0:
          text[at] = static_cast<char>(random.integer(0, 255));
          break;
        case 1:
          text.erase(at, static_cast<std::size_t>(random.integer(1, 40)));
          break;
        case 2:
          text[at] = static_cast<char>('0' + random.integer(0, 9));
          break;
        default:
          text.insert(at, text.substr(at / 2, static_cast<std::size_t>(random.integer(1, 40))));
      }
    }
    const auto back = tasks::read_calibration(text, "fuzz.toml");
    if (!back) {
      EXPECT_THAT(back.error(), HasSubstr("fuzz.toml"));
      EXPECT_EQ(back.error().find('\n'), std::string::npos) << back.error();
      continue;
    }
    ++accepted;
    for (const auto& r : back.value().rows) {
      EXPECT_GT(r.budget().count(), 0);
      EXPECT_TRUE(std::is_sorted(r.quantiles_us.begin(), r.quantiles_us.end()));
    }
    (void)tasks::make_specs(back.value());
  }
  EXPECT_GT(accepted, 20) << "too few to say anything";
  EXPECT_LT(accepted, 380);
}

}  // namespace
