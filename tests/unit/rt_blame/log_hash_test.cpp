#include "rt/audit/log_hash.hpp"

#include <gtest/gtest.h>

#include <functional>
#include <vector>

#include "rt/random.hpp"

namespace {

using rt::JobRecord;
using rt::LogHasher;

std::vector<JobRecord> some_records() {
  rt::Random r(7);
  std::vector<JobRecord> out;
  for (std::uint64_t k = 0; k < 40; ++k) {
    JobRecord j;
    j.k = k;
    j.task = static_cast<std::uint16_t>(k % 3);
    j.release_ns = static_cast<std::int64_t>(k) * 1000000;
    j.start_ns = j.release_ns + r.integer(0, 1000);
    j.end_ns = j.start_ns + r.integer(0, 100000);
    j.deadline_ns = j.release_ns + 1000000;
    j.cpu_ns = j.end_ns - j.start_ns;
    j.output_hash = r();
    for (auto& s : j.input_seq) s = r() % 100;
    out.push_back(j);
  }
  return out;
}

LogHasher hash(const std::vector<JobRecord>& records) {
  LogHasher h;
  for (const auto& r : records) h.add(r);
  return h;
}

TEST(LogHash, EqualRunsAreEqual) {
  EXPECT_EQ(hash(some_records()).sched(), hash(some_records()).sched());
  EXPECT_EQ(hash(some_records()).log(), hash(some_records()).log());
  EXPECT_NE(hash(some_records()).log(), hash(some_records()).sched());
}

TEST(LogHash, AnyBitOfAnOutputChangesTheLogOnly) {
  const auto base = hash(some_records());
  for (std::size_t at : {0U, 20U, 39U}) {
    for (unsigned bit = 0; bit < 64; ++bit) {
      auto records = some_records();
      records[at].output_hash ^= 1ULL << bit;
      EXPECT_EQ(hash(records).sched(), base.sched());
      EXPECT_NE(hash(records).log(), base.log()) << at << ' ' << bit;
    }
  }
}

TEST(LogHash, OneNanosecondChangesBoth) {
  const auto base = hash(some_records());
  const std::vector<std::function<void(JobRecord&)>> changes{[](JobRecord& j) { ++j.release_ns; },
                                                             [](JobRecord& j) { ++j.start_ns; },
                                                             [](JobRecord& j) { ++j.end_ns; },
                                                             [](JobRecord& j) { ++j.cpu_ns; },
                                                             [](JobRecord& j) { ++j.k; },
                                                             [](JobRecord& j) { ++j.skipped; },
                                                             [](JobRecord& j) { ++j.level; },
                                                             [](JobRecord& j) { ++j.core; },
                                                             [](JobRecord& j) { ++j.task; },
                                                             [](JobRecord& j) { j.outcome = rt::Outcome::kAborted; }};
  for (std::size_t c = 0; c < changes.size(); ++c) {
    for (std::size_t at : {0U, 20U, 39U}) {
      auto records = some_records();
      changes[c](records[at]);
      EXPECT_NE(hash(records).sched(), base.sched()) << c << ' ' << at;
      EXPECT_NE(hash(records).log(), base.log()) << c << ' ' << at;
    }
  }
}

TEST(LogHash, InputsFaultsAndLinkBytesChangeTheLogOnly) {
  const auto base = hash(some_records());
  for (std::size_t i = 0; i < JobRecord::kMaxInputs; ++i) {
    auto records = some_records();
    ++records[5].input_seq[i];
    EXPECT_EQ(hash(records).sched(), base.sched());
    EXPECT_NE(hash(records).log(), base.log()) << i;
  }
  auto records = some_records();
  records[5].severity = rt::Severity::kDegraded;
  EXPECT_NE(hash(records).log(), base.log());
  records = some_records();
  records[5].fault = 1;
  EXPECT_NE(hash(records).log(), base.log());
  for (const std::size_t size : {1U, 7U, 8U, 9U, 64U}) {
    std::vector<unsigned char> bytes(size, 3);
    auto a = hash(some_records()), b = hash(some_records());
    a.add_bytes(bytes.data(), size);
    bytes.back() ^= 0x80;
    b.add_bytes(bytes.data(), size);
    EXPECT_EQ(a.sched(), b.sched());
    EXPECT_NE(a.log(), b.log()) << size;
    EXPECT_NE(a.log(), base.log());
  }
}

TEST(LogHash, WhatTheMachineMeasuredDoesNotCount) {
  const auto base = hash(some_records());
  auto records = some_records();
  records[3].run_delay_ns = 5;
  records[3].involuntary = 7;
  records[3].minor_faults = 9;
  EXPECT_EQ(hash(records).sched(), base.sched());
  EXPECT_EQ(hash(records).log(), base.log());
}

TEST(LogHash, OrderMatters) {
  const auto base = hash(some_records());
  for (std::size_t at = 0; at + 1 < 40; ++at) {
    auto records = some_records();
    std::swap(records[at], records[at + 1]);
    EXPECT_NE(hash(records).sched(), base.sched()) << at;
    EXPECT_NE(hash(records).log(), base.log()) << at;
  }
  auto records = some_records();
  records.pop_back();
  EXPECT_NE(hash(records).sched(), base.sched());
}

}  // namespace
