// What a log's records can not tell, its end does: releases that a thread which had ended lost, and
// records that found a full ring.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <stdexcept>
#include <string>
#include <vector>

#include "rt/audit/run_file.hpp"
#include "rt/store/run_store.hpp"
#include "tools/teletact/commands.hpp"

namespace {

using testing::HasSubstr;
using testing::Not;

struct Answer {
  int code = 0;
  std::string text;
};

// `teletact audit` on a hundred good jobs with this end.
Answer audit(const rt::TaskTotals& totals, std::uint64_t dropped) {
  const auto path = std::filesystem::temp_directory_path() /
                    ("teletact_audit_end_" + std::to_string(::getpid()) + ".run");
  rt::RunLog log;
  rt::TaskLog t;
  t.spec.name = "haptic";
  t.spec.rate = {1000, 1};
  t.spec.budget = rt::Nanos{100'000};
  log.tasks.push_back(t);
  {
    rt::RunFileWriter writer(path.string(), log);
    for (std::uint64_t k = 0; k < 100; ++k) {
      rt::JobRecord r;
      r.k = k;
      r.release_ns = static_cast<std::int64_t>(k) * 1'000'000;
      r.deadline_ns = r.release_ns + 1'000'000;
      r.start_ns = r.release_ns + 10'000;
      r.end_ns = r.start_ns + 20'000;
      r.cpu_ns = 20'000;
      r.voluntary = 1;
      writer.add(r);
    }
    writer.finish({{0, totals}}, dropped);
  }
  std::vector<std::string> words{"audit", path.string()};
  std::vector<char*> argv;
  for (auto& w : words) argv.push_back(w.data());
  testing::internal::CaptureStdout();
  Answer a;
  a.code = teletact::cmd_audit(static_cast<int>(argv.size()), argv.data());
  std::fflush(stdout);
  a.text = testing::internal::GetCapturedStdout();
  std::filesystem::remove(path);
  return a;
}

TEST(AuditEnd, AnEndedThreadIsAgainstTheRun) {
  EXPECT_EQ(audit({100, 0, 0, 0, 0, 0}, 0).code, 0);
  EXPECT_EQ(audit({100, 0, 0, 900, 0, 900}, 0).code, 1);
}

TEST(AuditEnd, LostRecordsAreSaid) {
  EXPECT_THAT(audit({100, 0, 0, 0, 0, 0}, 0).text, Not(HasSubstr("AUDIT INCOMPLETE")));
  EXPECT_THAT(audit({105, 0, 0, 0, 0, 0}, 5).text, HasSubstr("AUDIT INCOMPLETE: 5 records lost"));
}

// The job records of one box that ran by itself for two seconds, as its folder raw.
struct OneBox {
  std::filesystem::path folder =
      std::filesystem::temp_directory_path() / ("teletact_one_box_" + std::to_string(::getpid()));
  explicit OneBox(const std::string& box) {
    std::filesystem::create_directories(folder / "raw");
    rt::RunLog log;
    rt::TaskLog t;
    t.spec.name = "robot_io";
    t.spec.rate = {1000, 1};
    t.spec.budget = rt::Nanos{100'000};
    log.tasks.push_back(t);
    log.epoch_ns = 7'000'000'000;
    rt::RunStore store((folder / "raw" / (box + ".run")).string(), log);
    for (std::uint64_t k = 0; k < 2000; ++k) {
      rt::JobRecord r;
      r.k = k;
      r.release_ns = log.epoch_ns + static_cast<std::int64_t>(k) * 1'000'000;
      r.deadline_ns = r.release_ns + 1'000'000;
      r.start_ns = r.release_ns + 10'000;
      r.end_ns = r.start_ns + 20'000;
      r.cpu_ns = 20'000;
      r.voluntary = 1;
      store.add(r);
    }
    store.finish({{0, {2000, 0, 0, 0, 0, 0}}}, 0);
  }
  ~OneBox() { std::filesystem::remove_all(folder); }
  OneBox(const OneBox&) = delete;
  OneBox& operator=(const OneBox&) = delete;

  [[nodiscard]] std::string path(const std::string& name) const { return (folder / name).string(); }
};

// What the command says; of one that throws, that one line.
Answer tell(int (*command)(int, char**), std::vector<std::string> words) {
  std::vector<char*> argv;
  for (auto& w : words) argv.push_back(w.data());
  testing::internal::CaptureStdout();
  Answer a;
  std::string thrown;
  try {
    a.code = command(static_cast<int>(argv.size()), argv.data());
  } catch (const std::runtime_error& e) {
    a.code = 2;
    thrown = e.what();
  }
  std::fflush(stdout);
  a.text = testing::internal::GetCapturedStdout() + thrown;
  return a;
}

TEST(OneBoxsRun, ItsReportIsMadeFromItsHalfAlone) {
  for (const std::string box : {"robot", "operator"}) {
    const OneBox run(box);
    const Answer a =
        tell(teletact::cmd_report, {"report", run.path("raw"), "--report", run.path("again")});
    EXPECT_EQ(a.code, 0) << a.text;
    EXPECT_TRUE(std::filesystem::exists(run.path("again/report.html"))) << a.text;
    std::filesystem::remove_all(run.folder / "raw" / (box + ".run"));
    const Answer none =
        tell(teletact::cmd_report, {"report", run.path("raw"), "--report", run.path("none")});
    EXPECT_EQ(none.code, 2);
    EXPECT_THAT(none.text, HasSubstr("neither operator.run nor robot.run is there"));
  }
}

TEST(OneBoxsRun, APieceBeyondItsEndIsSaid) {
  const OneBox run("robot");
  const char* said = "nothing of the run lies in that piece (it ends at 1.99903 s)";
  const Answer audited =
      tell(teletact::cmd_audit, {"audit", run.path("raw/robot.run"), "--from", "3"});
  EXPECT_EQ(audited.code, 2);
  EXPECT_THAT(audited.text, HasSubstr(said));
  const Answer reported = tell(teletact::cmd_report, {"report", run.path("raw"), "--from", "3",
                                                      "--report", run.path("again")});
  EXPECT_EQ(reported.code, 2);
  EXPECT_THAT(reported.text, HasSubstr(said));
  EXPECT_EQ(tell(teletact::cmd_audit, {"audit", run.path("raw/robot.run"), "--from", "1"}).code, 0);
}

}  // namespace
