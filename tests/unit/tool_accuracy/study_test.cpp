// The framework of the studies: fronts against brute force, what tables, metrics and plots hold.
#include "tools/measure/accuracy/study.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <sstream>

#include "rt/random.hpp"
#include "tests/support/xml_check.hpp"

namespace teletact {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

// Straight from the definition.
std::vector<std::size_t> slow_front(const std::vector<double>& cost,
                                    const std::vector<double>& error) {
  std::vector<std::size_t> front;
  for (std::size_t i = 0; i < cost.size(); ++i) {
    if (!std::isfinite(cost[i]) || !std::isfinite(error[i])) continue;
    bool beaten = false;
    for (std::size_t j = 0; j < cost.size(); ++j) {
      beaten = beaten || (cost[j] <= cost[i] && error[j] <= error[i] &&
                          (cost[j] < cost[i] || error[j] < error[i]));
    }
    if (!beaten) front.push_back(i);
  }
  return front;
}

TEST(Study, FrontIsTheUnbeaten) {
  constexpr std::uint64_t kSeed = 20;
  rt::Random random(kSeed);
  for (int round = 0; round < 500; ++round) {
    std::vector<double> cost, error;
    for (std::int64_t n = random.integer(0, 30); n > 0; --n) {
      // Few values, so that equal ones occur.
      cost.push_back(static_cast<double>(random.integer(0, 12)));
      error.push_back(random.integer(0, 20) == 0 ? std::numeric_limits<double>::quiet_NaN()
                                                 : static_cast<double>(random.integer(0, 12)));
    }
    std::vector<std::size_t> front = pareto_front(cost, error);
    for (std::size_t i = 1; i < front.size(); ++i) EXPECT_LE(cost[front[i - 1]], cost[front[i]]);
    std::sort(front.begin(), front.end());
    EXPECT_EQ(front, slow_front(cost, error)) << "seed " << kSeed << ", round " << round;
  }
}

Study sample() {
  Study s;
  s.name = "accuracy.thing";
  const auto row = [&](const char* setting, double cost, double error, bool usual) {
    StudyRow r;
    r.data = "room", r.knob = "size", r.setting = setting, r.label = std::string("size ") + setting;
    r.is_default = usual;
    r.figures = {{"cpu_ms", cost, "ms"}, {"error_mm", error, "mm"}};
    s.rows.push_back(r);
  };
  row("small", 1, 9, false);
  row("middle", 3, 2, true);
  row("large", 9, 4, false);  // beaten by middle
  s.rows[0].figures.push_back({"other_mm", std::nan(""), "mm"});
  s.plots.push_back({"thing", "a <thing>", "room", "error_mm", "error, mm", "cpu_ms", "CPU, ms"});
  return s;
}

TEST(Study, MetricsAreNamedByDataAndSetting) {
  const auto metrics = sample().metrics();
  ASSERT_EQ(metrics.size(), 6U) << "what was not measured is left out";
  EXPECT_EQ(metrics[0].name, "accuracy.thing.room.small.cpu_ms");
  EXPECT_EQ(metrics[3].name, "accuracy.thing.room.middle.error_mm");
  EXPECT_EQ(metrics[3].value, 2);
  EXPECT_EQ(metrics[3].unit, "mm");
}

TEST(Study, TableMarksDefaultAndFront) {
  std::ostringstream out;
  sample().print(out);
  EXPECT_THAT(out.str(), HasSubstr("\n*+size middle"));
  EXPECT_THAT(out.str(), HasSubstr("\n +size small"));
  EXPECT_THAT(out.str(), HasSubstr("\n  size large"));
  EXPECT_THAT(out.str(), Not(HasSubstr("other_mm")));
}

TEST(Study, PlotNamesEverySettingAndRingsTheDefault) {
  Study s = sample();
  const std::string svg = study_svg(s, s.plots[0]);
  EXPECT_EQ(support::xml_problem(svg), "");
  for (const char* label : {"size small", "size middle", "size large", "Pareto front", "CPU, ms"}) {
    EXPECT_THAT(svg, HasSubstr(label));
  }
  const auto rings = [](const std::string& text) {
    std::size_t n = 0;
    for (std::size_t at = 0; (at = text.find("r=\"5\" fill=\"none\"", at)) != std::string::npos;
         ++at)
      ++n;
    return n;
  };
  EXPECT_EQ(rings(svg), 1U);
  for (auto& row : s.rows) row.is_default = false;
  EXPECT_EQ(rings(study_svg(s, s.plots[0])), 0U);
}

TEST(Study, PlotsAreWrittenOrTheFolderIsNamed) {
  namespace fs = std::filesystem;
  const fs::path folder =
      fs::temp_directory_path() / ("teletact_study_" + std::to_string(::getpid()));
  const auto files = sample().write_plots(folder.string());
  ASSERT_EQ(files.size(), 1U);
  EXPECT_GT(fs::file_size(files[0]), 500U);
  fs::remove_all(folder);
  try {
    static_cast<void>(sample().write_plots("/proc/none"));
    FAIL() << "written where nothing can be";
  } catch (const std::runtime_error& e) {
    EXPECT_THAT(e.what(), HasSubstr("/proc/none"));
  }
}

}  // namespace
}  // namespace teletact
