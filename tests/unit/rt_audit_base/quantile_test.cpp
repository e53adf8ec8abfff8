// The rank rule against whole numbers and sorting: q is a fraction of integers, the rank the first
// r with r b >= a n.
#include "rt/quantile.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include "rt/random.hpp"

namespace {

constexpr double kInf = std::numeric_limits<double>::infinity();
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

// Of q = a / b.
std::uint64_t slow_rank(std::uint64_t a, std::uint64_t b, std::uint64_t n) {
  std::uint64_t r = 1;
  while (r * b < a * n) ++r;
  return r;
}

TEST(Quantile, RankIsTheFirstWhoseShareReachesQ) {
  for (std::uint64_t n = 1; n <= 2100; n = n < 130 ? n + 1 : n + 97)
    for (const std::uint64_t b : {2U, 32U, 100U, 1000U})
      for (std::uint64_t a = 0; a <= b; ++a)
        ASSERT_EQ(rt::quantile_rank(static_cast<double>(a) / static_cast<double>(b), n),
                  slow_rank(a, b, n))
            << a << " / " << b << " of " << n;
  // As it is written: the product 0.07 * 100 is more than 7.
  ASSERT_GT(0.07 * 100, 7);
  EXPECT_EQ(rt::quantile_rank(0.07, 100), 7U);
  EXPECT_EQ(rt::quantile_rank(std::nextafter(0.07, 1), 100), 8U);
  EXPECT_EQ(rt::quantile_rank(0.999, 1000), 999U);
  EXPECT_EQ(rt::quantile_rank(0.999, 999), 999U);
}

TEST(Quantile, RankOfManyValues) {
  const std::uint64_t seed = 29;
  RecordProperty("seed", static_cast<int>(seed));
  rt::Random random(seed);
  for (int i = 0; i < 200'000; ++i) {
    auto n = static_cast<std::uint64_t>(std::exp2(random.uniform(0, 43)));  // 1000 n < 2^53
    const auto a = static_cast<std::uint64_t>(random.integer(0, 1000));
    __extension__ using Wide = unsigned __int128;
    const auto up = static_cast<std::uint64_t>((Wide{a} * n + 999) / 1000);
    ASSERT_EQ(rt::quantile_rank(static_cast<double>(a) / 1000, n), std::max<std::uint64_t>(1, up))
        << a << " thousandths of " << n << ", seed " << seed;
    n = static_cast<std::uint64_t>(std::exp2(random.uniform(0, 51)));
    const double q = random.uniform();
    const std::uint64_t r = rt::quantile_rank(q, n);
    const auto share = [&](std::uint64_t k) {
      return static_cast<double>(k) / static_cast<double>(n);
    };
    ASSERT_GE(r, 1U);
    ASSERT_LE(r, n);
    ASSERT_GE(share(r), q) << n << ", seed " << seed;
    ASSERT_TRUE(r == 1 || share(r - 1) < q) << q << " of " << n << ", seed " << seed;
  }
}

TEST(Quantile, Ends) {
  for (const std::uint64_t n : {1U, 2U, 3U, 1000U}) {
    for (const double q : {0.0, -0.0, -1.0, -kInf, kNaN, 1e-300})
      EXPECT_EQ(rt::quantile_rank(q, n), 1U) << q;
    for (const double q : {1.0, 1.5, kInf}) EXPECT_EQ(rt::quantile_rank(q, n), n) << q;
    EXPECT_EQ(rt::quantile_rank(std::nextafter(1.0, 0), n), n);
  }
  EXPECT_EQ(rt::quantile_rank(0.5, std::uint64_t{1} << 52), std::uint64_t{1} << 51);
}

TEST(Quantile, EmptyIsWhatTheCallerSays) {
  EXPECT_EQ(rt::quantile_rank(0.5, 0), 0U);
  std::vector<double> none;
  EXPECT_EQ(rt::quantile(none, 0.5), 0);
  EXPECT_TRUE(std::isnan(rt::quantile(none, 0.5, kNaN)));
  EXPECT_EQ(rt::quantile_in_place(std::span(none), 1, -1), -1);
  EXPECT_EQ(rt::quantile_of_sorted(std::span(none), 0, 7), 7);
}

TEST(Quantile, MedianOfAnEvenNumberIsTheLowerOne) {
  EXPECT_EQ(rt::quantile(std::vector<std::int64_t>{4, 1, 3, 2}, 0.5), 2);
  EXPECT_EQ(rt::quantile(std::vector<std::int64_t>{5, 4, 1, 3, 2}, 0.5), 3);
  EXPECT_EQ(rt::quantile(std::vector<double>{kInf, 2, -kInf}, 0.5), 2);
  EXPECT_EQ(rt::quantile(std::vector<double>{kInf, 2, -kInf}, 1), kInf);
  constexpr int kRising[] = {1, 2, 3, 4};
  static_assert(rt::quantile_of_sorted(std::span<const int>(kRising), 0.75) == 3);
  static_assert(noexcept(rt::quantile_in_place(std::span<double>(), 0.5)));
}

// In place, of the sorted and of a copy: all are the sorted values at the rank; the in-place one
// keeps the values.
template <class T>
void against_sorting(std::uint64_t seed, rt::Random& random) {
  for (int round = 0; round < 400; ++round) {
    std::vector<T> v(static_cast<std::size_t>(random.integer(1, round < 200 ? 12 : 3000)));
    const std::int64_t range = random.integer(0, 2) == 0 ? 3 : 1'000'000;  // with ties and without
    for (T& x : v)
      x = static_cast<T>(random.integer(-range, range)) / (std::is_integral_v<T> ? 1 : 7);
    std::vector<T> sorted = v;
    std::sort(sorted.begin(), sorted.end());
    const auto a = static_cast<std::uint64_t>(random.integer(0, 1000));
    const double q = static_cast<double>(a) / 1000;
    const T want = sorted[slow_rank(a, 1000, v.size()) - 1];
    ASSERT_EQ(rt::quantile(v, q), want) << q << " of " << v.size() << ", seed " << seed;
    ASSERT_EQ(rt::quantile_of_sorted(std::span<const T>(sorted), q), want) << "seed " << seed;
    ASSERT_EQ(rt::quantile_in_place(std::span(v), q), want) << "seed " << seed;
    std::sort(v.begin(), v.end());
    ASSERT_EQ(v, sorted);
  }
}

TEST(Quantile, AgainstSortingAndCounting) {
  const std::uint64_t seed = 31;
  RecordProperty("seed", static_cast<int>(seed));
  rt::Random random(seed);
  against_sorting<double>(seed, random);
  against_sorting<std::int64_t>(seed, random);
  against_sorting<float>(seed, random);
}

}  // namespace
