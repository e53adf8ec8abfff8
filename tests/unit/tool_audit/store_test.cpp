// The audit of a store, whole and in pieces, beside that of the single file with the same records.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <stdexcept>

#include "rt/audit/run_file.hpp"
#include "rt/random.hpp"
#include "rt/store/run_store.hpp"
#include "tools/teletact/commands.hpp"

namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

constexpr std::int64_t kMs = 1000000, kEpoch = 7000000000;

rt::RunLog one_task() {
  rt::RunLog log;
  rt::TaskLog t;
  t.spec.name = "haptic";
  t.spec.rate = {1000, 1};
  t.spec.deadline = rt::Nanos{kMs};
  t.spec.budget = rt::Nanos{kMs / 2};
  log.tasks = {t};
  log.epoch_ns = kEpoch;
  return log;
}

class StoreAudit : public testing::Test {
 protected:
  void SetUp() override {
    fs::remove_all(folder_);
    fs::create_directories(folder_);
    rt::RunFileWriter file(folder_ + "/a.run", one_task());
    rt::StoreOptions options;
    options.segment_s = 1;
    rt::RunStore store(folder_ + "/b.run", one_task(), options);
    rt::Random random(3);
    for (std::uint64_t k = 0; k < 6000; ++k) {
      rt::JobRecord r;
      r.k = k;
      r.release_ns = kEpoch + static_cast<std::int64_t>(k) * kMs;
      r.deadline_ns = r.release_ns + kMs;
      r.start_ns = r.release_ns + static_cast<std::int64_t>(random.uniform() * 1e5);
      // Every 500th in the first three seconds overruns.
      r.cpu_ns = k < 3000 && k % 500 == 7 ? 3 * kMs / 2 : static_cast<std::int64_t>(3e5);
      r.end_ns = r.start_ns + r.cpu_ns;
      r.voluntary = 1;
      file.add(r);
      store.add(r);
    }
    store.finish({{0, {6000, 6, 0, 0, 0, 0}}}, 0);
    file.finish({{0, {6000, 6, 0, 0, 0, 0}}}, 0);
  }
  void TearDown() override { fs::remove_all(folder_); }

  // Of the text the tables alone.
  static std::string audit(std::vector<std::string> words) {
    words.insert(words.begin(), "audit");
    std::vector<char*> argv;
    for (auto& w : words) argv.push_back(w.data());
    testing::internal::CaptureStdout();
    (void)teletact::cmd_audit(static_cast<int>(argv.size()), argv.data());
    std::fflush(stdout);
    return testing::internal::GetCapturedStdout();
  }
  void thin() const {
    for (const auto& e : fs::directory_iterator(folder_ + "/b.run")) {
      if (e.path().filename().string().rfind("whole-", 0) == 0) fs::remove(e.path());
    }
  }
  std::string folder_ =
      (fs::temp_directory_path() / ("teletact_store_audit_" + std::to_string(::getpid()))).string();
};

TEST_F(StoreAudit, OfWholeRecordsIsThatOfTheFile) {
  EXPECT_EQ(audit({folder_ + "/b.run"}), audit({folder_ + "/a.run"}));
  const std::vector<std::string> piece{"--from", "1.5", "--to", "4"};
  auto of = [&](const char* name) {
    std::vector<std::string> words{folder_ + name};
    words.insert(words.end(), piece.begin(), piece.end());
    return audit(words);
  };
  EXPECT_EQ(of("/b.run"), of("/a.run"));
  EXPECT_THAT(of("/b.run"), HasSubstr("haptic                 2500"));
}

TEST_F(StoreAudit, OfPartsTellsItselfAndListsEvents) {
  thin();
  const std::string events = folder_ + "/events.csv";
  const std::string text = audit({folder_ + "/b.run", "--events", events});
  EXPECT_THAT(text, HasSubstr("haptic                 6000"));
  EXPECT_THAT(text, HasSubstr("6 misses of its own making"));
  EXPECT_THAT(text, HasSubstr("JOB RECORDS: 6000 jobs from 0.0 to 6.0 s are counts"));
  std::ifstream in(events);
  const std::string lines{std::istreambuf_iterator<char>(in), {}};
  EXPECT_EQ(std::count(lines.begin(), lines.end(), '\n'), 7) << lines;
  EXPECT_THAT(lines, HasSubstr("haptic,2507,"));
  EXPECT_THAT(audit({folder_ + "/b.run", "--from", "3.2"}),
              HasSubstr("haptic                 3000"));
}

TEST_F(StoreAudit, BadPiecesAreRefused) {
  EXPECT_THROW((void)audit({folder_ + "/b.run", "--from", "3", "--to", "3"}), std::runtime_error);
  (void)testing::internal::GetCapturedStdout();
}

}  // namespace
