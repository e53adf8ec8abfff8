// Histogram against sorted samples: edges, error bound, quantiles, merging.
#include "rt/audit/histogram.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <vector>

#include "rt/memory/section.hpp"
#include "rt/random.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace {

using rt::Histogram;

TEST(Histogram, BucketsTileTheRange) {
  EXPECT_EQ(Histogram::lower_edge(0), 0);
  EXPECT_EQ(Histogram::lower_edge(Histogram::kBuckets), Histogram::kLimit);
  for (std::size_t i = 0; i < Histogram::kBuckets; ++i) {
    const auto lo = Histogram::lower_edge(i), hi = Histogram::lower_edge(i + 1);
    ASSERT_LT(lo, hi);
    ASSERT_EQ(Histogram::bucket_of(lo), i);
    ASSERT_EQ(Histogram::bucket_of(hi - 1), i);
    // Width over the smallest value in it: the relative error of reading the upper edge.
    ASSERT_LE((hi - 1 - lo) * 64, lo);
  }
}

TEST(Histogram, EmptyIsZero) {
  const auto h = std::make_unique<Histogram>();
  EXPECT_EQ(h->quantile(0.5), 0);
  EXPECT_EQ(h->min(), 0);
  EXPECT_EQ(h->max(), 0);
  EXPECT_EQ(h->mean(), 0.0);
  h->for_each([](auto, auto, auto) { FAIL(); });
}

TEST(Histogram, OneValueIsEveryQuantile) {
  for (const std::int64_t v : {0LL, 1LL, 63LL, 64LL, 127LL, 128LL, 12345LL, (1LL << 40) - 1}) {
    Histogram h;
    h.record(v);
    for (const double q : {0.0, 0.5, 0.999, 1.0}) EXPECT_EQ(h.quantile(q), v);
  }
}

TEST(Histogram, ValuesOutsideTheRangeKeepMinimumAndMaximum) {
  Histogram h;
  h.record(-1000);
  h.record(std::int64_t{1} << 50);
  h.record(std::numeric_limits<std::int64_t>::max());
  EXPECT_EQ(h.count(), 3u);
  EXPECT_EQ(h.min(), -1000);
  EXPECT_EQ(h.max(), std::numeric_limits<std::int64_t>::max());
  EXPECT_EQ(h.quantile(1.0), h.max());
  std::uint64_t listed = 0;
  h.for_each([&](std::int64_t, std::int64_t, std::uint64_t n) { listed += n; });
  EXPECT_EQ(listed, 3u);
  Histogram n;
  n.record(std::numeric_limits<std::int64_t>::min());
  EXPECT_EQ(n.quantile(0.0), n.min());
}

// Quantiles are never below the true one and at most 1/64 above, for several shapes.
TEST(Histogram, QuantilesAgainstSortedSamples) {
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    SCOPED_TRACE(testing::Message() << "seed " << seed);
    rt::Random random(seed);
    Histogram h;
    std::vector<std::int64_t> all;
    const int count = seed < 4 ? 50'000 : 17;
    for (int i = 0; i < count; ++i) {
      const double shape = static_cast<double>(seed % 3);
      const auto v = static_cast<std::int64_t>(
          shape == 0   ? random.uniform(0, 5000)                      // flat
          : shape == 1 ? std::exp(random.uniform(0, 27.0))            // all decades
                       : std::abs(15'000 + 4000 * random.normal()));  // a wake-up latency
      h.record(rt::Nanos{v});
      all.push_back(v);
    }
    std::sort(all.begin(), all.end());
    EXPECT_EQ(h.min(), all.front());
    EXPECT_EQ(h.max(), all.back());
    double sum = 0;
    for (const auto v : all) sum += static_cast<double>(v);
    EXPECT_NEAR(h.mean(), sum / static_cast<double>(all.size()), 1e-9 * sum);
    for (std::size_t thousandths = 0; thousandths <= 1000; ++thousandths) {
      const double q = static_cast<double>(thousandths) / 1000;
      const std::size_t rank = std::max<std::size_t>(1, (thousandths * all.size() + 999) / 1000);
      const std::int64_t truth = all[rank - 1];
      const std::int64_t got = h.quantile(q);
      ASSERT_GE(got, truth) << q;
      ASSERT_LE(static_cast<double>(got - truth), static_cast<double>(truth) / 64.0) << q;
    }
    for (const std::size_t bucket : {10UL, 130UL, 900UL, 1500UL}) {
      const std::int64_t edge = Histogram::lower_edge(bucket) - 1;
      std::uint64_t above = 0;
      h.for_each([&](std::int64_t lower, std::int64_t, std::uint64_t n) {
        if (lower > edge) above += n;
      });
      ASSERT_EQ(above, static_cast<std::uint64_t>(all.end() -
                                                  std::upper_bound(all.begin(), all.end(), edge)));
    }
  }
}

TEST(Histogram, MergingEqualsRecordingTogether) {
  rt::Random random(5);
  Histogram parts[3], whole, empty;
  for (int i = 0; i < 30'000; ++i) {
    const auto v = static_cast<std::int64_t>(std::exp(random.uniform(0, 20)));
    parts[i % 3].record(v);
    whole.record(v);
  }
  Histogram merged;
  for (const int i : {2, 0, 1}) merged.merge(parts[i]);
  merged.merge(empty);
  EXPECT_EQ(merged.count(), whole.count());
  EXPECT_EQ(merged.min(), whole.min());
  EXPECT_EQ(merged.max(), whole.max());
  EXPECT_EQ(merged.mean(), whole.mean());
  std::vector<std::uint64_t> a, b;
  merged.for_each([&](std::int64_t, std::int64_t, std::uint64_t n) { a.push_back(n); });
  whole.for_each([&](std::int64_t, std::int64_t, std::uint64_t n) { b.push_back(n); });
  EXPECT_EQ(a, b);
  merged.reset();
  EXPECT_TRUE(merged.empty());
  EXPECT_EQ(merged.quantile(0.9), 0);
}

TEST(Histogram, RecordingAllocatesNothing) {
  if (!rt_guard::linked()) GTEST_SKIP() << "the guard is not linked in this build";
  const auto h = std::make_unique<Histogram>();
  rt_guard::reset();
  {
    rt::Section s;
    for (std::int64_t i = 0; i < 1000; ++i) h->record(i * i * i);
  }
  EXPECT_EQ(rt_guard::counts().total(), 0u);
}

}  // namespace
