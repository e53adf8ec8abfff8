// The real-time log: words and types, order over threads, drops, and nothing but stores on the way
// in.
#include "rt/audit/rt_log.hpp"

#include <gtest/gtest.h>
#include <spdlog/sinks/base_sink.h>
#include <spdlog/spdlog.h>

#include <chrono>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "rt/memory/section.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace {

using rt::LogLevel;

class Collect : public spdlog::sinks::base_sink<std::mutex> {
 public:
  std::vector<std::string> lines;
  std::vector<spdlog::level::level_enum> levels;

 protected:
  void sink_it_(const spdlog::details::log_msg& m) override {
    lines.emplace_back(m.payload.data(), m.payload.size());
    levels.push_back(m.level);
  }
  void flush_() override {}
};

class RtLogTest : public testing::Test {
 protected:
  rt::Startup startup_;
  rt::NonRealtime& nrt_ = startup_.token();
  std::shared_ptr<Collect> sink_ = std::make_shared<Collect>();
  std::shared_ptr<spdlog::logger> logger_ = [this] {
    auto l = std::make_shared<spdlog::logger>("test", sink_);
    l->set_level(spdlog::level::trace);
    return l;
  }();
  rt::LogSites sites_;
};

enum class Color : std::int8_t { kRed = -3 };

TEST_F(RtLogTest, WordsKeepTheirTypes) {
  const auto site = sites_.add<double, int, std::uint64_t, bool, float, Color>(
      nrt_, LogLevel::kWarning, "force {:.2f} N, {} steps, hash {:x}, {}, {}, {}");
  const auto bare = sites_.add<>(nrt_, LogLevel::kInfo, "brace {{}}");
  auto log = std::make_unique<rt::RtLog>();
  rt::LogDrain drain(nrt_, sites_, logger_);
  drain.attach(nrt_, "haptic", *log);
  EXPECT_TRUE(log->write(site, rt::time_from_ns(1'500'000'000), 12.345, -7, 0xffffffffffffffffULL,
                         true, 0.25F, Color::kRed));
  EXPECT_TRUE(log->write(bare, rt::time_from_ns(1'500'000'001)));
  EXPECT_EQ(drain.drain(), 2u);
  ASSERT_EQ(sink_->lines.size(), 2u);
  EXPECT_EQ(sink_->lines[0],
            "1.500000000 haptic: force 12.35 N, -7 steps, hash ffffffffffffffff, 1, 0.25, -3");
  EXPECT_EQ(sink_->lines[1], "1.500000001 haptic: brace {}");
  EXPECT_EQ(sink_->levels[0], spdlog::level::warn);
  EXPECT_EQ(sink_->levels[1], spdlog::level::info);
  EXPECT_EQ(drain.drain(), 0u);
  EXPECT_EQ(drain.records(), 2u);
}

TEST_F(RtLogTest, ASiteThatDoesNotFitItsWordsIsRefusedAtSetUp) {
  EXPECT_THROW((void)(sites_.add<double>(nrt_, LogLevel::kInfo, "{} and {}")),
               std::invalid_argument);
  EXPECT_THROW((void)(sites_.add<double, int>(nrt_, LogLevel::kInfo, "only {}")),
               std::invalid_argument);
  EXPECT_THROW((void)(sites_.add<double>(nrt_, LogLevel::kInfo, "{:x}")), std::invalid_argument);
  EXPECT_THROW((void)(sites_.add<int>(nrt_, LogLevel::kInfo, "{")), std::invalid_argument);
  EXPECT_THROW((void)(sites_.add<int>(nrt_, LogLevel::kInfo, "{:.2f}")), std::invalid_argument);
}

TEST_F(RtLogTest, AFullRingDropsTheNewestAndSaysSoOnce) {
  const auto site = sites_.add<std::uint64_t>(nrt_, LogLevel::kInfo, "n {}");
  auto log = std::make_unique<rt::RtLog>();
  rt::LogDrain drain(nrt_, sites_, logger_);
  drain.attach(nrt_, "fusion", *log);
  const std::uint64_t extra = 5;
  for (std::uint64_t i = 0; i < rt::RtLog::kCapacity + extra; ++i) {
    EXPECT_EQ(log->write(site, rt::time_from_ns(static_cast<std::int64_t>(i)), i),
              i < rt::RtLog::kCapacity);
  }
  EXPECT_EQ(drain.drain(), rt::RtLog::kCapacity);
  EXPECT_EQ(drain.dropped(), extra);
  EXPECT_EQ(sink_->lines.size(), rt::RtLog::kCapacity + 1);
  EXPECT_NE(sink_->lines.back().find("5 log records dropped"), std::string::npos);
  EXPECT_NE(sink_->lines[rt::RtLog::kCapacity - 1].find("n 1023"), std::string::npos);
  drain.drain();
  EXPECT_EQ(sink_->lines.size(), rt::RtLog::kCapacity + 1);
}

TEST_F(RtLogTest, OnePassIsOrderedByTimeOverThreads) {
  const auto site = sites_.add<int>(nrt_, LogLevel::kInfo, "{}");
  auto a = std::make_unique<rt::RtLog>(), b = std::make_unique<rt::RtLog>();
  rt::LogDrain drain(nrt_, sites_, logger_);
  drain.attach(nrt_, "a", *a);
  drain.attach(nrt_, "b", *b);
  for (int i = 0; i < 10; ++i) {
    ((i % 3 == 0) ? a : b)->write(site, rt::time_from_ns(i), i);
  }
  drain.drain();
  ASSERT_EQ(sink_->lines.size(), 10u);
  for (int i = 0; i < 10; ++i) {
    EXPECT_NE(sink_->lines[static_cast<std::size_t>(i)].find(": " + std::to_string(i)),
              std::string::npos);
  }
}

TEST_F(RtLogTest, AnUnknownSiteIsNamed) {
  EXPECT_EQ(sites_.text({0, 42, 0, {}}), "record of unknown site 42");
}

TEST_F(RtLogTest, TwoThreadsAndTheDrainThreadLoseNothingSilently) {
  const auto site = sites_.add<int, double>(nrt_, LogLevel::kInfo, "{} {}");
  std::vector<std::unique_ptr<rt::RtLog>> logs;
  rt::LogDrain drain(nrt_, sites_, logger_);
  for (int i = 0; i < 2; ++i) {
    logs.push_back(std::make_unique<rt::RtLog>());
    drain.attach(nrt_, "t" + std::to_string(i), *logs.back());
  }
  drain.start(nrt_, std::chrono::milliseconds(1));
  constexpr int kEach = 20'000;
  std::vector<std::thread> threads;
  std::array<std::uint64_t, 2> written{};
  for (std::size_t i = 0; i < 2; ++i) {
    threads.emplace_back([&, i] {
      for (int n = 0; n < kEach; ++n) {
        written[i] += logs[i]->write(site, rt::time_from_ns(n), n, 0.5 * n) ? 1U : 0U;
        if (n % 256 == 0) std::this_thread::sleep_for(std::chrono::microseconds(200));
      }
    });
  }
  for (auto& t : threads) t.join();
  drain.stop();
  EXPECT_EQ(drain.records(), written[0] + written[1]);
  EXPECT_EQ(drain.records() + drain.dropped(), 2U * kEach);
  EXPECT_GT(drain.records(), 0u);
}

TEST_F(RtLogTest, WritingIsOnlyStores) {
  if (!rt_guard::linked()) GTEST_SKIP() << "the guard is not linked in this build";
  const auto site = sites_.add<double, int>(nrt_, LogLevel::kInfo, "{} {}");
  auto log = std::make_unique<rt::RtLog>();
  rt_guard::reset();
  {
    rt::Section s;
    for (int i = 0; i < 2000; ++i) log->write(site, rt::time_from_ns(i), 0.1, i);  // also when full
  }
  EXPECT_EQ(rt_guard::counts().total(), 0u);
  EXPECT_EQ(log->dropped(), 2000 - rt::RtLog::kCapacity);
}

}  // namespace
