#include "rt/audit/black_box.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cinttypes>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>

#include "rt/random.hpp"

namespace {

using rt::BlackBoxWriter;
using rt::JobRecord;
using rt::Nanos;
using testing::HasSubstr;

struct TempFile {
  std::string path = (std::filesystem::temp_directory_path() /
                      ("teletact_" + std::to_string(::getpid()) + "_box_" +
                       testing::UnitTest::GetInstance()->current_test_info()->name()))
                         .string();
  ~TempFile() { std::filesystem::remove(path); }
  [[nodiscard]] std::string bytes() const {
    std::ifstream in(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
  }
  void put(const std::string& b) const { std::ofstream(path, std::ios::binary) << b; }
};

rt::RunLog header() {
  rt::RunLog log;
  for (const auto& [id, name, hz] : {std::tuple{0, "haptic", 1000}, std::tuple{1, "fusion", 30}}) {
    rt::TaskLog t;
    t.id = static_cast<std::uint16_t>(id);
    t.spec.name = name;
    t.spec.rate = {hz, 1};
    t.spec.budget = Nanos{100000};
    log.tasks.push_back(t);
  }
  log.not_realtime = {"no FIFO"};
  return log;
}

JobRecord job(std::uint16_t task, std::uint64_t k) {
  JobRecord r;
  r.task = task;
  r.k = k;
  r.release_ns = static_cast<std::int64_t>(k) * (task == 0 ? 1000000 : 33333333);
  r.start_ns = r.release_ns + 5000;
  r.end_ns = r.start_ns + 60000;
  r.deadline_ns = r.release_ns + 1000000;
  r.cpu_ns = 50000;
  r.output_hash = rt::mix64(k, task);
  return r;
}

bool same(const JobRecord& a, const JobRecord& b) {
  return a.task == b.task && a.k == b.k && a.release_ns == b.release_ns &&
         a.start_ns == b.start_ns && a.end_ns == b.end_ns && a.cpu_ns == b.cpu_ns &&
         a.output_hash == b.output_hash;
}

std::span<const std::byte> bytes_of(std::string_view text) {
  return std::as_bytes(std::span(text.data(), text.size()));
}

// `seconds` of both tasks, with a sentinel beside each haptic job and a line now and then.
void fill(BlackBoxWriter& box, double seconds) {
  const auto n = static_cast<std::uint64_t>(1000 * seconds);
  for (std::uint64_t k = 0; k < n; ++k) {
    box.add(job(0, k));
    box.add(rt::SentinelRecord{static_cast<std::int64_t>(k) * 1000000, 7, 2});
    if (k % 33 == 0) box.add(job(1, k / 33));
    if (k % 100 == 0) box.add('L', bytes_of("line " + std::to_string(k)));
  }
}

TEST(BlackBox, HoldsTheLastSecondsAndNotMuchMore) {
  TempFile file;
  const Nanos window = std::chrono::seconds{2};
  const std::size_t size = rt::black_box_size(header(), window, 1000);
  BlackBoxWriter box(file.path, header(), window, size);
  fill(box, 11);
  const auto read = rt::read_black_box(file.path);
  ASSERT_TRUE(read.has_value()) << read.error();
  const auto& b = read.value();
  EXPECT_EQ(b.window, window);
  EXPECT_EQ(b.stop, "") << "nobody has said why yet";
  EXPECT_EQ(b.missing, 0U);
  EXPECT_EQ(b.log.not_realtime, std::vector<std::string>{"no FIFO"});
  const auto& haptic = b.log.tasks[0].jobs;
  ASSERT_GE(haptic.size(), 2000U) << "the window";
  EXPECT_LE(haptic.size(), 4000U) << "bounded";
  EXPECT_EQ(haptic.back().k, 10999U);
  for (std::size_t i = 0; i < haptic.size(); ++i)
    ASSERT_TRUE(same(haptic[i], job(0, haptic.front().k + i))) << i;
  EXPECT_GE(b.log.tasks[1].jobs.size(), 60U);
  EXPECT_GE(b.log.sentinels.size(), 2000U);
  ASSERT_GE(b.entries.size(), 20U);
  const auto& last = b.entries.back().payload;
  EXPECT_EQ(std::string(reinterpret_cast<const char*>(last.data()), last.size()), "line 10900");
  EXPECT_EQ(std::filesystem::file_size(file.path), BlackBoxWriter::kRingAt + size / 8 * 8);
}

TEST(BlackBox, ReadsBackBeforeTheFirstLapToo) {
  TempFile file;
  BlackBoxWriter box(file.path, header(), std::chrono::seconds{5}, 1 << 20);
  EXPECT_EQ(rt::read_black_box(file.path).value().records, 0U);
  box.add(job(1, 3));
  box.note_stop("first");
  box.note_stop("second");
  const auto b = rt::read_black_box(file.path).value();
  EXPECT_EQ(b.records, 1U);
  EXPECT_EQ(b.stop, "first") << "what came first is why";
  ASSERT_EQ(b.log.tasks[1].jobs.size(), 1U);
  EXPECT_TRUE(same(b.log.tasks[1].jobs[0], job(1, 3)));
}

TEST(BlackBox, ACopyHasItsOwnReasonAndTheRingGoesOn) {
  TempFile file;
  const std::string copy = file.path + ".copy";
  BlackBoxWriter box(file.path, header(), std::chrono::seconds{1}, 1 << 20);
  fill(box, 1);
  ASSERT_TRUE(box.copy_to(copy, "a stop"));
  box.add(job(0, 1000));
  const auto then = rt::read_black_box(copy).value(), now = rt::read_black_box(file.path).value();
  std::filesystem::remove(copy);
  EXPECT_EQ(then.stop, "a stop");
  EXPECT_EQ(now.stop, "");
  EXPECT_EQ(then.log.tasks[0].jobs.back().k, 999U);
  EXPECT_EQ(now.log.tasks[0].jobs.back().k, 1000U);
  EXPECT_FALSE(box.copy_to("/nonexistent/folder/x", "a stop"));
  box.remove();
  EXPECT_FALSE(std::filesystem::exists(file.path));
}

// The writer's process is killed at an instant of the machine's choosing.
TEST(BlackBox, SurvivesSigkillInTheMidstOfWriting) {
  for (int round = 0; round < 5; ++round) {
    TempFile file;
    int ready[2];
    ASSERT_EQ(::pipe(ready), 0);
    const pid_t child = ::fork();
    if (child == 0) {
      BlackBoxWriter box(file.path, header(), std::chrono::seconds{1}, 1 << 19);
      fill(box, 3);  // more than a lap
      (void)!::write(ready[1], "x", 1);
      for (std::uint64_t k = 3000;; ++k) box.add(job(0, k));
    }
    char c = 0;
    ASSERT_EQ(::read(ready[0], &c, 1), 1);
    ::usleep(static_cast<useconds_t>(500 + 311 * round));
    ::kill(child, SIGKILL);
    int status = 0;
    ::waitpid(child, &status, 0);
    ::close(ready[0]);
    ::close(ready[1]);
    ASSERT_TRUE(WIFSIGNALED(status));
    const auto b = rt::read_black_box(file.path);
    ASSERT_TRUE(b.has_value()) << b.error();
    EXPECT_EQ(b.value().stop, "");
    EXPECT_EQ(b.value().missing, 0U) << "only the newest record can be torn";
    const auto& jobs = b.value().log.tasks[0].jobs;
    ASSERT_GT(jobs.size(), 500U);
    for (std::size_t i = 0; i < jobs.size(); ++i)
      ASSERT_TRUE(same(jobs[i], job(0, jobs.front().k + i)));
  }
}

// What a damaged file gives: an error that names it, or records that were written, never others.
TEST(BlackBox, DamagedFilesGiveWhatIsLeft) {
  TempFile file;
  {
    BlackBoxWriter box(file.path, header(), std::chrono::seconds{1}, 1 << 18);
    fill(box, 4);
    box.note_stop("a fault");
  }
  const std::string whole = file.bytes();
  const auto good = rt::read_black_box(file.path).value();
  ASSERT_EQ(good.missing, 0U);
  const std::uint64_t seed = 77001;
  std::printf("seed %" PRIu64 "\n", seed);
  rt::Random random(seed, 0);
  const auto pick = [&](std::size_t n) { return static_cast<std::size_t>(random() % n); };
  const std::size_t kHeaderText = whole.find("\n\n");
  int errors = 0, damaged = 0;
  for (int round = 0; round < 600; ++round) {
    std::string bad = whole;
    const int kind = round % 3;
    if (kind == 0) {
      bad.resize(pick(whole.size()));
    } else if (kind == 1) {
      for (std::size_t i = 0, n = 1 + pick(20); i < n; ++i)
        bad[pick(round % 2 == 0 ? bad.size() : kHeaderText)] = static_cast<char>(random());
    } else {
      const std::size_t at = pick(bad.size() - 4096), n = 1 + pick(4096);
      for (std::size_t i = 0; i < n; ++i) bad[at + i] = static_cast<char>(random());
    }
    file.put(bad);
    const auto b = rt::read_black_box(file.path);
    if (!b.has_value()) {
      EXPECT_THAT(b.error(), HasSubstr(file.path));
      ++errors;
      continue;
    }
    damaged += b.value().records < good.records ? 1 : 0;
    EXPECT_LE(b.value().records, good.records);
    for (const auto& t : b.value().log.tasks) {
      for (const auto& j : t.jobs) ASSERT_TRUE(same(j, job(j.task, j.k))) << "round " << round;
    }
  }
  EXPECT_GT(errors, 20);
  EXPECT_GT(damaged, 100);
}

TEST(BlackBox, OtherFilesAreRefusedByName) {
  TempFile file;
  for (const std::string& text :
       {std::string(), std::string("teletact-run 1 8 8\n\n"),
        std::string("teletact-blackbox 1 1 1 0 64\n\n"), std::string("teletact-blackbox 1 x\n"),
        std::string(70000, 'x')}) {
    file.put(text);
    const auto b = rt::read_black_box(file.path);
    ASSERT_FALSE(b.has_value()) << text.substr(0, 40);
    EXPECT_THAT(b.error(), HasSubstr(file.path));
  }
  EXPECT_FALSE(rt::is_black_box(file.path));
  EXPECT_FALSE(rt::read_black_box("/nonexistent").has_value());
  EXPECT_THROW(BlackBoxWriter("/nonexistent/box", header(), Nanos{1}, 1 << 16), std::runtime_error);
}

}  // namespace
