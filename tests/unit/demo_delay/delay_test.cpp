// The default demo over a late link: where the delay is to be borne it drives to its goal, beyond
// that it stands, and says why at every place where a person looks.
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <sstream>

#include "tasks/prediction/prediction_task.hpp"
#include "tools/host/calibrate.hpp"
#include "tools/host/run_options.hpp"
#include "tools/host/script_goal.hpp"

namespace {

using teletact::DemoOptions;
using teletact::GoalCheck;
using teletact::VirtualRun;

struct Late {
  VirtualRun run;
  GoalCheck goal;
  std::string said, log;  // the status lines; what the operator's tasks told
  teletact::Metrics metrics{"test"};
  teletact::ReportData report;

  [[nodiscard]] double value(const std::string& name) const {
    for (const auto& row : metrics.rows()) {
      if (row.name == name) return row.value;
    }
    ADD_FAILURE() << "no metric " << name;
    return std::nan("");
  }
};

Late drive(int one_way_ms, double seconds, std::vector<std::string> overrides = {}) {
  static rt::Startup startup;
  overrides.push_back("link.shape.delay_ms=" + std::to_string(one_way_ms));
  const auto scene =
      teletact::load_scene(teletact::find_config("scenes", "default_room"), overrides);
  DemoOptions options;
  options.seconds = seconds;
  options.virtual_clock = true;
  options.cores = 2;  // the smaller variants: faster
  options.log_folder = (std::filesystem::temp_directory_path() /
                        ("delay_" + std::to_string(getpid()) + "_" + std::to_string(one_way_ms)))
                           .string();
  testing::internal::CaptureStdout();
  VirtualRun run =
      teletact::run_virtual(startup.token(), *scene, options, teletact::reference_calibration());
  Late late;
  late.said = testing::internal::GetCapturedStdout();
  std::ostringstream log;
  log << std::ifstream(options.log_folder + "/operator.log").rdbuf();
  late.log = log.str();
  std::filesystem::remove_all(options.log_folder);
  late.goal = teletact::check_goal(*scene, options, run.op, run.robot);
  teletact::RunInfo info;
  info.virtual_clock = true;
  teletact::add_metrics(info, run.op, run.robot, late.metrics);
  late.report = teletact::make_report(info, run.op, run.robot, late.metrics);
  late.run = std::move(run);
  return late;
}

// The scene's own jitter (5 ms) and rate with it.
TEST(Delay, AHundredAndFiftyMillisecondsOneWayAreDriven) {
  const Late late = drive(150, 16);
  EXPECT_GE(late.value("link.round_trip_ms"), 300);
  EXPECT_EQ(late.value("robot.arrivals"), 1);
  EXPECT_LE(late.value("robot.goal_error_m"), 0.03);
  EXPECT_EQ(late.value("robot.collisions"), 0);
  EXPECT_EQ(late.value("robot.held_s"), 0);
  EXPECT_EQ(late.goal.missed, "");
  EXPECT_EQ(late.said.find("STANDS"), std::string::npos) << late.said;
}

TEST(Delay, BeyondWhatIsBorneItStandsAndSaysWhy) {
  const Late late = drive(250, 16);
  EXPECT_EQ(late.value("plan.paths"), 1);
  EXPECT_EQ(late.value("robot.arrivals"), 0);
  EXPECT_LE(late.value("robot.path_m"), 1e-6) << "it does not crawl";
  EXPECT_GE(late.value("robot.held_s"), 10);
  EXPECT_TRUE(late.goal.judged) << "more time would not help";
  std::string verdicts;
  for (const auto& v : late.report.verdicts) verdicts += v.text + "\n";
  for (const std::string& text : {late.said, late.goal.missed, verdicts}) {
    EXPECT_NE(text.find("robot state 5"), std::string::npos) << text;
    EXPECT_NE(text.find(" ms old, limit 500 ms"), std::string::npos) << text;
  }
  EXPECT_NE(late.said.find("STANDS: robot state 5"), std::string::npos) << late.said;
  EXPECT_NE(late.log.find("robot_state: 2 (0 in time again, 1 silent, 2 old), 5"),
            std::string::npos)
      << late.log;
  EXPECT_NE(late.log.find(" ms, limit 500 ms; beyond its limits: goals are not engaged"),
            std::string::npos);
  // Health: F-PRE-01 of prediction's last job.
  for (const auto& task : late.run.op.log.tasks) {
    if (task.spec.name != "prediction") continue;
    ASSERT_FALSE(task.jobs.empty());
    EXPECT_EQ(task.jobs.back().fault, tasks::prediction_fault::kStateStale);
  }
}

}  // namespace
