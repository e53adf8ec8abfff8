// Both ends of the edges `frame` and `demand` with a road of this test's between them: camera,
// capture's node and link end of the robot's box, link end and decoder of the operator's. One
// clock, steps of a millisecond.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "drivers/link/shaper.hpp"
#include "rt/random.hpp"
#include "tasks/graph/capture_node.hpp"
#include "tasks/graph/picture_link.hpp"

namespace picture_link {

constexpr std::int64_t kMs = 1'000'000;
constexpr int kWidth = 96, kHeight = 64;

// 30 images a second, kept: a tilted plane that moves, noise, holes that come and go.
class MovingCamera final : public drivers::Camera {
 public:
  [[nodiscard]] perception::Intrinsics intrinsics() const noexcept override {
    return {90, 90, 47.5, 31.5, kWidth, kHeight};
  }
  [[nodiscard]] double rate_hz() const noexcept override { return 30; }
  [[nodiscard]] drivers::CameraStatus poll(rt::Time now,
                                           perception::RgbdFrame& out) noexcept override {
    ++seq_;
    out.seq = seq_;
    out.exposure = now;
    out.intrinsics = intrinsics();
    out.has_colour = true;
    auto& kept = images[seq_];
    kept.resize(kWidth * kHeight);
    for (std::size_t i = 0; i < kept.size(); ++i) {
      const auto u = static_cast<int>(i % kWidth), v = static_cast<int>(i / kWidth);
      const double mm = 900 + 4 * u + 2 * v + 200 * std::sin(0.05 * static_cast<double>(seq_)) +
                        random_.uniform(-3, 3);
      const bool hole = random_.uniform() < 0.03 || (u + static_cast<int>(seq_)) % 31 == 0;
      kept[i] = hole ? std::uint16_t{0} : static_cast<std::uint16_t>(mm);
      out.depth_mm[i] = kept[i];
      out.colour[i] = {static_cast<std::uint8_t>(2 * u + 1), static_cast<std::uint8_t>(3 * v + 1),
                       static_cast<std::uint8_t>(seq_ % 200 + 1)};
    }
    return drivers::CameraStatus::kFrame;
  }
  std::map<std::uint64_t, std::vector<std::uint16_t>> images;  // by frame number

 private:
  rt::Random random_{19, 2};
  std::uint64_t seq_ = 0;
};

struct Road {
  explicit Road(const std::string& depth_codec, double Mbit_per_s = 0,
                const rt::FaultPlan& faults = {}, const std::string& colour_codec = "jpeg")
      : shape_(make_shape(Mbit_per_s)),
        config_(make_config(depth_codec, colour_codec)),
        robot_cells(startup_.token(), faults, config_.capture.pictures.on_demand()),
        operator_cells(startup_.token(), faults,
                       [](tasks::EdgeId id) {
                         return id != tasks::EdgeId::kMesh && id != tasks::EdgeId::kSurface;
                       }),
        node(make_node()),
        robot_end(startup_.token(), rt::Box::kRobot),
        operator_end(startup_.token(), rt::Box::kOperator) {
    auto& nrt = startup_.token();
    tasks::send_pictures(robot_cells, asker, config_.capture.pictures, robot_end);
    tasks::receive_pictures(nrt, operator_cells, config_.capture, camera.intrinsics(),
                            operator_end);
    run(300);  // handshake and clocks; capture does not run yet
    capturing = true;
  }

  // What the road does with a message from the robot before it arrives; false: it is lost.
  std::function<bool(std::vector<std::uint8_t>&)> meddle;
  bool stalled = false;  // nothing gets through in either direction, and is not lost
  bool cut = false;      // what is sent is lost, and nobody is told
  bool capturing = false;

  void run(int ms) {
    for (int i = 0; i < ms; ++i) step();
  }
  [[nodiscard]] rt::Time now() const { return rt::time_from_ns(1'000'000 * kMs + ms_ * kMs); }

  struct Seen {
    std::uint64_t number = 0;
    std::int64_t age_ms = 0, at_ms = 0;
    int worst_mm = 0;  // of the depth, against what the camera gave
    bool holes_right = true, colour = false;
  };
  std::vector<Seen> seen;  // frames that were decoded, in order
  std::int64_t ms() const { return ms_; }
  [[nodiscard]] std::uint64_t encoded() const { return node->task().stats().frames; }
  [[nodiscard]] std::uint64_t arrived() const {
    return operator_end.stats().received[static_cast<std::size_t>(drivers::MessageId::kFrame)];
  }
  [[nodiscard]] std::uint64_t refused() const {
    return operator_end.stats().refused[static_cast<std::size_t>(drivers::MessageId::kFrame)];
  }
  [[nodiscard]] std::uint64_t handed_to_line() const {
    return robot_end.stats().sent[static_cast<std::size_t>(drivers::MessageId::kFrame)];
  }

  // What a recording of capture keeps, and what came of it.
  struct Job {
    rt::Tick tick;
    tasks::LatchedDemand demand;
    decltype(rt::JobRecord::input_seq) input_seq;
    std::uint64_t output_hash = 0;
    bool abandoned = false;
  };
  std::vector<Job> jobs;
  [[nodiscard]] const tasks::GraphConfig& config() const { return config_; }

 private:
  struct Packet {
    std::int64_t due = 0;
    std::vector<std::uint8_t> bytes;
  };
  static drivers::LinkShapeConfig make_shape(double Mbit_per_s) {
    drivers::LinkShapeConfig c;
    c.delay_ms = 20;
    c.rate_Mbit_per_s = Mbit_per_s;
    return c;
  }
  static tasks::GraphConfig make_config(const std::string& depth, const std::string& colour) {
    tasks::GraphConfig c;
    c.capture.pictures.depth_codec = depth;
    c.capture.pictures.colour_codec = colour;
    return c;
  }
  std::unique_ptr<tasks::CaptureNode> make_node() {
    tasks::RobotSetup setup;
    setup.camera = &camera;
    setup.hash_outputs = true;
    return std::make_unique<tasks::CaptureNode>(startup_.token(), config_, setup, robot_cells);
  }
  [[nodiscard]] std::int64_t ns() const { return rt::ns_of(now()); }

  void step() {
    ++ms_;
    const auto to_robot = [this](std::span<const std::uint8_t> m) { send(up_, up_shaper_, m); };
    const auto to_operator = [this](std::span<const std::uint8_t> m) {
      send(down_, down_shaper_, m);
    };
    if (!stalled) {
      deliver(down_, operator_end, to_robot, true);
      deliver(up_, robot_end, to_operator, false);
    }
    look();
    const rt::Nanos busy = stalled ? rt::Nanos::max() : down_shaper_.busy_for(ns());
    robot_end.poll(now(), busy.count() == 0, to_operator, busy);
    operator_end.poll(now(), true, to_robot);
    if (capturing && ms_ * 30 / 1000 != (ms_ - 1) * 30 / 1000) capture();
  }
  void send(std::deque<Packet>& queue, drivers::LinkShaper& shaper,
            std::span<const std::uint8_t> m) {
    const std::int64_t due = shaper.deliver_at(ns(), m.size());
    if (!cut) queue.push_back({due, {m.begin(), m.end()}});
  }
  template <class Back>
  void deliver(std::deque<Packet>& queue, drivers::LinkEndpoint& end, const Back& back, bool down) {
    while (!queue.empty() && queue.front().due <= ns()) {
      Packet p = std::move(queue.front());
      queue.pop_front();
      if (cut || (down && meddle && !meddle(p.bytes))) continue;
      ASSERT_TRUE(end.receive(p.bytes, now(), back)) << end.fault();
      if (down) look();
    }
  }
  // Each frame as soon as it is there.
  void look() {
    const auto view = operator_cells.read<tasks::EdgeId::kFrame, tasks::TaskId::kFusion>();
    if (!view || view.seq == last_view_) return;
    last_view_ = view.seq;
    Seen s;
    s.number = view->seq;
    s.at_ms = ms_;
    s.age_ms = (ns() - rt::ns_of(view->exposure)) / kMs;
    s.colour = view->has_colour;
    const auto& truth = camera.images.at(view->seq);
    for (std::size_t i = 0; i < truth.size(); ++i) {
      if ((truth[i] == 0) != (view->depth_mm[i] == 0)) s.holes_right = false;
      s.worst_mm = std::max(s.worst_mm, std::abs(truth[i] - view->depth_mm[i]));
    }
    seen.push_back(s);
  }
  void capture() {
    rt::Tick tick;
    tick.k = ++k_;
    tick.release = tick.start = now();
    tick.period = rt::Nanos{33'333'333};
    rt::JobRecord record;
    node->latch(tick, record);
    last_health = node->step(tick, record);
    const bool abandoned = abandon && abandon(k_);
    if (abandoned)
      node->abandon(tick);
    else
      node->commit(tick, record);
    jobs.push_back({tick, node->latched(), record.input_seq, record.output_hash, abandoned});
  }

  rt::Startup startup_;
  drivers::LinkShapeConfig shape_;
  tasks::GraphConfig config_;
  std::int64_t ms_ = 0;
  std::uint64_t k_ = 0, last_view_ = 0;
  std::deque<Packet> up_, down_;
  drivers::LinkShaper up_shaper_{shape_, 0}, down_shaper_{shape_, 1};

 public:
  MovingCamera camera;
  drivers::FrameAsker asker;
  tasks::RobotCells robot_cells;
  tasks::EdgeCells<rt::Box::kOperator> operator_cells;
  std::unique_ptr<tasks::CaptureNode> node;
  drivers::LinkEndpoint robot_end, operator_end;
  rt::Health last_health;
  std::function<bool(std::uint64_t)> abandon;  // this job is
};

}  // namespace picture_link
