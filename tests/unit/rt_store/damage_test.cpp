// Kills, damage, full disks: what is left of a store, and that it is told.
#include <gmock/gmock.h>

#include <fstream>

#include "rt/audit/blame.hpp"
#include "rt/audit/task_past.hpp"
#include "rt/store/read_store.hpp"
#include "tests/unit/rt_store/support.hpp"

namespace {

using store_test::Folder;
using store_test::MadeUpRun;
using testing::HasSubstr;

void put(const std::string& path, std::span<const std::uint8_t> bytes) {
  std::ofstream out(path, std::ios::binary | std::ios::trunc);
  out.write(reinterpret_cast<const char*>(bytes.data()),
            static_cast<std::streamsize>(bytes.size()));
}

std::uint64_t jobs_of(const rt::StoreLog& s) { return s.whole_records + s.part_records; }

rt::StoreOptions second_by_second() {
  rt::StoreOptions o;
  o.segment_s = 1;
  o.block_bytes = 4096;
  return o;
}

// Five whole segments and the start of a sixth; no end.
struct Killed {
  Killed() : run(11), store(folder.path(), run.all(), second_by_second()) {
    run.run(store, 5.4);
    store.flush();
  }
  Folder folder;
  MadeUpRun run;
  rt::RunStore store;
};

TEST(StoreDamage, AfterAKillAllThatWasFlushedIsThere) {
  const Killed k;
  const auto got = rt::read_store(k.folder.path());
  ASSERT_TRUE(got) << got.error();
  EXPECT_EQ(got.value().whole_records, k.run.jobs());
  EXPECT_TRUE(got.value().log.told.empty());
  for (const auto& t : got.value().log.tasks) EXPECT_FALSE(t.totals.has_value());
}

TEST(StoreDamage, ATornLastSegmentIsReadUpToTheTear) {
  const Killed k;
  const auto wholes = k.folder.names("whole-");
  ASSERT_EQ(wholes.size(), 6U);
  const std::string last = k.folder.path() + "/" + wholes.back();
  const auto bytes = rt::read_bytes(last);
  std::uint64_t before = 0, steps = 0;
  for (std::size_t n = 0; n <= bytes.size(); n += 509) {
    put(last, std::span(bytes).first(n));
    const auto got = rt::read_store(k.folder.path());
    ASSERT_TRUE(got) << got.error();
    EXPECT_GE(got.value().whole_records, before) << n;
    EXPECT_TRUE(got.value().log.told.empty()) << "a kill is no damage";
    steps += got.value().whole_records > before ? 1 : 0;
    before = got.value().whole_records;
    // What is there is a beginning of what was: in order, none missing.
    for (std::size_t i = 0; i < 3; ++i) {
      const auto& have = got.value().log.tasks[i].jobs;
      for (std::size_t j = 0; j < have.size(); ++j)
        ASSERT_EQ(have[j].k, k.run.all().tasks[i].jobs[j].k);
    }
  }
  EXPECT_GE(steps, 10U) << "block by block";
}

TEST(StoreDamage, ADamagedSegmentIsReplacedByItsPartOrReadInPart) {
  const Killed k;
  const std::string path = k.folder.path() + "/whole-00000002";
  auto bytes = rt::read_bytes(path);
  bytes[bytes.size() / 2] ^= 0x10U;
  put(path, bytes);
  auto got = rt::read_store(k.folder.path());
  ASSERT_TRUE(got) << got.error();
  EXPECT_EQ(jobs_of(got.value()), k.run.jobs()) << "every job is counted";
  ASSERT_FALSE(got.value().log.told.empty());
  EXPECT_THAT(got.value().log.told[0], HasSubstr("segment 2 is damaged: its counts"));
  std::filesystem::remove(k.folder.path() + "/part-00000002-00000002");
  got = rt::read_store(k.folder.path());
  ASSERT_TRUE(got);
  EXPECT_LT(jobs_of(got.value()), k.run.jobs());
  EXPECT_GT(jobs_of(got.value()), k.run.jobs() * 8 / 10);
  EXPECT_THAT(got.value().log.told[0], HasSubstr("segment 2 is damaged: read in part"));
}

TEST(StoreDamage, ADamagedPartIsLeftOutAndTold) {
  const Killed k;
  std::filesystem::remove(k.folder.path() + "/whole-00000001");
  const std::string path = k.folder.path() + "/part-00000001-00000001";
  const auto good = rt::read_bytes(path);
  rt::Random random(12);
  for (int round = 0; round < 60; ++round) {
    auto bytes = good;
    bytes[static_cast<std::size_t>(random.uniform() * static_cast<double>(bytes.size()))] ^=
        static_cast<std::uint8_t>(1U << static_cast<unsigned>(random.uniform() * 8));
    put(path, bytes);
    const auto got = rt::read_store(k.folder.path());
    ASSERT_TRUE(got) << got.error();
    EXPECT_EQ(got.value().part_records, 0U);
    ASSERT_FALSE(got.value().log.told.empty()) << "seed 12, round " << round;
    EXPECT_THAT(got.value().log.told[0], HasSubstr("left out"));
  }
  put(path, good);
  EXPECT_EQ(jobs_of(rt::read_store(k.folder.path()).value()), k.run.jobs());
}

TEST(StoreDamage, PartsOfAMergeThatWasKilledCountOnce) {
  const Folder folder;
  MadeUpRun run(13);
  rt::RunStore store(folder.path(), run.all(), second_by_second());
  run.run(store, 8);
  store.finish({}, 0);
  for (const auto& name : folder.names("whole-"))
    std::filesystem::remove(folder.path() + "/" + name);
  const auto want = jobs_of(rt::read_store(folder.path()).value());
  ASSERT_EQ(want, run.jobs());
  // The merged one is there, the old ones are not gone yet.
  rt::Part sum = rt::decode_part(rt::read_bytes(folder.path() + "/part-00000001-00000001")).value();
  for (const char* name : {"/part-00000002-00000002", "/part-00000003-00000003"})
    sum.merge(rt::decode_part(rt::read_bytes(folder.path() + name)).value());
  const std::vector<std::uint8_t> merged = rt::encode_part(sum);
  put(folder.path() + "/part-00000001-00000003", merged);
  put(folder.path() + "/part-00000005-00000005.tmp", std::span(merged).first(100));
  EXPECT_EQ(jobs_of(rt::read_store(folder.path()).value()), want);
  std::filesystem::remove(folder.path() + "/part-00000002-00000002");
  EXPECT_EQ(jobs_of(rt::read_store(folder.path()).value()), want);
}

TEST(StoreDamage, BadHeadersAreRefusedWithOneMessage) {
  const Killed k;
  const std::string path = k.folder.path() + "/header";
  const auto good = rt::read_bytes(path);
  for (std::size_t n = 0; n < good.size(); n += 7) {
    put(path, std::span(good).first(n));
    const auto got = rt::read_store(k.folder.path());
    ASSERT_FALSE(got) << n;
    EXPECT_THAT(got.error(), HasSubstr("header"));
    auto bytes = good;
    bytes[n] ^= 0x01U;
    put(path, bytes);
    EXPECT_FALSE(rt::read_store(k.folder.path())) << n;
  }
  std::filesystem::remove(path);
  EXPECT_FALSE(rt::is_store(k.folder.path()));
  EXPECT_THAT(rt::read_run(k.folder.path()).error(), HasSubstr("can not be read"));
  EXPECT_THROW(rt::RunStore("/proc/no/such", k.run.all()), std::runtime_error);
  rt::StoreOptions small;
  small.cap_bytes = 1000;
  EXPECT_THROW(rt::RunStore(k.folder.path(), k.run.all(), small), std::runtime_error);
}

TEST(StoreDamage, AFullDiskThinsHarderAndCountsStayExact) {
  const Folder folder;
  MadeUpRun run(14);
  auto disk = std::make_unique<store_test::SmallDisk>(folder.path(), 6U << 20U);
  store_test::SmallDisk& small = *disk;
  rt::RunStore store(std::move(disk), run.all(), second_by_second());
  run.run(store, 15);
  EXPECT_EQ(store.problem(), "") << "room enough until here";
  run.run(store, 40);
  EXPECT_THAT(store.problem(), HasSubstr("thinned harder, the run goes on"));
  EXPECT_LE(small.used(), 6U << 20U);
  const auto amidst = rt::read_store(folder.path());
  ASSERT_TRUE(amidst) << amidst.error();
  EXPECT_GT(amidst.value().whole_records, 0U) << "it gave up old records for new ones";
  small.grow(1U << 20U);  // another program takes even the room that it had
  run.run(store, 20);
  small.grow(64U << 20U);
  run.run(store, 10);
  store.finish({}, 0);
  const auto got = rt::read_store(folder.path());
  ASSERT_TRUE(got) << got.error();
  EXPECT_GT(store.use().unwritten, 0U);
  EXPECT_EQ(jobs_of(got.value()), run.jobs()) << "each is whole or counted";
  for (std::size_t i = 0; i < 3; ++i) {
    const auto want = rt::blame(run.all(), run.all().tasks[i]);
    const auto have = rt::blame(got.value().log, got.value().log.tasks[i]);
    EXPECT_EQ(have.miss_total, want.miss_total);
    EXPECT_EQ(have.completed, want.completed);
  }
  EXPECT_THAT(got.value().log.told.front(), HasSubstr("the disk was full"));
}

TEST(StoreDamage, ADiskThatRefusesEverythingStopsNobody) {
  const Folder folder;
  MadeUpRun run(15);
  auto disk = std::make_unique<store_test::SmallDisk>(folder.path(), 0);
  rt::RunStore store(std::move(disk), run.all(), second_by_second());
  run.run(store, 10);
  store.finish({}, 0);
  EXPECT_NE(store.problem(), "");
  EXPECT_EQ(store.use().unwritten, run.jobs());
}

TEST(StorePiece, OfWholeRecordsIsTheirCrop) {
  const Folder folder;
  MadeUpRun run(16);
  rt::RunStore store(folder.path(), run.all(), second_by_second());
  run.run(store, 9);
  store.finish({}, 0);
  const auto got = rt::read_store(folder.path(), {2.5, 6.25});
  ASSERT_TRUE(got) << got.error();
  for (std::size_t i = 0; i < 3; ++i) {
    std::vector<std::uint64_t> want, have;
    for (const auto& r : run.all().tasks[i].jobs) {
      const double s = 1e-9 * static_cast<double>(r.release_ns - store_test::kEpoch);
      if (s >= 2.5 && s < 6.25) want.push_back(r.k);
    }
    for (const auto& r : got.value().log.tasks[i].jobs) have.push_back(r.k);
    EXPECT_EQ(have, want);
    EXPECT_FALSE(got.value().log.tasks[i].past);
    EXPECT_FALSE(got.value().log.tasks[i].totals) << "they are of the whole run";
  }
}

TEST(StorePiece, OfPartsIsWidenedToTheirEdgesAndTold) {
  const Folder folder;
  MadeUpRun run(17, true);
  rt::RunStore store(folder.path(), run.all(), second_by_second());
  run.run(store, 9);
  store.finish({}, 0);
  for (const auto& name : folder.names("whole-"))
    std::filesystem::remove(folder.path() + "/" + name);
  const auto got = rt::read_store(folder.path(), {2.5, 6.25});
  ASSERT_TRUE(got) << got.error();
  EXPECT_EQ(got.value().log.tasks[0].past->jobs, 5000U);  // seconds 2, 3, 4, 5, 6
  ASSERT_FALSE(got.value().log.told.empty());
  EXPECT_THAT(got.value().log.told[0], HasSubstr("from 2.0 to 7.0 s are counts and histograms"));
  // The newest three seconds whole, the rest by its parts.
  const Folder other("b");
  MadeUpRun again(17, true);
  rt::RunStore second(other.path(), again.all(), second_by_second());
  again.run(second, 9);
  second.finish({}, 0);
  rt::StorePiece newest;
  newest.whole_s = 3;
  const auto log = rt::read_store(other.path(), newest).value().log;
  EXPECT_EQ(log.tasks[0].jobs.size() + log.tasks[0].past->jobs, 9000U);
  EXPECT_GE(log.tasks[0].jobs.size(), 3000U);
  EXPECT_LE(log.tasks[0].jobs.size(), 4000U);
}

TEST(StoreFuzz, DamagedFilesNeverCrashAndNothingIsMadeUp) {
  const Killed k;
  std::vector<std::string> names = k.folder.names("whole-");
  for (const auto& n : k.folder.names("part-")) names.push_back(n);
  names.emplace_back("header");
  rt::Random random(18);
  for (int round = 0; round < 80; ++round) {
    const std::string path =
        k.folder.path() + "/" +
        names[static_cast<std::size_t>(random.uniform() * static_cast<double>(names.size()))];
    const auto good = rt::read_bytes(path);
    auto bytes = good;
    for (int i = 0; i < 3; ++i) {
      const auto at =
          static_cast<std::size_t>(random.uniform() * static_cast<double>(bytes.size()));
      bytes[at] = static_cast<std::uint8_t>(random.uniform() * 256);
    }
    if (random.uniform() < 0.3) bytes.resize(bytes.size() / 2);
    put(path, bytes);
    const auto got = rt::read_store(k.folder.path());
    const std::uint64_t jobs = got ? jobs_of(got.value()) : 0;
    EXPECT_LE(jobs, k.run.jobs()) << "seed 18, round " << round;
    put(path, good);
  }
  EXPECT_EQ(jobs_of(rt::read_store(k.folder.path()).value()), k.run.jobs());
}

// Behind a CRC that fits: the payload's own lengths are all that protects.
TEST(StoreFuzz, ADamagedPayloadWithARightCrcDoesNoHarm) {
  const Killed k;
  const auto good = rt::read_bytes(k.folder.path() + "/part-00000000-00000000");
  constexpr std::size_t kHead = 40;
  rt::Random random(19);
  int refused = 0;
  for (int round = 0; round < 3000; ++round) {
    auto bytes = good;
    const int changes = 1 + static_cast<int>(random.uniform() * 4);
    for (int i = 0; i < changes; ++i) {
      const auto room = static_cast<double>(bytes.size() - kHead - 4);
      bytes[kHead + 4 + static_cast<std::size_t>(random.uniform() * room)] =
          static_cast<std::uint8_t>(random.uniform() * 256);
    }
    const std::uint32_t crc =
        rt::store_crc(std::span(bytes).first(kHead), std::span(bytes).subspan(kHead + 4));
    for (unsigned i = 0; i < 4; ++i) bytes[kHead + i] = static_cast<std::uint8_t>(crc >> (8 * i));
    const auto part = rt::decode_part(bytes);
    refused += part ? 0 : 1;
    if (part) (void)rt::encode_part(part.value());
  }
  EXPECT_GT(refused, 100);
}

TEST(StorePart, AsManyLevelsAsATaskMayHaveComeBackAndOneMoreIsRefused) {
  for (const std::size_t extra : {0U, 1U}) {
    rt::Part part;
    rt::TaskPast past;
    past.levels.resize(rt::TaskPast::kMaxLevels + extra);
    for (std::size_t i = 0; i < past.levels.size(); ++i) {
      past.levels[i].jobs = i + 1;
      past.levels[i].cpu.record(static_cast<std::int64_t>(1000 * (i + 1)));
    }
    part.tasks.emplace(std::uint16_t{7}, past);
    const auto bytes = rt::encode_part(part);
    const auto back = rt::decode_part(bytes);
    ASSERT_EQ(static_cast<bool>(back), extra == 0) << extra;
    if (!back) continue;
    const auto& levels = back.value().tasks.at(7).levels;
    ASSERT_EQ(levels.size(), rt::TaskPast::kMaxLevels);
    EXPECT_EQ(levels.back().jobs, rt::TaskPast::kMaxLevels);
    EXPECT_EQ(rt::encode_part(back.value()), bytes);
  }
}

}  // namespace
