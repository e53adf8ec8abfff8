#include "rt/audit/run_file.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <stdexcept>

#include "rt/random.hpp"

namespace {

using rt::JobRecord;
using rt::read_run_file;
using rt::RunLog;
using rt::SentinelRecord;
using testing::HasSubstr;

std::string path_of(const std::string& name) {
  return (std::filesystem::temp_directory_path() /
          ("teletact_" + std::to_string(::getpid()) + "_" + name))
      .string();
}

struct TempFile {
  std::string path =
      path_of(std::string(testing::UnitTest::GetInstance()->current_test_info()->name()));
  ~TempFile() { std::filesystem::remove(path); }
  [[nodiscard]] std::string bytes() const {
    std::ifstream in(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
  }
  void put(const std::string& b) const { std::ofstream(path, std::ios::binary) << b; }
};

RunLog header() {
  RunLog log;
  rt::TaskLog a;
  a.id = 0;
  a.spec.name = "haptic";
  a.spec.rate = {1000, 1};
  a.spec.budget = rt::Nanos{100000};
  a.core = 3;
  a.priority = 80;
  a.work_min = 10;
  a.work_max = 12345678901;
  rt::TaskLog b;
  b.id = 7;
  b.spec.name = "fusion";
  b.spec.box = rt::Box::kRobot;
  b.spec.task_class = rt::TaskClass::kFirm;
  b.spec.rate = {30, 1};
  b.spec.deadline = rt::Nanos{40000000};
  b.spec.policy = rt::MissPolicy::kDegrade;
  b.spec.variants = {{"full", rt::Nanos{25000000}}, {"small", rt::Nanos{9000000}}};
  b.level = 1;
  log.tasks = {a, b};
  log.not_realtime = {"SCHED_FIFO: not permitted", "two\nlines", ""};
  return log;
}

JobRecord random_job(rt::Random& r, std::uint16_t task, std::uint64_t k) {
  JobRecord j;
  j.task = task;
  j.k = k;
  j.release_ns = static_cast<std::int64_t>(r() >> 2U);
  j.start_ns = static_cast<std::int64_t>(r() >> 2U);
  j.end_ns = static_cast<std::int64_t>(r() >> 2U);
  j.deadline_ns = static_cast<std::int64_t>(r() >> 2U);
  j.cpu_ns = static_cast<std::int64_t>(r() >> 2U);
  j.work = r();
  j.output_hash = r();
  for (auto& s : j.input_seq) s = r();
  j.skipped = static_cast<std::uint32_t>(r());
  j.level = static_cast<std::uint8_t>(task == 7 ? r.integer(0, 1) : 0);
  return j;
}

bool same(const JobRecord& a, const JobRecord& b) {
  return a.k == b.k && a.task == b.task && a.release_ns == b.release_ns &&
         a.start_ns == b.start_ns && a.end_ns == b.end_ns && a.deadline_ns == b.deadline_ns &&
         a.cpu_ns == b.cpu_ns && a.work == b.work && a.output_hash == b.output_hash &&
         a.input_seq == b.input_seq && a.skipped == b.skipped && a.level == b.level &&
         a.outcome == b.outcome;
}

TEST(RunFile, RoundTrip) {
  TempFile f;
  rt::Random r(41);
  std::vector<JobRecord> a, b;
  std::vector<SentinelRecord> s;
  {
    rt::RunFileWriter w(f.path, header());
    for (std::uint64_t k = 0; k < 200; ++k) {
      a.push_back(random_job(r, 0, k));
      w.add(a.back());
      if (k % 3 == 0) {
        b.push_back(random_job(r, 7, k));
        w.add(b.back());
      }
      s.push_back({static_cast<std::int64_t>(k), r.integer(0, 1000), 3});
      w.add(s.back());
    }
  }
  const auto got = read_run_file(f.path);
  ASSERT_TRUE(got) << got.error();
  const RunLog& log = got.value();
  ASSERT_EQ(log.tasks.size(), 2U);
  const auto& h = log.tasks[0];
  EXPECT_EQ(h.id, 0);
  EXPECT_EQ(h.spec.name, "haptic");
  EXPECT_EQ(h.spec.rate, (rt::Rate{1000, 1}));
  EXPECT_EQ(h.spec.relative_deadline().count(), 1000000);
  EXPECT_EQ(h.spec.budget_of(0).count(), 100000);
  EXPECT_EQ(h.core, 3);
  EXPECT_EQ(h.priority, 80);
  EXPECT_EQ(h.work_min, 10U);
  EXPECT_EQ(h.work_max, 12345678901U);
  const auto& g = log.tasks[1];
  EXPECT_EQ(g.id, 7);
  EXPECT_EQ(g.spec.box, rt::Box::kRobot);
  EXPECT_EQ(g.spec.task_class, rt::TaskClass::kFirm);
  EXPECT_EQ(g.spec.policy, rt::MissPolicy::kDegrade);
  EXPECT_EQ(g.spec.relative_deadline().count(), 40000000);
  EXPECT_EQ(g.spec.levels(), 2);
  EXPECT_EQ(g.spec.budget_of(1).count(), 9000000);
  EXPECT_EQ(g.level, 1);
  EXPECT_THAT(log.not_realtime, testing::ElementsAre("SCHED_FIFO: not permitted", "two lines", ""));
  ASSERT_EQ(h.jobs.size(), a.size());
  ASSERT_EQ(g.jobs.size(), b.size());
  ASSERT_EQ(log.sentinels.size(), s.size());
  for (std::size_t i = 0; i < a.size(); ++i) EXPECT_TRUE(same(h.jobs[i], a[i])) << i;
  for (std::size_t i = 0; i < b.size(); ++i) EXPECT_TRUE(same(g.jobs[i], b[i])) << i;
  for (std::size_t i = 0; i < s.size(); ++i) {
    EXPECT_EQ(log.sentinels[i].release_ns, s[i].release_ns);
    EXPECT_EQ(log.sentinels[i].late_ns, s[i].late_ns);
    EXPECT_EQ(log.sentinels[i].core, s[i].core);
  }
}

TEST(RunFile, TheTrailerTellsWhatTheRecordsCanNot) {
  TempFile f;
  rt::Random r(48);
  const rt::TaskTotals haptic{90, 3, 2, 8, 0, 5};
  std::size_t before = 0;
  {
    rt::RunFileWriter w(f.path, header());
    w.add(random_job(r, 0, 1));
    w.flush();
    before = f.bytes().size();
    // 9 is no task of the header: left out.
    w.finish({{0, haptic}, {9, haptic}}, 17);
  }
  const std::string all = f.bytes();
  for (std::size_t n = before; n <= all.size(); ++n) {
    f.put(all.substr(0, n));
    const auto got = read_run_file(f.path);
    ASSERT_TRUE(got) << n << ": " << got.error();
    const auto& log = got.value();
    ASSERT_EQ(log.tasks.size(), 2U);
    EXPECT_EQ(log.tasks[0].jobs.size(), 1U);
    EXPECT_FALSE(log.tasks[1].totals);
    EXPECT_EQ(log.dropped, n == all.size() ? 17U : 0U);
    ASSERT_EQ(log.tasks[0].totals.has_value(), n >= before + 1 + sizeof(rt::RunFileTotals)) << n;
    if (!log.tasks[0].totals) continue;
    const auto& t = *log.tasks[0].totals;
    EXPECT_EQ(t.completed, 90U);
    EXPECT_EQ(t.late, 3U);
    EXPECT_EQ(t.aborted, 2U);
    EXPECT_EQ(t.skipped, 8U);
    EXPECT_EQ(t.lost, 5U);
  }
}

TEST(RunFile, JobsComeBackInOrderOfRelease) {
  TempFile f;
  rt::Random r(42);
  {
    rt::RunFileWriter w(f.path, header());
    for (const std::uint64_t k : {5U, 1U, 9U, 0U}) w.add(random_job(r, 0, k));
  }
  const auto got = read_run_file(f.path);
  ASSERT_TRUE(got);
  std::vector<std::uint64_t> order;
  for (const auto& j : got.value().tasks[0].jobs) order.push_back(j.k);
  EXPECT_THAT(order, testing::ElementsAre(0, 1, 5, 9));
}

// What a flush handed over is readable while the writer still has the file open, as after a kill.
TEST(RunFile, FlushedRecordsAreReadableAtOnce) {
  TempFile f;
  rt::Random r(43);
  rt::RunFileWriter w(f.path, header());
  for (std::uint64_t k = 0; k < 10; ++k) w.add(random_job(r, 0, k));
  w.flush();
  const auto got = read_run_file(f.path);
  ASSERT_TRUE(got);
  EXPECT_EQ(got.value().tasks[0].jobs.size(), 10U);
}

TEST(RunFile, TornAtEveryByteOfTheLastRecordsStillReads) {
  TempFile f;
  rt::Random r(44);
  std::size_t before = 0;
  {
    rt::RunFileWriter w(f.path, header());
    for (std::uint64_t k = 0; k < 5; ++k) w.add(random_job(r, 0, k));
    w.add(SentinelRecord{1, 2, 3});
    w.flush();
    before = f.bytes().size();
    w.add(random_job(r, 0, 5));
    w.add(SentinelRecord{2, 2, 3});
  }
  const std::string all = f.bytes();
  const std::size_t job_end = before + 1 + sizeof(JobRecord);
  ASSERT_EQ(all.size(), job_end + 1 + sizeof(SentinelRecord));
  for (std::size_t n = before; n <= all.size(); ++n) {
    f.put(all.substr(0, n));
    const auto got = read_run_file(f.path);
    ASSERT_TRUE(got) << n << ": " << got.error();
    EXPECT_EQ(got.value().tasks[0].jobs.size(), n >= job_end ? 6U : 5U) << n;
    EXPECT_EQ(got.value().sentinels.size(), n == all.size() ? 2U : 1U) << n;
  }
}

TEST(RunFile, ForeignFilesAreRefusedWithOneMessage) {
  TempFile f;
  for (const std::string& text : {std::string(), std::string("\n"), std::string("P6 512 424\n"),
                                  std::string("teletact-run 4 1 1\n"),
                                  std::string("teletact-run 3 8 8\n\n"), std::string(5000, '\0'),
                                  std::string("\x7f"
                                              "ELF\1\1\1")}) {
    f.put(text);
    const auto got = read_run_file(f.path);
    ASSERT_FALSE(got);
    EXPECT_EQ(got.error(), f.path + ":1: not a run log of this version");
  }
  EXPECT_FALSE(read_run_file(std::filesystem::temp_directory_path().string()));
  const auto absent = read_run_file(f.path + ".absent");
  ASSERT_FALSE(absent);
  EXPECT_EQ(absent.error(), f.path + ".absent: can not be read");
  EXPECT_THROW(rt::RunFileWriter("/no/such/folder/x.run", header()), std::runtime_error);
}

std::string first_line() {
  return "teletact-run 3 " + std::to_string(sizeof(JobRecord)) + " " +
         std::to_string(sizeof(SentinelRecord)) + "\n";
}

TEST(RunFile, BadHeaderLinesAreNamedByNumber) {
  TempFile f;
  const std::string good = "task 0 haptic 0 0 1000 1 1000000 0 3 80 0 10 20 100000";
  f.put(first_line() + good + "\n\n");
  ASSERT_TRUE(read_run_file(f.path));
  for (const std::string& bad : {
           std::string("hello"), std::string("task"), std::string("notes x"),
           std::string("task 0 haptic 0 0 1000 1 1000000 0 3 80 0 10 20"),          // no budget
           std::string("task 0 haptic 0 0 0 1 1000000 0 3 80 0 10 20 100000"),      // rate 0
           std::string("task 0 haptic 0 0 1000 -1 1000000 0 3 80 0 10 20 100000"),  // rate below 0
           std::string("task 0 haptic 0 0 1000 9000000000000 1000000 0 3 80 0 10 20 100000"),
           std::string("task 0 haptic 0 0 1000 1 1000000 4 3 80 0 10 20 100000"),   // policy
           std::string("task 0 haptic 2 0 1000 1 1000000 0 3 80 0 10 20 100000"),   // box
           std::string("task 0 haptic 0 -1 1000 1 1000000 0 3 80 0 10 20 100000"),  // class
           std::string("task 0 haptic 0 0 1000 1 0 0 3 80 0 10 20 100000"),         // deadline
           std::string(
               "task 0 haptic 0 0 1000 1 1000000 0 3 80 1 10 20 100000"),  // level beyond the last
           std::string("task 0 haptic 0 0 1000 1 1000000 0 3 80 0 10 20 100000 x"),
           std::string("task 99999 haptic 0 0 1000 1 1000000 0 3 80 0 10 20 100000"),
           good,  // the same id twice
       }) {
    f.put(first_line() + good + "\n" + bad + "\n\n");
    const auto got = read_run_file(f.path);
    ASSERT_FALSE(got) << bad;
    EXPECT_EQ(got.error(), f.path + ":3: not a header line") << bad;
  }
}

TEST(RunFile, AnUnknownTagIsDamageAndNamesThePlace) {
  TempFile f;
  rt::Random r(45);
  {
    rt::RunFileWriter w(f.path, header());
    w.add(random_job(r, 0, 1));
  }
  const std::string all = f.bytes();
  f.put(all + "X" + std::string(300, 'y'));
  const auto got = read_run_file(f.path);
  ASSERT_FALSE(got);
  EXPECT_THAT(got.error(),
              HasSubstr(f.path + ": damaged at byte " + std::to_string(all.size() + 1)));
}

// Records of a task or a level that the header does not know are left out, not indexed with.
TEST(RunFile, RecordsOfUnknownTasksAndLevelsAreLeftOut) {
  TempFile f;
  rt::Random r(46);
  {
    rt::RunFileWriter w(f.path, header());
    w.add(random_job(r, 3, 1));
    auto j = random_job(r, 0, 1);
    j.level = 1;  // haptic has one level
    w.add(j);
    j.level = 255;
    w.add(j);
    w.add(random_job(r, 0, 2));
  }
  const auto got = read_run_file(f.path);
  ASSERT_TRUE(got);
  EXPECT_EQ(got.value().tasks[0].jobs.size(), 1U);
}

// Random damage to the header and to tags: a log or one message, never a throw or a crash. Whatever
// is read keeps the promises that its readers index by.
TEST(RunFile, MutatedFilesNeverCrash) {
  constexpr std::uint64_t kSeed = 47;
  std::printf("seed %llu\n", static_cast<unsigned long long>(kSeed));
  TempFile f;
  rt::Random r(kSeed);
  {
    rt::RunFileWriter w(f.path, header());
    for (std::uint64_t k = 0; k < 3; ++k) w.add(random_job(r, 7, k));
    w.add(SentinelRecord{1, 2, 3});
    w.finish({{7, {3, 0, 0, 1, 0, 1}}}, 2);
  }
  const std::string all = f.bytes();
  const auto header_size = static_cast<std::int64_t>(all.find("\n\n") + 2);
  const char* words[] = {"note", "note ", "task", "-1",  "99999999999999999999", " ", "\n",
                         "nan",  "\t",    "0",    "\r\n"};
  int read = 0, refused = 0;
  for (int n = 0; n < 2500; ++n) {
    std::string b = all;
    for (std::int64_t m = r.integer(1, 3); m > 0; --m) {
      const auto last = std::min(header_size, static_cast<std::int64_t>(b.size()) - 1);
      const auto at = static_cast<std::size_t>(
          r.integer(std::min(last, static_cast<std::int64_t>(first_line().size())), last));
      switch (r.integer(0, 4)) {
        case 0:
          b[at] = static_cast<char>(r());
          break;
        case 1:
          b.insert(at, words[r.integer(0, 10)]);
          break;
        case 2:
          b.erase(at, static_cast<std::size_t>(r.integer(1, 12)));
          break;
        case 3:
          b = b.substr(0, at);
          b.resize(std::max(b.size(), static_cast<std::size_t>(header_size) + 1), 'J');
          break;
        default: {
          // A whole line replaced by a word.
          const std::size_t line = b.rfind('\n', at - 1), end = b.find('\n', at);
          if (line != std::string::npos && end != std::string::npos && end > line)
            b.replace(line + 1, end - line - 1, words[r.integer(0, 10)]);
        }
      }
    }
    f.put(b);
    const auto got = read_run_file(f.path);
    if (!got) {
      ++refused;
      EXPECT_THAT(got.error(), testing::StartsWith(f.path + ":"));
      continue;
    }
    ++read;
    for (const auto& t : got.value().tasks) {
      ASSERT_GT(t.spec.period().count(), 0);
      ASSERT_GT(t.spec.relative_deadline().count(), 0);
      ASSERT_LT(t.level, t.spec.levels());
      ASSERT_LE(static_cast<int>(t.spec.box), 1);
      for (const auto& j : t.jobs) ASSERT_LT(j.level, t.spec.levels());
    }
  }
  std::printf("read %d, refused %d\n", read, refused);
  EXPECT_GT(read, 200);
  EXPECT_GT(refused, 200);
}

}  // namespace
