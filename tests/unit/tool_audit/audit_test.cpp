// The audit's figures, and its exit code by the budget.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>

#include "rt/audit/run_file.hpp"
#include "rt/random.hpp"
#include "tools/host/task_times.hpp"
#include "tools/teletact/commands.hpp"

namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

constexpr std::int64_t kUs = 1000, kMs = 1000000;
constexpr std::uint64_t kWorkMax = 1000;

// Two levels: budgets 100 and 50 us, 1 kHz; calibration saw at most kWorkMax.
rt::TaskLog task_log(const std::string& name, std::uint16_t id) {
  rt::TaskLog t;
  t.id = id;
  t.spec.name = name;
  t.spec.rate = {1000, 1};
  t.spec.variants = {{"full", rt::Nanos{100 * kUs}}, {"less", rt::Nanos{50 * kUs}}};
  t.spec.budget = t.spec.variants[0].budget;
  t.work_max = kWorkMax;
  return t;
}

rt::JobRecord& add_job(rt::TaskLog& t, std::int64_t cpu, std::uint64_t work = kWorkMax / 2,
                       std::uint8_t level = 0) {
  rt::JobRecord r;
  r.task = t.id;
  r.k = t.jobs.size();
  r.release_ns = static_cast<std::int64_t>(r.k) * kMs;
  r.deadline_ns = r.release_ns + kMs;
  r.start_ns = r.release_ns + 10 * kUs;
  r.end_ns = r.start_ns + cpu;
  r.cpu_ns = cpu;
  r.work = work;
  r.level = level;
  r.voluntary = 1;
  t.jobs.push_back(r);
  return t.jobs.back();
}

class Folder {
 public:
  Folder() : path_(fs::temp_directory_path() / ("teletact_audit_" + std::to_string(::getpid()))) {
    fs::remove_all(path_);
    fs::create_directories(path_);
  }
  ~Folder() { fs::remove_all(path_); }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  [[nodiscard]] std::string operator/(const std::string& name) const {
    return (path_ / name).string();
  }
  // One task's run file.
  [[nodiscard]] std::string write(const std::string& name, const rt::TaskLog& task) const {
    rt::RunLog header;
    header.tasks = {task};
    header.tasks[0].jobs.clear();
    rt::RunFileWriter writer((path_ / name).string(), header);
    for (const auto& j : task.jobs) writer.add(j);
    return (path_ / name).string();
  }

 private:
  fs::path path_;
};

struct Answer {
  int code = 0;
  std::string text;
};
Answer audit(std::vector<std::string> words) {
  words.insert(words.begin(), "audit");
  std::vector<char*> argv;
  for (auto& w : words) argv.push_back(w.data());
  testing::internal::CaptureStdout();
  Answer a;
  a.code = teletact::cmd_audit(static_cast<int>(argv.size()), argv.data());
  std::fflush(stdout);
  a.text = testing::internal::GetCapturedStdout();
  return a;
}

nlohmann::json read_json(const std::string& path) {
  std::ifstream in(path);
  return nlohmann::json::parse(in);
}

TEST(Audit, SlackQuantilesAreThoseOfTheSortedValues) {
  const std::uint64_t seed = 20;
  RecordProperty("seed", static_cast<int>(seed));
  rt::Random random(seed);
  for (int round = 0; round < 50; ++round) {
    teletact::SlackTimes slack;
    std::vector<std::int64_t> sorted;
    const int n = 1 + static_cast<int>(random.uniform() * 3000);
    const double late = random.uniform();
    for (int i = 0; i < n; ++i) {
      const auto size = static_cast<std::int64_t>(std::exp(random.uniform() * 18));
      sorted.push_back(random.uniform() < late ? -size : size);
      slack.record(sorted.back());
    }
    std::sort(sorted.begin(), sorted.end());
    EXPECT_EQ(slack.least(), sorted.front());
    for (const double q : {0.0, 0.001, 0.01, 0.3, 0.5, 0.9, 1.0}) {
      const auto rank = static_cast<std::size_t>(std::max(1.0, std::ceil(q * n - 1e-9)));
      const auto exact = static_cast<double>(sorted[rank - 1]);
      const auto got = static_cast<double>(slack.quantile(q));
      EXPECT_NEAR(got, exact, std::abs(exact) / 64 + 1)
          << "q " << q << " of " << n << ", seed " << seed;
    }
  }
}

TEST(Audit, BudgetIsCheckedALevelAndWithoutWhatTheMachineCharged) {
  rt::RunLog log;
  rt::TaskLog t = task_log("haptic", 0);
  for (int i = 0; i < 2000; ++i) add_job(t, 40 * kUs);
  for (int i = 0; i < 10; ++i) add_job(t, 400 * kUs);  // charged: no more work
  for (int i = 0; i < 1000; ++i) add_job(t, 30 * kUs, 500, 1);
  for (int i = 0; i < 2; ++i) add_job(t, 60 * kUs, 2 * kWorkMax, 1);  // own, of 1002
  const auto checks = teletact::check_budget(t, rt::blame(log, t));
  ASSERT_EQ(checks.size(), 2U);
  EXPECT_EQ(checks[0].charged, 10U);
  EXPECT_EQ(checks[0].jobs, 2000U);
  EXPECT_EQ(checks[0].cpu_p999_ns, 40 * kUs);
  EXPECT_TRUE(checks[0].kept());
  EXPECT_EQ(checks[1].cpu_p999_ns, 60 * kUs);
  EXPECT_EQ(checks[1].budget_ns, 50 * kUs);
  EXPECT_FALSE(checks[1].kept());
}

TEST(Audit, ExitCodeIsByTheBudget) {
  const Folder folder;
  rt::TaskLog kept = task_log("haptic", 0);
  for (int i = 0; i < 3000; ++i) add_job(kept, 90 * kUs);
  rt::TaskLog one_in_1500 = kept, three_in_1500 = kept, charged = kept;
  for (int i = 0; i < 2; ++i) add_job(one_in_1500, 300 * kUs, 2 * kWorkMax);
  for (int i = 0; i < 6; ++i) add_job(three_in_1500, 300 * kUs, 2 * kWorkMax);
  for (int i = 0; i < 100; ++i) add_job(charged, 300 * kUs);
  EXPECT_EQ(audit({folder.write("kept.run", kept)}).code, 0);
  EXPECT_EQ(audit({folder.write("few.run", one_in_1500)}).code, 0) << "p99.9 is within";
  EXPECT_EQ(audit({folder.write("charged.run", charged)}).code, 0);
  const Answer over = audit({folder.write("over.run", three_in_1500)});
  EXPECT_EQ(over.code, 1) << "no miss, but more CPU than admitted";
  EXPECT_THAT(over.text,
              HasSubstr("haptic, level 0: CPU p99.9 300.0 us is over the budget of 100.0"));
  // A miss of its own still counts, within p99.9 or not.
  add_job(kept, 1500 * kUs, 2 * kWorkMax);
  const Answer missed = audit({folder.write("missed.run", kept)});
  EXPECT_EQ(missed.code, 1);
  EXPECT_THAT(missed.text, HasSubstr("1 misses of its own making"));
}

TEST(Audit, EveryFileIsInTheReport) {
  const Folder folder;
  std::vector<std::string> words;
  for (const char* name : {"haptic", "planning", "capture", "haptic"}) {
    rt::TaskLog t = task_log(name, 0);
    for (int i = 0; i < 100; ++i) add_job(t, 40 * kUs);
    add_job(t, 1200 * kUs);  // past its deadline by 210 us
    words.push_back(folder.write(std::to_string(words.size()) + ".run", t));
  }
  words.insert(words.end(), {"--html", folder / "html", "--json", folder / "f.json"});
  const Answer a = audit(words);
  EXPECT_THAT(a.text, HasSubstr("slack p50"));
  const auto report = read_json(folder / "html/report.json");
  std::vector<std::string> names;
  for (const auto& t : report.at("tasks")) {
    names.push_back(t.at("name"));
    EXPECT_NEAR(t.at("slack_us").at("min").get<double>(), -210, 1e-6);
    EXPECT_NEAR(t.at("slack_us").at("p50").get<double>(), 950, 950 / 64.0);
    EXPECT_NEAR(t.at("response_us").at("max").get<double>(), 1210, 1e-6);
    double jobs = 0;
    for (const auto& h : t.at("histograms").at("slack_us")) {
      for (const double n : h.at("count")) jobs += n;
    }
    EXPECT_EQ(jobs, 101);
  }
  EXPECT_THAT(names, testing::ElementsAre("haptic", "planning", "capture", "haptic_2"));
  std::ifstream in(folder / "html/report.html");
  const std::string html{std::istreambuf_iterator<char>(in), {}};
  for (const auto& name : names) {
    EXPECT_THAT(html, HasSubstr(name + ": slack of a job"));
    EXPECT_THAT(html, HasSubstr(name + ": response of a job"));
  }
  EXPECT_EQ(html.find("the scene calls for no effect"), std::string::npos) << "a log knows none";
  std::set<std::string> seen;
  const auto metrics = read_json(folder / "f.json");
  for (const auto& m : metrics.at("metrics"))
    EXPECT_TRUE(seen.insert(m.at("name")).second) << m.at("name");
  EXPECT_EQ(seen.count("haptic_2.slack_min_us"), 1U);
}

}  // namespace
