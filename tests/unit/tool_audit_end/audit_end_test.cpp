// What a log's records can not tell, its end does: releases that a thread which had ended lost, and records
// that found a full ring.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <string>
#include <vector>

#include "rt/audit/run_file.hpp"
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

}  // namespace
