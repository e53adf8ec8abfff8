// The clutch in the graph: the device's second button, and the camera's direction that the
// workspace takes over.
#include <gtest/gtest.h>

#include "tasks/graph/haptic_node.hpp"

namespace {

using perception::Vec3;

class Hand final : public drivers::HapticDevice {
 public:
  drivers::StylusSample sample;
  drivers::DeviceProperties properties() const noexcept override { return {}; }
  bool sense(rt::Time now, drivers::StylusSample& out) noexcept override {
    ++sample.seq;
    sample.taken = now;
    sample.state = drivers::DeviceState::kForce;
    out = sample;
    return true;
  }
  void act(rt::Time, const drivers::ForceCommand&) noexcept override {}
  void make_safe() noexcept override {}
};

struct Box {
  rt::Startup startup;
  Hand hand;
  tasks::GraphConfig config;
  tasks::OperatorSetup setup;
  tasks::OperatorCells cells{startup.token(), config};
  std::unique_ptr<tasks::HapticNode> node;
  rt::JobRecord record;
  std::int64_t k = 0;

  Box() {
    setup.device = &hand;
    config.haptic.workspace_W_m = {0.5, 0, 0.3};
    node = std::make_unique<tasks::HapticNode>(startup.token(), config, setup, cells, 1e-3);
  }
  // A tick with the device there; where the hand is in the scene.
  Vec3 at(const Vec3& p_DH, bool clutch) {
    hand.sample.p_DH = p_DH;
    hand.sample.clutch = clutch;
    rt::Tick tick;
    tick.k = static_cast<std::uint64_t>(k);
    tick.release = tick.start = rt::time_from_ns(1'000'000 * ++k);
    node->latch(tick, record);
    (void)node->step(tick, record);
    node->commit(tick, record);
    return cells.of<tasks::EdgeId::kHand>()
        .cell.acquire(tasks::reader_slot(tasks::EdgeId::kHand, tasks::kConsole))
        ->p_WH;
  }
  // The camera looks along `ahead`, level.
  void camera(std::uint64_t seq, const Vec3& ahead, bool claimed) {
    tasks::CameraPose& c = cells.begin_write<tasks::EdgeId::kCameraPose>();
    c = {};
    c.seq = seq;
    c.claimed = claimed;
    c.seen = c.exposure = rt::time_from_ns(1'000'000 * k + 1);
    c.X_WC.linear().col(2) = ahead;
    c.X_WC.linear().col(1) = -Vec3::UnitZ();
    c.X_WC.linear().col(0) = (-Vec3::UnitZ()).cross(ahead);
    cells.publish<tasks::EdgeId::kCameraPose>(c.seen);
  }
};

TEST(Clutch, TheHandInTheSceneWaitsAndGoesOnInTheCamerasDirection) {
  Box box;
  const Vec3 before = box.at({0.02, 0.01, 0}, false);
  EXPECT_LT((before - Vec3(0.52, 0.01, 0.3)).norm(), 1e-12);
  box.camera(1, Vec3::UnitY(), true);
  box.camera(2, -Vec3::UnitX(), false);  // not claimed: where nobody knows
  EXPECT_EQ(box.at({0.02, 0.01, 0}, false), before) << "without the clutch nothing turns";
  box.camera(3, Vec3::UnitY(), true);
  for (int i = 1; i <= 10; ++i) {
    const Vec3 there = box.at(Vec3(0.02 - 0.005 * i, 0.01, 0.001 * i), true);
    EXPECT_LT((there - before).norm(), 1e-12) << i;
  }
  EXPECT_EQ(box.record.input_seq[3], 3U);
  EXPECT_LT((box.node->task().workspace().R_WD().col(0) - Vec3::UnitY()).norm(), 1e-12);
  box.camera(4, -Vec3::UnitX(), true);
  const Vec3 first = box.at({-0.03, 0.01, 0.01}, false);
  EXPECT_LT((first - before).norm(), 1e-12);
  const Vec3 on = box.at({-0.02, 0.01, 0.01}, false);
  EXPECT_LT((on - before - Vec3(0, 0.01, 0)).norm(), 1e-12) << "away from the operator is ahead";
  tasks::HapticSample s, last;
  int clutched = 0;
  while (box.cells.haptic_samples.try_pop(s)) {
    clutched += s.clutched ? 1 : 0;
    last = s;
  }
  EXPECT_EQ(clutched, 10);
  EXPECT_NEAR(static_cast<double>(last.reach), Vec3(-0.02, 0.01, 0.01).norm() / 0.075, 1e-6);
}

}  // namespace
