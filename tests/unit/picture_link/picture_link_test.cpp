// A codec that needs its previous frame never loses an encoded one: on a fast and on a slow road,
// under a stall, a cut, damage, demands that are lost, and a job that is abandoned. The oracle is
// the camera's own image of the frame's number.
#include "tests/unit/picture_link/road.hpp"

#include <limits>
#include <memory>
#include <utility>

#include "drivers/codec/depth_stream.hpp"
#include "tasks/edges/link_edges.hpp"

namespace {

using picture_link::kHeight;
using picture_link::kMs;
using picture_link::kWidth;
using picture_link::Road;

// Every frame that was decoded is one that the camera gave, in order, within the codec's bound.
void expect_right(const Road& road, drivers::DepthMode mode) {
  std::uint64_t before = 0;
  // 8 steps of quality below the finest: the asker may have asked for any.
  const int bound = drivers::depth_error_bound_mm(drivers::DepthNoiseLaw::kStrict, mode,
                                                  drivers::kDepthSteps - 1, 2000);
  for (const auto& s : road.seen) {
    EXPECT_GT(s.number, before);
    before = s.number;
    EXPECT_TRUE(s.holes_right) << "frame " << s.number;
    EXPECT_LE(s.worst_mm, bound) << "frame " << s.number;
  }
}
// None is lost: what was encoded went out in order, but for one that may wait.
void expect_none_lost(const Road& road) {
  EXPECT_EQ(road.asker.stats().sent, road.handed_to_line());
  EXPECT_LE(road.encoded() - road.handed_to_line(), 1U);
}

TEST(PictureLink, WithoutSuchACodecNothingIsAskedAndTheHandshakeIsAsBefore) {
  Road road("lossless");
  EXPECT_FALSE(road.robot_cells.has<tasks::EdgeId::kDemand>());
  road.run(2000);
  EXPECT_GE(road.seen.size(), 58U);
  for (const auto& s : road.seen) EXPECT_EQ(s.worst_mm, 0);
  EXPECT_EQ(road.asker.stats().sent, 0U);
  EXPECT_EQ(
      road.operator_end.stats().sent[static_cast<std::size_t>(drivers::MessageId::kFrameReport)],
      0U);
}

TEST(PictureLink, OnAFastRoadEveryFrameIsEncodedOnceAndArrives) {
  for (const char* codec : {"faithful", "quiet", "moving"}) {
    SCOPED_TRACE(codec);
    Road road(codec);
    road.run(3000);
    EXPECT_GE(road.seen.size(), 87U);  // of 90, 20 ms of the last are on the way
    EXPECT_EQ(road.refused(), 0U);
    EXPECT_EQ(road.node->task().stats().unasked, 0U);
    EXPECT_EQ(road.asker.stats().keys_asked, 0U);
    EXPECT_EQ(road.asker.stats().silences, 0U);
    for (const auto& s : road.seen) {
      EXPECT_TRUE(s.colour);
      EXPECT_LE(s.age_ms, 23) << "the road takes 20";
    }
    expect_none_lost(road);
    expect_right(road, codec == std::string("faithful") ? drivers::DepthMode::kFaithful
                       : codec == std::string("quiet")  ? drivers::DepthMode::kQuiet
                                                        : drivers::DepthMode::kMoving);
  }
}

TEST(PictureLink, WhatASlowRoadDoesNotAskForIsNotEncoded) {
  Road road("faithful", 0.5);
  road.run(10'000);
  EXPECT_GT(road.seen.size(), 20U);
  EXPECT_LT(road.seen.size(), 210U) << "of 300; 20 a second are the fewest that are asked for";
  EXPECT_EQ(road.refused(), 0U);
  EXPECT_GT(road.node->task().stats().unasked, 90U);
  EXPECT_GT(road.asker.stats().rung, 0);
  expect_none_lost(road);
  expect_right(road, drivers::DepthMode::kFaithful);
  // The line is kept busy and nothing piles up: a frame is never older than two of them and the
  // way.
  std::int64_t longest = 0;
  for (std::size_t i = 1; i < road.seen.size(); ++i)
    longest = std::max(longest, road.seen[i].at_ms - road.seen[i - 1].at_ms);
  for (const auto& s : road.seen) EXPECT_LE(s.age_ms, 2 * longest + 60) << s.number;
}

TEST(PictureLink, AStallLosesNothingAndLeavesNoBacklog) {
  for (const int stall_ms : {100, 150, 400, 2500}) {
    SCOPED_TRACE(stall_ms);
    Road road("faithful");
    road.run(1000);
    const std::uint64_t encoded = road.encoded();
    road.stalled = true;
    road.run(stall_ms);
    EXPECT_LE(road.encoded() - encoded, 1U) << "one was asked for before";
    road.stalled = false;
    const std::size_t before = road.seen.size();
    road.run(1000);
    EXPECT_EQ(road.refused(), 0U);
    EXPECT_GE(road.seen.size() - before, 28U);
    expect_none_lost(road);
    expect_right(road, drivers::DepthMode::kFaithful);
    // The third is fresh: of two before it one was on the road, one waited.
    for (std::size_t i = before + 2; i < road.seen.size(); ++i)
      EXPECT_LE(road.seen[i].age_ms, 60) << i;
    EXPECT_EQ(road.asker.stats().silences, stall_ms > 180 ? 1U : 0U);
    EXPECT_EQ(road.asker.stats().keys, stall_ms > 180 ? 2U : 1U);
  }
}

TEST(PictureLink, AfterACutAKeyComesAndNothingIsEncodedForNobody) {
  Road road("faithful");
  road.run(1000);
  const std::uint64_t encoded = road.encoded(), keys = road.asker.stats().keys;
  road.cut = true;
  road.run(1500);
  EXPECT_LE(road.encoded() - encoded, 8U) << "180 ms of frames, until the silence is known";
  EXPECT_EQ(road.node->in().demand, nullptr) << "what was asked for is too old";
  road.cut = false;
  const std::size_t before = road.seen.size();
  road.run(1000);
  EXPECT_GE(road.seen.size() - before, 26U);
  EXPECT_EQ(road.asker.stats().keys, keys + 1);
  EXPECT_LE(road.refused(), 1U) << "one that needs a lost one may come before the key";
  // Frames that were lost do not hide that a later key has arrived: the next loss is told at once.
  const std::uint64_t asked = road.asker.stats().keys_asked;
  bool once = true;
  road.meddle = [&](std::vector<std::uint8_t>& m) {
    drivers::Header h;
    return drivers::read_header(m, h) != drivers::WireStatus::kOk ||
           h.id != drivers::MessageId::kFrame || !std::exchange(once, false);
  };
  const std::size_t then = road.seen.size();
  road.run(400);
  EXPECT_EQ(road.asker.stats().keys_asked, asked + 1);
  EXPECT_GE(road.seen.size() - then, 5U);
  expect_none_lost(road);
  expect_right(road, drivers::DepthMode::kFaithful);
}

// Of a frame's body, made good again for the link's own check: damage before it was sent.
void damage_frame(std::vector<std::uint8_t>& m) {
  drivers::Header h;
  ASSERT_EQ(drivers::read_header(m, h), drivers::WireStatus::kOk);
  m[drivers::kHeaderSize + 300] ^= 0x10U;
  const std::vector<std::uint8_t> body(m.begin() + drivers::kHeaderSize, m.end());
  ASSERT_EQ(drivers::write_message(h, body, m), m.size());
}

TEST(PictureLink, ADamagedOrLostFrameIsRefusedAndAKeyIsAskedForOnce) {
  for (const bool lost : {false, true}) {
    SCOPED_TRACE(lost ? "lost" : "damaged");
    Road road("faithful");
    road.run(1000);
    int left = 1;
    road.meddle = [&](std::vector<std::uint8_t>& m) {
      drivers::Header h;
      if (drivers::read_header(m, h) != drivers::WireStatus::kOk) return true;
      if (h.id != drivers::MessageId::kFrame || left == 0) return true;
      --left;
      if (lost) return false;
      damage_frame(m);
      return true;
    };
    const std::size_t before = road.seen.size();
    const std::int64_t at = road.ms();
    road.run(1000);
    ASSERT_EQ(left, 0);
    EXPECT_EQ(road.asker.stats().keys_asked, 1U);
    EXPECT_EQ(road.asker.stats().keys, 2U);
    EXPECT_LE(road.refused(), 5U) << "what was under way until the key";
    ASSERT_GT(road.seen.size(), before);
    // A way there, up to 20 ms until it is said, a camera period, a way back, a poll.
    EXPECT_LE(road.seen[before].at_ms - at, 34 + 20 + 20 + 20 + 34 + 20 + 10);
    EXPECT_GE(road.seen.size() - before, 24U);
    expect_none_lost(road);
    expect_right(road, drivers::DepthMode::kFaithful);
  }
}

// A frame of another instant, as a robot's box would send it.
void date_frame(std::vector<std::uint8_t>& m, std::int64_t ns) {
  drivers::Header h;
  ASSERT_EQ(drivers::read_header(m, h), drivers::WireStatus::kOk);
  const auto frame = std::make_unique<drivers::EncodedFrame>();
  ASSERT_EQ(drivers::read_wire(std::span(m).subspan(drivers::kHeaderSize), *frame),
            drivers::FrameStatus::kOk);
  frame->exposure.ns += ns;
  std::vector<std::uint8_t> body(m.size());
  body.resize(drivers::write_wire(*frame, body));
  ASSERT_EQ(drivers::write_message(h, body, m), m.size());
}

// A camera's clock that is wrong for one picture, and one that nobody can mean: the next are taken.
TEST(PictureLink, AFrameFromAheadIsRefusedAndTheNextIsTaken) {
  constexpr std::int64_t kYear = 365 * 86'400'000'000'000;
  for (const std::int64_t ahead_ns :
       {100 * kMs, 10 * kYear, std::numeric_limits<std::int64_t>::max() / 2}) {
    SCOPED_TRACE(ahead_ns);
    Road road("lossless");
    road.run(1000);
    int left = 1;
    road.meddle = [&](std::vector<std::uint8_t>& m) {
      drivers::Header h;
      if (drivers::read_header(m, h) != drivers::WireStatus::kOk) return true;
      if (h.id == drivers::MessageId::kFrame && left-- > 0) date_frame(m, ahead_ns);
      return true;
    };
    const std::size_t before = road.seen.size();
    road.run(1000);
    EXPECT_EQ(road.refused(), 1U);
    EXPECT_GE(road.seen.size() - before, 28U);
    for (const auto& s : road.seen) EXPECT_GE(s.age_ms, 0) << s.number;
  }
}

TEST(PictureLink, AStateFromAheadIsRefusedAndTheNextIsTaken) {
  Road road("lossless");
  std::vector<std::int64_t> taken_ms;
  tasks::receive_edge<tasks::EdgeId::kRobotState>(
      road.operator_cells, road.operator_end,
      [&](const drivers::RobotState& s, std::int64_t, std::size_t) {
        taken_ms.push_back((rt::ns_of(road.now()) - rt::ns_of(s.taken)) / kMs);
      });
  constexpr auto kCode = tasks::kEdge<tasks::EdgeId::kRobotState>.row.wire.code;
  std::int64_t ahead_ms = 0, made_ahead_ms = 0;
  std::uint64_t sent = 0;
  road.robot_end.add_outgoing(kCode, std::chrono::milliseconds{10}, false,
                              [&](std::span<std::uint8_t> out) {
                                drivers::RobotState s;
                                s.seq = ++sent;
                                s.taken = road.now() + std::chrono::milliseconds{ahead_ms};
                                s.made = road.now() + std::chrono::milliseconds{made_ahead_ms};
                                return drivers::encode(s, out);
                              });
  const auto refused = [&] {
    return road.operator_end.stats().refused[static_cast<std::size_t>(kCode)];
  };
  road.run(500);
  EXPECT_EQ(refused(), 0U);
  EXPECT_GE(taken_ms.size(), 45U);
  ahead_ms = 86'400'000;
  road.run(500);
  EXPECT_GE(refused(), 45U);
  // By this one it would live for a day.
  ahead_ms = 0, made_ahead_ms = 86'400'000;
  road.run(500);
  EXPECT_GE(refused(), 90U);
  made_ahead_ms = 0;
  const std::size_t before = taken_ms.size();
  road.run(500);
  EXPECT_GE(taken_ms.size() - before, 45U);
  for (const std::int64_t age : taken_ms) EXPECT_NEAR(static_cast<double>(age), 20, 3);
}

rt::FaultPlan on_demands(rt::FaultKind kind, double probability) {
  rt::FaultEntry e;
  e.kind = kind;
  e.target = "demand";
  e.probability = probability;
  e.magnitude = kind == rt::FaultKind::kStale ? std::chrono::seconds{2} : rt::Nanos{0};
  rt::FaultPlan p;
  p.name = "p";
  p.entries = {e};
  return p;
}

TEST(PictureLink, DemandsThatAreLostComeTwiceOrOldLoseNoFrame) {
  {
    Road road("faithful", 0, on_demands(rt::FaultKind::kDrop, 0.5));
    road.run(5000);
    // A camera period each, and 50 ms for each demand that is lost, one a frame: 60 at the most.
    EXPECT_GT(road.seen.size(), 45U);
    EXPECT_LT(road.seen.size(), 149U);
    EXPECT_EQ(road.refused(), 0U);
    expect_none_lost(road);
    expect_right(road, drivers::DepthMode::kFaithful);
  }
  {
    Road road("faithful", 0, on_demands(rt::FaultKind::kDuplicate, 1));
    road.run(2000);
    EXPECT_GE(road.seen.size(), 57U);
    EXPECT_EQ(road.refused(), 0U);
    expect_none_lost(road);
  }
  {
    Road road("faithful", 0, on_demands(rt::FaultKind::kStale, 1));
    road.run(2000);
    EXPECT_EQ(road.encoded(), 0U) << "older than its reader takes";
  }
}

TEST(PictureLink, AJobThatIsAbandonedAfterItEncodedIsFollowedByAKey) {
  Road road("faithful");
  road.run(1000);
  const std::uint64_t keys = road.asker.stats().keys;
  bool once = true;
  road.abandon = [&](std::uint64_t) { return std::exchange(once, false); };
  road.run(1000);
  ASSERT_FALSE(once);
  EXPECT_EQ(road.asker.stats().keys, keys + 1);
  EXPECT_EQ(road.refused(), 0U);
  EXPECT_GE(road.seen.size(), 57U);
  expect_right(road, drivers::DepthMode::kFaithful);
}

// Images and demands as they were latched are all that capture's bytes hang on: a second capture
// that is fed with them puts out the same, whatever happened on the road.
TEST(PictureLink, TheSameImagesAndDemandsGiveTheSameBytes) {
  for (const char* colour : {"jpeg", "h264"}) {
    if (colour == std::string("h264") && !drivers::h264_built_in()) continue;
    SCOPED_TRACE(colour);
    Road road("quiet", 1.5, on_demands(rt::FaultKind::kDrop, 0.2), colour);
    bool once = true;
    road.abandon = [&](std::uint64_t k) { return k > 40 && std::exchange(once, false); };
    road.run(1500);
    road.stalled = true;
    road.run(400);
    road.stalled = false;
    road.run(1500);
    EXPECT_EQ(road.refused(), 0U);
    expect_right(road, drivers::DepthMode::kQuiet);
    rt::Startup startup;
    picture_link::MovingCamera camera;
    tasks::RobotSetup setup;
    setup.camera = &camera;
    setup.hash_outputs = true;
    tasks::RobotCells cells(startup.token(), {}, true);
    tasks::CaptureNode node(startup.token(), road.config(), setup, cells);
    auto& demand = cells.of<tasks::EdgeId::kDemand>().cell;
    std::size_t coded = 0;
    for (const auto& job : road.jobs) {
      while (demand.latest_seq() < job.demand.number) {
        demand.begin_write() = job.demand.demand;
        demand.publish(job.demand.at);
      }
      rt::JobRecord record;
      node.latch(job.tick, record);
      (void)node.step(job.tick, record);
      if (job.abandoned)
        node.abandon(job.tick);
      else
        node.commit(job.tick, record);
      ASSERT_EQ(record.input_seq, job.input_seq) << "job " << job.tick.k;
      ASSERT_EQ(record.output_hash, job.output_hash) << "job " << job.tick.k;
      coded += record.output_hash != 0 ? 1 : 0;
    }
    EXPECT_GT(coded, 30U);
  }
}

TEST(PictureLink, WithoutColourNoneIsSent) {
  Road road("moving", 0, {}, "none");
  road.run(500);
  ASSERT_GT(road.seen.size(), 10U);
  for (const auto& s : road.seen) EXPECT_FALSE(s.colour);
  EXPECT_EQ(road.node->task().stats().colour_coded, 0U);
}

// Two boxes with different codecs say so and do not talk.
TEST(PictureLink, OtherCodecsOnTheOtherBoxAreRefusedByName) {
  rt::Startup startup;
  drivers::LinkEndpoint robot(startup.token(), rt::Box::kRobot),
      op(startup.token(), rt::Box::kOperator);
  drivers::PictureConfig quiet;
  quiet.depth_codec = "quiet";
  robot.speak(quiet.dialect());
  bool refused = false;
  robot.poll(rt::Time{}, true, [&](std::span<const std::uint8_t> m) {
    refused = refused || !op.receive(m, rt::Time{}, [](auto) {});
  });
  EXPECT_TRUE(refused);
  EXPECT_NE(op.fault().find("link.depth_codec"), std::string::npos) << op.fault();
}

}  // namespace
