#include "rt/sched/mode_table.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdio>
#include <stdexcept>

#include "rt/random.hpp"

namespace {

using rt::AdmissionRequest;
using rt::ModeDemand;
using rt::ModeSet;
using rt::Nanos;
using testing::HasSubstr;

constexpr Nanos ms(double v) { return rt::nanos_from_seconds(v * 1e-3); }

rt::TaskSpec task(const char* name, double full_ms, double small_ms) {
  rt::TaskSpec s;
  s.name = name;
  s.rate = {10, 1};
  s.variants = {{"full", ms(full_ms)}, {"small", ms(small_ms)}};
  return s;
}

// One core, 90 ms of each 100 to give: hold runs both small, engaged one of them full.
struct Fixture {
  AdmissionRequest request;
  rt::Admission admission;
  std::vector<ModeSet> modes;
  Fixture(double drive_full_ms, double touch_full_ms) {
    request.cpus = {3};
    request.tasks = {task("touch", touch_full_ms, 30), task("drive", drive_full_ms, 10)};
    request.degrade_order = {"touch", "drive"};
    admission = rt::admit(request);
    modes = {{"hold", true, {{true, 1, 1}, {true, 1, 1}}},
             {"engaged", false, {{true, 1, 1}, {true, 0, 1}}},
             {"stop", true, {{true, 1, 1}, {false, 0, 0}}}};
  }
};

TEST(ModeTable, EveryModeThatFitsIsOpen) {
  Fixture f(55, 70);
  ASSERT_TRUE(f.admission.admitted) << f.admission.refusal;
  const auto t = rt::analyse_modes(f.request, f.admission, f.modes);
  EXPECT_EQ(t.refusal, "");
  for (std::size_t from = 0; from < 3; ++from) {
    for (std::size_t to = 0; to < 3; ++to) EXPECT_TRUE(t.gate.may_enter(from, to)) << from << to;
  }
  EXPECT_NEAR(t.verdict(0, 0).utilisation, 0.40032, 1e-4);
  EXPECT_NEAR(t.verdict(1, 1).utilisation, 0.85032, 1e-4);
  EXPECT_NEAR(t.verdict(2, 2).utilisation, 0.30016, 1e-4);
  EXPECT_EQ(t.verdict(2, 1).utilisation, t.verdict(1, 1).utilisation)
      << "a change costs the dearer";
  const std::string text = rt::mode_report(t);
  std::printf("%s", text.c_str());
  EXPECT_THAT(text, HasSubstr("engaged"));
}

TEST(ModeTable, AModeThatDoesNotFitIsClosedWithFigures) {
  Fixture f(65, 70);
  const auto t = rt::analyse_modes(f.request, f.admission, f.modes);
  EXPECT_EQ(t.refusal, "") << "the others may run";
  EXPECT_FALSE(t.gate.may_enter(0, 1));
  EXPECT_FALSE(t.gate.may_enter(2, 1));
  EXPECT_FALSE(t.gate.may_enter(1, 1));
  EXPECT_TRUE(t.gate.may_enter(0, 2));
  EXPECT_THAT(t.verdict(0, 1).refusal, HasSubstr("task 'drive' pinned to core 0 (cpu 3)"));
  EXPECT_THAT(t.verdict(0, 1).refusal, HasSubstr("utilisation 0.9503 above 0.90"));
  EXPECT_THAT(rt::mode_report(t), HasSubstr("engaged    refused"));
}

TEST(ModeTable, ASafeModeThatDoesNotFitRefusesTheStart) {
  Fixture f(65, 70);
  f.modes[1].safe = true;
  const auto t = rt::analyse_modes(f.request, f.admission, f.modes);
  EXPECT_THAT(t.refusal, HasSubstr("mode 'engaged' could not be entered when it must be"));
  EXPECT_THAT(t.refusal, HasSubstr("'drive'"));
}

// Two modes that fit, and no way from one to the other: while the change is under way both are paid
// for.
TEST(ModeTable, AChangeIsAnalysedOnItsOwn) {
  Fixture f(55, 75);
  f.modes = {{"touch only", true, {{true, 0, 0}, {false, 0, 0}}},
             {"drive only", false, {{false, 0, 0}, {true, 0, 0}}}};
  auto t = rt::analyse_modes(f.request, f.admission, f.modes);
  EXPECT_TRUE(t.gate.may_enter(0, 0));
  EXPECT_TRUE(t.gate.may_enter(1, 1));
  EXPECT_FALSE(t.gate.may_enter(0, 1));
  EXPECT_FALSE(t.gate.may_enter(1, 0));
  EXPECT_THAT(rt::mode_report(t), HasSubstr("change touch only -> drive only refused"));
  // The way back into the safe mode is closed although both could stay: such a table may not start.
  EXPECT_THAT(t.refusal, HasSubstr("the change from 'drive only' to 'touch only'"));
  // They cannot share one entry of the registry either.
  EXPECT_FALSE(rt::admit(rt::largest_of(f.request, f.admission, t)).admitted);
}

TEST(ModeTable, TheRegistryGetsTheDearestOfWhatMayBeEntered) {
  Fixture f(55, 70);
  auto t = rt::analyse_modes(f.request, f.admission, f.modes);
  auto all = rt::admit(rt::largest_of(f.request, f.admission, t));
  ASSERT_TRUE(all.admitted);
  EXPECT_EQ(all.tasks[1].C, ms(55));
  EXPECT_EQ(all.tasks[0].C, ms(30));
  Fixture closed(65, 70);
  t = rt::analyse_modes(closed.request, closed.admission, closed.modes);
  all = rt::admit(rt::largest_of(closed.request, closed.admission, t));
  ASSERT_TRUE(all.admitted);
  EXPECT_EQ(all.tasks[1].C, ms(10)) << "a closed mode is not reckoned with";
}

TEST(ModeTable, RandomSetsAgainstAnAdmissionOfEachPair) {
  std::printf("seeds 1..200\n");
  int open = 0, closed = 0;
  for (std::uint64_t seed = 1; seed <= 200; ++seed) {
    rt::Random rng(seed, 23);
    AdmissionRequest r;
    r.cpus = {0, 1};
    const auto n = static_cast<std::size_t>(rng.integer(2, 5));
    for (std::size_t i = 0; i < n; ++i) {
      const double full = rng.uniform(5, 70);
      r.tasks.push_back(task(("t" + std::to_string(i)).c_str(), full, full * rng.uniform(0.2, 1)));
    }
    const auto a = rt::admit(r);
    if (!a.admitted) continue;
    std::vector<ModeSet> modes(3);
    for (auto& m : modes) {
      m.name = "m";
      for (std::size_t i = 0; i < n; ++i) {
        const int first = static_cast<int>(rng.integer(0, 1));
        m.demands.push_back(
            {rng.integer(0, 3) > 0, first, first + static_cast<int>(rng.integer(0, 1 - first))});
      }
    }
    const auto t = rt::analyse_modes(r, a, modes);
    for (std::size_t from = 0; from < 3; ++from) {
      for (std::size_t to = 0; to < 3; ++to) {
        const auto fits = [&](std::size_t x, std::size_t y) {
          AdmissionRequest set;
          set.cpus = r.cpus;
          for (std::size_t i = 0; i < n; ++i) {
            Nanos c{0};
            for (const std::size_t m : {x, y}) {
              const ModeDemand& d = modes[m].demands[i];
              for (int l = d.first_level; d.runs && l <= d.last_level; ++l)
                c = std::max(c, r.tasks[i].budget_of(l));
            }
            if (c.count() == 0) continue;
            set.tasks.push_back(r.tasks[i]);
            set.tasks.back().variants.clear();
            set.tasks.back().budget = c;
            set.tasks.back().core = a.tasks[i].core;
          }
          return rt::admit(set).admitted;
        };
        const bool want = fits(from, to) && fits(to, to);
        ASSERT_EQ(t.gate.may_enter(from, to), want) << "seed " << seed << " " << from << to;
        (want ? open : closed) += 1;
      }
    }
  }
  std::printf("%d open, %d closed\n", open, closed);
  EXPECT_GT(open, 100);
  EXPECT_GT(closed, 50);
}

TEST(ModeTable, MalformedModesAreRefused) {
  Fixture f(55, 70);
  const auto what = [&](auto change) {
    auto modes = f.modes;
    change(modes);
    try {
      (void)rt::analyse_modes(f.request, f.admission, modes);
    } catch (const std::invalid_argument& e) {
      return std::string(e.what());
    }
    return std::string();
  };
  EXPECT_THAT(what([](auto& m) { m.clear(); }), HasSubstr("0 modes"));
  EXPECT_THAT(what([](auto& m) { m.resize(9, m[0]); }), HasSubstr("allowed: 1 to 8"));
  EXPECT_THAT(what([](auto& m) { m[1].demands.pop_back(); }), HasSubstr("mode 'engaged'"));
  EXPECT_THAT(what([](auto& m) { m[1].demands[1].last_level = 2; }), HasSubstr("'drive'"));
  EXPECT_THAT(what([](auto& m) { m[1].demands[1].first_level = -1; }), HasSubstr("'drive'"));
}

TEST(ModeGate, OpenWithoutATableClosedBeyondIt) {
  rt::ModeGate g;
  EXPECT_TRUE(g.may_enter(0, 7));
  EXPECT_FALSE(g.may_enter(0, 8));
  EXPECT_FALSE(g.may_enter(8, 0));
  g.set(0, 3, false);
  EXPECT_FALSE(g.may_enter(0, 3));
  EXPECT_TRUE(g.may_enter(3, 0));
  g.set(0, 3, true);
  EXPECT_TRUE(g.may_enter(0, 3));
}

}  // namespace
