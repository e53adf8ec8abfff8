// The edge of the published method's ray cast: there where haptic.method asks for it and nowhere
// else, read in place.
#include <gtest/gtest.h>

#include <memory>

#include "rt/effect_count.hpp"
#include "tasks/graph/fusion_node.hpp"
#include "tasks/graph/haptic_node.hpp"

namespace {

using tasks::OperatorCells;

class Hand final : public drivers::HapticDevice {
 public:
  drivers::DeviceProperties properties() const noexcept override { return {}; }
  bool sense(rt::Time now, drivers::StylusSample& out) noexcept override {
    out = {};
    out.seq = ++seq_;
    out.taken = now;
    out.state = drivers::DeviceState::kForce;
    return true;
  }
  void act(rt::Time, const drivers::ForceCommand&) noexcept override {}
  void make_safe() noexcept override {}

 private:
  std::uint64_t seq_ = 0;
};

struct Box {
  rt::Startup startup;
  Hand hand;
  tasks::GraphConfig config;
  tasks::OperatorSetup setup;
  std::unique_ptr<tasks::OperatorGraph> graph;
  explicit Box(const char* method) {
    config.haptic.method = method;
    config.fusion.tsdf.max_blocks = 500;
    setup.device = &hand;
    setup.fusion.camera = {60, 60, 31.5, 23.5, 64, 48};
    graph = std::make_unique<tasks::OperatorGraph>(startup.token(), config, setup, 1e-3);
  }
};

std::uint64_t built() {
  return rt::effect_counts[static_cast<std::size_t>(rt::Effect::kForceShading)].built;
}

TEST(SurfaceEdge, OnlyTheMethodThatReadsItHasIt) {
  for (const char* method : {"constrained", "nearest", "nearest10"}) {
    const std::uint64_t before = built();
    EXPECT_FALSE(Box(method).graph->cells().has<tasks::EdgeId::kSurface>()) << method;
    EXPECT_EQ(built(), before) << method;
  }
  const std::uint64_t before = built();
  Box box("force_shading");
  ASSERT_TRUE(box.graph->cells().has<tasks::EdgeId::kSurface>());
  EXPECT_EQ(built(), before + 1);
  EXPECT_EQ(box.graph->cells().of<tasks::EdgeId::kSurface>().cell.slot_count(), 3)
      << "one is read, one is newest, one is filled";
  // Room for a camera's pixels is made at set-up.
  EXPECT_EQ(box.graph->cells().of<tasks::EdgeId::kSurface>().cell.begin_write().x.size(),
            64U * 48U);
}

// A cast that takes so long that two of them are more than a reader waits is one clear error.
TEST(SurfaceEdge, ALivenessBelowTwoCastsIsRefused) {
  Hand hand;
  rt::Startup startup;
  tasks::GraphConfig config;
  tasks::OperatorSetup setup;
  setup.device = &hand;
  setup.fusion.camera = {60, 60, 31.5, 23.5, 64, 48};
  config.fusion.tsdf.max_blocks = 500;
  config.limits.liveness_ms[tasks::limit_row(tasks::EdgeId::kSurface, tasks::TaskId::kHaptic)] =
      700;
  const tasks::OperatorGraph bare(startup.token(), config, setup, 1e-3);
  config.haptic.method = "force_shading";
  try {
    const tasks::OperatorGraph graph(startup.token(), config, setup, 1e-3);
    ADD_FAILURE() << "twelve periods are 400 ms";
  } catch (const std::runtime_error& e) {
    EXPECT_NE(std::string(e.what()).find("limits.haptic.surface_liveness_ms = 700"),
              std::string::npos)
        << e.what();
    EXPECT_NE(std::string(e.what()).find("fusion.surface_periods = 12"), std::string::npos);
  }
  config.fusion.surface_periods = 10;
  const tasks::OperatorGraph graph(startup.token(), config, setup, 1e-3);
}

// What a tick latched stays as it is until the next latch, however much is published meanwhile; and
// nobody copies.
TEST(SurfaceEdge, WhatATickReadsIsNotWrittenUntilItsNextLatch) {
  Box box("force_shading");
  auto& cell = box.graph->cells().of<tasks::EdgeId::kSurface>().cell;
  const auto publish = [&](std::uint64_t seq, rt::Time at) {
    tasks::SurfacePoints& s = cell.begin_write();
    s.seq = seq;
    s.exposure = at;
    s.set(0, {static_cast<double>(seq), 0, 0}, tasks::Vec3::UnitX());
    cell.publish(at);
    return &s;
  };
  auto& node = dynamic_cast<tasks::HapticNode&>(box.graph->body(tasks::TaskId::kHaptic));
  rt::JobRecord record;
  rt::Tick tick;
  const auto latch = [&](std::int64_t ms) {
    tick.k = static_cast<std::uint64_t>(ms);
    tick.release = tick.start = rt::time_from_ns(1'000'000 * ms);
    node.latch(tick, record);
  };
  latch(1);
  EXPECT_EQ(node.in().surface, nullptr) << "never published";
  EXPECT_FALSE(node.in().surface_stale);
  EXPECT_EQ(record.input_seq[4], 0U);
  const auto* first = publish(1, rt::time_from_ns(1'500'000));
  latch(2);
  ASSERT_EQ(node.in().surface, first) << "in place";
  EXPECT_EQ(record.input_seq[4], 1U);
  for (std::uint64_t seq = 2; seq < 12; ++seq) {
    const auto* other = publish(seq, rt::time_from_ns(2'500'000));
    EXPECT_NE(other, first);
    EXPECT_EQ(node.in().surface->seq, 1U);
    EXPECT_EQ(node.in().surface->point(0).x(), 1.0);
  }
  latch(3);
  EXPECT_EQ(node.in().surface->seq, 11U);
  EXPECT_EQ(record.input_seq[4], 11U);
}

}  // namespace
