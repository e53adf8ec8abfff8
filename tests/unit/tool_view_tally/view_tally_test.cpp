// Figures of samples that are gone, against those of all samples by plain loops.
#include "tools/host/view_tally.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "rt/random.hpp"
#include "tools/touch/force_check.hpp"

namespace {

using teletact::Decimated;
using teletact::FusionTally;
using teletact::HapticTally;

std::vector<tasks::HapticSample> ticks(std::uint64_t seed, std::size_t n) {
  rt::Random random(seed);
  std::vector<tasks::HapticSample> out(n);
  bool contact = false;
  for (std::size_t i = 0; i < n; ++i) {
    auto& s = out[i];
    s.stamp = rt::Time{} + rt::Nanos{static_cast<std::int64_t>(i) * 1000000};
    if (random.uniform() < 0.02) contact = !contact;
    s.in_contact = contact;
    for (auto* v : {&s.p_WH, &s.p_WP})
      for (float& x : *v) x = static_cast<float>(1e-3 * random.normal());
    s.force_N = static_cast<float>(random.uniform() * 8);
    s.step_N = static_cast<float>(random.uniform());
    s.step_raw_N = static_cast<float>(random.uniform() * 2);
    s.reach = static_cast<float>(random.uniform());
    s.guard_use = random.uniform() < 0.1;
    s.finite = random.uniform() < 0.99;
    s.clutched = random.uniform() < 0.3;
  }
  return out;
}

double dot(const std::array<float, 3>& a, const std::array<float, 3>& b) {
  double d = 0;
  for (int i = 0; i < 3; ++i)
    d += static_cast<double>(a[static_cast<std::size_t>(i)]) *
         static_cast<double>(b[static_cast<std::size_t>(i)]);
  return d;
}

TEST(ViewTally, HapticFiguresDoNotDependOnWhatIsGone) {
  const std::uint64_t seed = 31;
  RecordProperty("seed", static_cast<int>(seed));
  const auto all = ticks(seed, 20000);
  constexpr double kSpring = 500;
  // By plain loops, each figure for itself.
  std::uint64_t contacts = 0, jumps = 0, flips = 0, guard = 0;
  double force = 0;
  std::array<float, 3> entry{};
  for (std::size_t i = 0; i < all.size(); ++i) {
    const auto& s = all[i];
    const bool before = i > 0 && all[i - 1].in_contact;
    contacts += s.in_contact && !before ? 1 : 0;
    guard += s.in_contact && s.guard_use ? 1 : 0;
    force = std::max(force, static_cast<double>(s.force_N));
    if (s.in_contact && before) {
      std::array<float, 3> moved{};
      for (std::size_t a = 0; a < 3; ++a) moved[a] = s.p_WH[a] - all[i - 1].p_WH[a];
      jumps += static_cast<double>(s.step_raw_N) > kSpring * std::sqrt(dot(moved, moved)) + 0.5;
    }
    std::array<float, 3> stretch{};
    for (std::size_t a = 0; a < 3; ++a) stretch[a] = s.p_WP[a] - s.p_WH[a];
    if (!s.in_contact) {
      entry = {};
    } else if (std::sqrt(dot(stretch, stretch)) > 1e-4) {
      const bool first = dot(entry, entry) == 0;
      if (first || dot(stretch, entry) < 0) {
        flips += first ? 0 : 1;
        entry = stretch;
      }
    }
  }
  ASSERT_GT(jumps, 0U);
  ASSERT_GT(flips, 0U);
  // Folded as they come, in halves.
  std::vector<tasks::HapticSample> held;
  HapticTally past;
  for (const auto& s : all) {
    held.push_back(s);
    teletact::fold_older(held, 700, [&](const auto& old) { past.add(old, kSpring); });
  }
  EXPECT_LT(held.size(), 1400U);
  EXPECT_GT(past.ticks, 10000U);
  for (const auto& s : held) past.add(s, kSpring);
  EXPECT_EQ(past.ticks, all.size());
  EXPECT_EQ(past.contacts, contacts);
  EXPECT_EQ(past.guard, guard);
  EXPECT_EQ(past.jumps, jumps);
  EXPECT_EQ(past.flips, flips);
  EXPECT_EQ(past.force_N, force);
}

// As the consoles hold theirs: however long it goes on, the memory is that of the start.
TEST(ViewTally, AListWithRoomStaysWhereItIs) {
  constexpr std::size_t kWhole = 700, kAtOnce = 64;
  std::vector<std::uint64_t> held;
  teletact::hold_room(held, 2 * kWhole + kAtOnce);
  Decimated<std::uint64_t> thin;
  teletact::hold_room(thin.kept, Decimated<std::uint64_t>::kMost);
  ASSERT_TRUE(held.empty());
  const auto* const place = held.data();
  const auto* const thin_place = thin.kept.data();
  rt::Random random(5);
  std::uint64_t next = 0, gone = 0;
  while (next < 100000) {
    for (std::uint64_t n = random.uniform() < 0.1 ? kAtOnce : 7; n > 0; --n) held.push_back(next++);
    teletact::fold_older(held, kWhole, [&](std::uint64_t old) {
      EXPECT_EQ(old, gone++);
      thin.add(old);
    });
  }
  EXPECT_EQ(held.data(), place);
  EXPECT_EQ(thin.kept.data(), thin_place);
  EXPECT_EQ(gone + held.size(), next);
}

TEST(ViewTally, DecimatedKeepsEveryNthOfAnyNumber) {
  Decimated<int> d;
  for (int i = 0; i < 1000000; ++i) {
    d.add(i);
    ASSERT_LE(d.kept.size(), Decimated<int>::kMost);
  }
  EXPECT_GE(d.kept.size(), Decimated<int>::kMost / 2 - 1);
  for (std::size_t i = 0; i < d.kept.size(); ++i)
    ASSERT_EQ(d.kept[i], static_cast<int>(i * d.step));
}

TEST(ViewTally, TouchesOfSamplesThatAreGoneStillCount) {
  const auto all = ticks(32, 20000);
  std::vector<teletact::Visit> visits(2);
  visits[0].from_s = 1;
  visits[0].until_s = 9;
  visits[1].from_s = 11;
  visits[1].until_s = 19.5;
  for (auto& v : visits) v.chosen = v.pressed = true;
  const auto whole = teletact::touched_places(visits, all, 0);
  // The first visit was all that there was when the first half went.
  const std::vector<teletact::Visit> first(visits.begin(), visits.begin() + 1);
  const std::vector<tasks::HapticSample> old(all.begin(), all.begin() + 10000),
      rest(all.begin() + 10000, all.end());
  const auto past = teletact::touched_places(first, old, 0).visits;
  const auto got = teletact::touched_places(visits, rest, 0, past);
  ASSERT_EQ(got.visits.size(), 2U);
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_GT(whole.visits[i].contact_s, 0.5);
    EXPECT_NEAR(got.visits[i].contact_s, whole.visits[i].contact_s, 1e-9);
    EXPECT_EQ(got.visits[i].force_max_N, whole.visits[i].force_max_N);
  }
}

}  // namespace
