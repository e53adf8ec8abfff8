// Every reader of outside files for a few seconds; `teletact bench fuzz` does it for longer. And
// the harness itself: it must see a reader that is wrong.
#include <gtest/gtest.h>

#include <algorithm>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <iostream>
#include <stdexcept>
#include <string>
#include <vector>

#include "tests/support/whole.hpp"
#include "tools/measure/fuzz_readers.hpp"

namespace {

namespace fs = std::filesystem;
using teletact::bench_fuzz;
using teletact::FuzzOptions;
using teletact::FuzzReader;

#if defined(__SANITIZE_ADDRESS__)
constexpr std::uint64_t kLimit_MiB = 0;
#else
constexpr std::uint64_t kLimit_MiB = 4096;
#endif

class FuzzReadersTest : public ::testing::Test {
 protected:
  void SetUp() override {
    std::string name = (fs::temp_directory_path() / "teletact_fuzz_test_XXXXXX").string();
    ASSERT_NE(mkdtemp(name.data()), nullptr);
    options_.keep = name;
    options_.limit_MiB = kLimit_MiB;
  }
  void TearDown() override {
    if (!HasFailure()) fs::remove_all(options_.keep);
  }
  FuzzOptions options_;
};

// `names`: of these alone. TELETACT_FUZZ_SECONDS asks for another time in all, TELETACT_FUZZ_SEED
// for other damage.
void expect_no_fault(FuzzOptions options, const std::vector<std::string>& names, double all_s) {
  const teletact::FuzzReaders known;
  std::vector<FuzzReader> readers;
  for (const auto& r : known.all()) {
    if (names.empty() || std::find(names.begin(), names.end(), r.name) != names.end())
      readers.push_back(r);
  }
  ASSERT_GE(readers.size(), std::max<std::size_t>(1, names.size()));
  const char* asked = std::getenv("TELETACT_FUZZ_SECONDS");
  if (asked != nullptr) all_s = std::atof(asked);
  options.seconds = all_s / static_cast<double>(readers.size());
  const char* seed = std::getenv("TELETACT_FUZZ_SEED");
  if (seed != nullptr) options.seed = std::strtoull(seed, nullptr, 10);
  const auto result = bench_fuzz(std::cout, readers, options);
  result.print(std::cout);
  EXPECT_EQ(result.faults(), 0) << "inputs in " << options.keep;
  for (const auto& row : result.rows) {
    EXPECT_GT(row.inputs, 100U) << row.reader;
    EXPECT_LT(row.accepted, row.inputs) << row.reader << " refuses nothing";
  }
}

// Seconds of CPU, of all readers together.
const double kSeconds = tests::whole() ? 30 : 10;

TEST_F(FuzzReadersTest, EndWithAResultOrOneLine) { expect_no_fault(options_, {}, kSeconds); }

// What a page on the net may send reaches these two, one behind the other: as long for them alone.
TEST_F(FuzzReadersTest, IntentsEndWithAResultOrOneLine) {
  expect_no_fault(options_, {"console_intent", "desk_intent"}, kSeconds);
}

TEST_F(FuzzReadersTest, TheHarnessSeesFaults) {
  const auto fault_of = [&](std::function<rt::Result<bool>(const std::string&)> bad) {
    // Right for the good file, wrong for one that is longer.
    FuzzReader reader{"wrong",
                      {"0123456789"},
                      [&](const std::string& b) -> rt::Result<bool> {
                        return b.size() <= 10 ? rt::Result<bool>(true) : bad(b);
                      },
                      {},
                      false};
    options_.seconds = 2;
    options_.limit_cpu_s = 1;
    const auto result = bench_fuzz(std::cout, {reader}, options_);
    EXPECT_EQ(result.faults(), 1);
    return result.rows.at(0).fault;
  };
  EXPECT_NE(fault_of([](const std::string&) -> rt::Result<bool> {
              std::raise(SIGKILL);
              return true;
            }).find("signal"),
            std::string::npos);
  EXPECT_NE(fault_of([](const std::string&) -> rt::Result<bool> {
              throw std::runtime_error("oh");
            }).find("exception: oh"),
            std::string::npos);
  EXPECT_NE(fault_of([](const std::string&) -> rt::Result<bool> {
              return rt::Error{"two\nlines"};
            }).find("no line"),
            std::string::npos);
  EXPECT_NE(fault_of([](const std::string&) -> rt::Result<bool> {
              for (;;) asm volatile("");
            }).find("does not end"),
            std::string::npos);
  EXPECT_FALSE(fs::is_empty(options_.keep)) << "the inputs are kept";
}

TEST_F(FuzzReadersTest, AnInputIsAFunctionOfItsNumber) {
  const teletact::FuzzReaders readers;
  for (const FuzzReader& r : readers.all()) {
    int same = 0;
    for (std::uint64_t n = 0; n < 50; ++n) {
      EXPECT_EQ(teletact::fuzz_input(r, 3, n), teletact::fuzz_input(r, 3, n));
      same += teletact::fuzz_input(r, 3, n) == teletact::fuzz_input(r, 4, n) ? 1 : 0;
    }
    EXPECT_LT(same, 10) << r.name;
  }
}

}  // namespace
