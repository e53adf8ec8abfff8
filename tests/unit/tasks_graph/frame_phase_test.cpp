// Fusion's phase against frames simulated one by one.
#include "tasks/graph/frame_phase.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cinttypes>
#include <cstdio>
#include <vector>

#include "rt/random.hpp"

namespace {

using rt::Nanos;
using std::chrono::microseconds;
using std::chrono::milliseconds;
using tasks::FrameWay;

constexpr Nanos kPeriod{33333333};

// Share of frames that a newest-wins cell loses when frame k arrives at k T + arrival(k) and the
// reader comes at k T + offset.
double overwritten(const std::vector<Nanos>& arrivals, Nanos offset) {
  std::vector<std::int64_t> at;
  for (std::size_t k = 0; k < arrivals.size(); ++k)
    at.push_back(static_cast<std::int64_t>(k) * kPeriod.count() + arrivals[k].count());
  for (std::size_t k = 1; k < at.size(); ++k) at[k] = std::max(at[k], at[k - 1]);  // in order
  std::size_t next = 0, seen = 0;
  for (std::int64_t t = offset.count(); next < at.size(); t += kPeriod.count()) {
    std::size_t newest = next;
    while (newest < at.size() && at[newest] <= t) ++newest;
    seen += newest > next ? 1 : 0;
    next = newest;
  }
  return 1.0 - static_cast<double>(seen) / static_cast<double>(at.size());
}

std::vector<Nanos> draw(const tasks::FrameArrival& a, rt::Random& random, int n) {
  std::vector<Nanos> out;
  for (int i = 0; i < n; ++i) {
    out.push_back(a.earliest +
                  Nanos{static_cast<std::int64_t>(
                      random.uniform() * static_cast<double>((a.latest - a.earliest).count()))});
  }
  return out;
}

TEST(FramePhase, NothingIsOverwrittenWhereArrivalsLeaveRoom) {
  const std::uint64_t seed = 20240611;
  std::printf("seed %" PRIu64 "\n", seed);
  rt::Random random(seed, 0);
  int beside = 0;
  for (int round = 0; round < 300; ++round) {
    FrameWay way;
    way.capture_typical = Nanos{static_cast<std::int64_t>(random.uniform() * 3e6)};
    way.capture_bound =
        way.capture_typical + Nanos{static_cast<std::int64_t>(random.uniform() * 6e6)};
    way.bytes_min = 80000 + static_cast<std::uint64_t>(random.uniform() * 20000);
    way.bytes_max = way.bytes_min + static_cast<std::uint64_t>(random.uniform() * 30000);
    way.shape.delay_ms = 200 * random.uniform();
    way.shape.jitter_ms = 6 * random.uniform();
    way.shape.rate_Mbit_per_s = round % 3 == 0 ? 0 : 60;
    const auto arrival = tasks::frame_arrival(way);
    ASSERT_LT(arrival.latest - arrival.earliest, kPeriod);
    const Nanos offset = tasks::fusion_offset(arrival, kPeriod);
    ASSERT_GE(offset, Nanos{0});
    ASSERT_LT(offset, kPeriod);
    const auto frames = draw(arrival, random, 200);
    EXPECT_EQ(overwritten(frames, offset), 0.0) << round;
    // The judge can tell: in the midst of the arrivals frames are lost.
    const Nanos midst = (arrival.earliest + (arrival.latest - arrival.earliest) / 2) % kPeriod;
    beside += overwritten(frames, midst) > 0.1 ? 1 : 0;
  }
  EXPECT_GT(beside, 290);
}

TEST(FramePhase, TheMarginIsHalfOfTheRoomAndBounded) {
  tasks::FrameArrival a{milliseconds{10}, milliseconds{15}};
  EXPECT_EQ(tasks::fusion_offset(a, kPeriod), milliseconds{15} + tasks::kFrameMargin);
  a.latest = milliseconds{10} + kPeriod - milliseconds{4};
  EXPECT_EQ(tasks::fusion_offset(a, kPeriod), (a.latest + milliseconds{2}) % kPeriod);
  // Arrivals longer than a period leave no room: still a phase of it.
  a.latest = milliseconds{10} + 5 * kPeriod;
  EXPECT_EQ(tasks::fusion_offset(a, kPeriod), milliseconds{10});
}

TEST(FramePhase, TheWayAddsUp) {
  FrameWay way;
  way.capture_typical = milliseconds{1};
  way.capture_bound = milliseconds{4};
  way.bytes_min = 75000;
  way.bytes_max = 150000;
  const auto bare = tasks::frame_arrival(way);
  way.shape.delay_ms = 30;
  const auto delayed = tasks::frame_arrival(way);
  EXPECT_EQ(delayed.earliest - bare.earliest, milliseconds{30});
  EXPECT_EQ(delayed.latest - bare.latest, milliseconds{30});
  way.shape.jitter_ms = 5;
  const auto jittery = tasks::frame_arrival(way);
  EXPECT_EQ(jittery.earliest, delayed.earliest);
  EXPECT_EQ(jittery.latest - delayed.latest, milliseconds{5});
  way.shape.rate_Mbit_per_s = 60;
  const auto slow = tasks::frame_arrival(way);
  EXPECT_EQ(slow.earliest - jittery.earliest, milliseconds{10});
  EXPECT_EQ(slow.latest - jittery.latest, milliseconds{20});
}

// A job of fusion on capture's core, above it, is in capture's bound; at the phase chosen it lies
// elsewhere.
TEST(FramePhase, CaptureBelowFusionOnOneCoreGivesThePhaseOfCaptureAlone) {
  const auto offset = [](int fusion_core, milliseconds bound) {
    rt::Admission admission;
    admission.tasks.resize(tasks::kTaskCount);
    auto& capture = admission.tasks[tasks::index_of(tasks::TaskId::kCapture)];
    auto& fusion = admission.tasks[tasks::index_of(tasks::TaskId::kFusion)];
    capture.core = 0, capture.priority = 75, capture.C = milliseconds{2}, capture.R = bound;
    fusion.core = fusion_core, fusion.priority = 76, fusion.C = milliseconds{20};
    auto specs = tasks::make_specs({}, {});
    tasks::set_fusion_phase(specs, admission, {}, {});
    return specs[tasks::index_of(tasks::TaskId::kFusion)].offset;
  };
  EXPECT_EQ(offset(0, milliseconds{25}), offset(1, milliseconds{5}));
  EXPECT_NE(offset(1, milliseconds{25}), offset(1, milliseconds{5}))
      << "another core: the bound as it is";
  EXPECT_EQ(offset(0, milliseconds{3}), offset(1, milliseconds{2})) << "not below its own cost";
}

// Frame f is whole at f T + exposure: the release that follows comes kWhole later, not a period.
TEST(FramePhase, CaptureComesWhenTheFrameIsWhole) {
  for (const Nanos exposure :
       {Nanos{100'000}, Nanos{10'000'000}, Nanos{23'000'000}, Nanos{30'000'000}}) {
    const Nanos offset = tasks::capture_offset(exposure, kPeriod);
    EXPECT_GE(offset.count(), 0);
    EXPECT_LT(offset, kPeriod);
    const Nanos whole = exposure % kPeriod;
    const Nanos waits = offset >= whole ? offset - whole : offset + kPeriod - whole;
    EXPECT_EQ(waits, tasks::kWhole) << exposure.count();
  }
}

}  // namespace
