#include "tools/teletact/replay.hpp"

#include <cinttypes>
#include <cstdio>
#include <fstream>
#include <sstream>

#include "rt/memory/section.hpp"
#include "tools/teletact/boxes.hpp"
#include "tools/teletact/input_recorder.hpp"

namespace teletact {

namespace {

using tasks::TaskId;

class FedDevice final : public drivers::HapticDevice {
 public:
  explicit FedDevice(const drivers::DeviceProperties& properties) : properties_(properties) {}
  [[nodiscard]] drivers::DeviceProperties properties() const noexcept override {
    return properties_;
  }
  [[nodiscard]] bool sense(rt::Time, drivers::StylusSample& out) noexcept override {
    if (fed.ok == 0) return false;
    out.seq = fed.seq;
    out.taken = rt::time_from_ns(fed.taken_ns);
    out.p_DH = {fed.p_DH[0], fed.p_DH[1], fed.p_DH[2]};
    out.button = fed.button != 0;
    out.state = static_cast<drivers::DeviceState>(fed.state);
    out.repeated = fed.repeated != 0;
    return true;
  }
  void act(rt::Time, const drivers::ForceCommand&) noexcept override {}
  void make_safe() noexcept override {}
  StylusInput fed;

 private:
  drivers::DeviceProperties properties_;
};

class FedBus final : public drivers::MotorBus {
 public:
  [[nodiscard]] drivers::BusStatus exchange(rt::Time, const drivers::MotorSetpoints&,
                                            drivers::MotorStates& states) noexcept override {
    const auto status = static_cast<drivers::BusStatus>(fed.status);
    if (status != drivers::BusStatus::kOk) return status;
    states.seq = fed.seq;
    states.taken = rt::time_from_ns(fed.taken_ns);
    states.wheel_rad = fed.wheel_rad;
    states.wheel_rad_per_s = fed.wheel_rad_per_s;
    states.current_A = fed.current_A;
    states.flags = fed.flags;
    return status;
  }
  void make_safe() noexcept override {}
  MotorInput fed;
};

// Frames come from the file, one for each poll that had one.
class FedCamera final : public drivers::Camera {
 public:
  FedCamera(const Recording& recording, const perception::Intrinsics& camera)
      : recording_(recording), camera_(camera), in_(recording.path, std::ios::binary) {}
  [[nodiscard]] perception::Intrinsics intrinsics() const noexcept override { return camera_; }
  [[nodiscard]] double rate_hz() const noexcept override { return 30; }
  [[nodiscard]] drivers::CameraStatus poll(rt::Time, perception::RgbdFrame& out) noexcept override {
    const auto status = static_cast<drivers::CameraStatus>(fed.status);
    if (status != drivers::CameraStatus::kFrame) return status;
    FrameHead head;
    if (next_ >= recording_.frames.size()) return drivers::CameraStatus::kFault;
    in_.seekg(static_cast<std::streamoff>(recording_.frames[next_++]));
    in_.read(reinterpret_cast<char*>(&head), sizeof head);
    out.exposure = rt::time_from_ns(head.exposure_ns);
    out.seq = head.seq;
    out.intrinsics = head.intrinsics;
    out.has_colour = head.has_colour != 0;
    const auto n = static_cast<std::streamsize>(head.intrinsics.width) * head.intrinsics.height;
    in_.read(reinterpret_cast<char*>(out.depth_mm.data()), n * 2);
    if (out.has_colour) in_.read(reinterpret_cast<char*>(out.colour.data()), n * 3);
    return in_ ? status : drivers::CameraStatus::kFault;
  }
  CameraInput fed;

 private:
  const Recording& recording_;
  perception::Intrinsics camera_;
  std::ifstream in_;
  std::size_t next_ = 0;
};

// The shared words as the latch that comes next is to find them.
void set_words(tasks::LinkStatus& link, tasks::OperatorRequests& requests, const StatusInput& s) {
  link.last_heard_ns.store(s.last_heard_ns);
  link.round_trip_ns.store(s.round_trip_ns);
  link.uncertainty_ns.store(s.uncertainty_ns);
  link.refused.store(s.refused != 0);
  link.expected.store(s.expected != 0);
  link.closed.store(s.closed != 0);
  requests.engage.store(s.engage);
  requests.ramp_down.store(s.ramp_down != 0);
  requests.stop.store(s.stop != 0);
  requests.clear.store(s.clear != 0);
  requests.watchdog_bit.store(s.watchdog_bit != 0);
}

// A box and its feeds: what differs between the two boxes.
struct FedBox {
  std::function<void(TaskId, const JobOp&)> feed;
  std::function<rt::TaskBody&(TaskId)> body;
  std::function<Seqs(int)> published;
  drivers::LinkEndpoint* endpoint = nullptr;
};

class Replayer {
 public:
  Replayer(const Recording& recording, FedBox box) : r_(recording), box_(std::move(box)) {}

  ReplayResult run(const std::vector<ReplayStep>& steps) {
    std::ifstream bytes(r_.path, std::ios::binary);
    for (const auto& s : steps) {
      if (s.message)
        message(s.index, bytes);
      else if (r_.ops[s.index].kind == JobOp::Kind::kLatch)
        latch(r_.ops[s.index]);
      else
        end(r_.ops[s.index]);
    }
    return result_;
  }

 private:
  struct Running {
    rt::Tick tick;
    rt::JobRecord record;
    rt::CancelToken cancel;
    bool same = true;
  };

  void differs(const std::string& what) {
    if (result_.first_difference.empty()) result_.first_difference = what;
  }
  static std::string job(const JobOp& op) {
    return std::string(tasks::kTaskTable[op.task].name) + " job " + std::to_string(op.k);
  }

  void message(std::uint32_t index, std::ifstream& bytes) {
    const auto& m = r_.messages[index];
    buffer_.resize(m.head.size);
    bytes.seekg(static_cast<std::streamoff>(m.offset));
    bytes.read(reinterpret_cast<char*>(buffer_.data()), m.head.size);
    const bool taken = box_.endpoint->receive(buffer_, rt::time_from_ns(m.head.at_ns),
                                              [](std::span<const std::uint8_t>) {});
    ++result_.messages;
    const std::string who =
        "message " + std::to_string(index) + " (" + std::to_string(m.head.size) + " bytes)";
    if (taken != (m.head.taken != 0))
      differs(who +
              (taken ? ": accepted, recorded as refused" : ": refused, recorded as accepted: ") +
              (taken ? "" : box_.endpoint->fault()));
    else if (box_.published(kLinkWriter) != m.head.published)
      differs(who + ": made other publications than recorded");
  }

  void latch(const JobOp& op) {
    Running& job_now = running_[op.task];
    job_now.record = rt::JobRecord{};
    job_now.record.k = op.k;
    job_now.record.task = op.task;
    job_now.record.level = op.level;
    job_now.tick = rt::Tick{op.k,
                            rt::time_from_ns(op.release_ns),
                            rt::time_from_ns(op.start_ns),
                            rt::Nanos{op.period_ns},
                            op.skipped,
                            op.level,
                            &job_now.cancel};
    job_now.same = true;
    const auto id = static_cast<TaskId>(op.task);
    box_.feed(id, op);
    auto& body = box_.body(id);
    body.latch(job_now.tick, job_now.record);
    for (std::size_t i = 0; i < op.seq.size(); ++i) {
      if (job_now.record.input_seq[i] == op.seq[i]) continue;
      job_now.same = false;
      differs(job(op) + ": input " + std::to_string(i) + " is number " +
              std::to_string(job_now.record.input_seq[i]) + ", recorded " +
              std::to_string(op.seq[i]));
    }
    const rt::Section section(true);
    (void)body.step(job_now.tick, job_now.record);
  }

  void end(const JobOp& op) {
    Running& job_now = running_[op.task];
    auto& body = box_.body(static_cast<TaskId>(op.task));
    const auto recorded = op.get<Ended>();
    if (op.kind == JobOp::Kind::kAbandon) {
      ++result_.abandoned;
      body.abandon(job_now.tick);
    } else {
      ++result_.jobs;
      body.commit(job_now.tick, job_now.record);
      if (job_now.record.output_hash != recorded.output_hash) {
        job_now.same = false;
        char text[96];
        std::snprintf(text, sizeof text, ": output %016" PRIx64 ", recorded %016" PRIx64,
                      job_now.record.output_hash, recorded.output_hash);
        differs(job(op) + text);
      }
    }
    if (box_.published(op.task) != recorded.published) {
      job_now.same = false;
      differs(job(op) + ": made other publications than recorded");
    }
    if (op.kind == JobOp::Kind::kCommit && job_now.same) ++result_.equal;
  }

  const Recording& r_;
  FedBox box_;
  std::array<Running, tasks::kTaskCount> running_;
  std::vector<std::uint8_t> buffer_;
  ReplayResult result_;
};

perception::Intrinsics camera_key(const Recording& r) {
  perception::Intrinsics c;
  std::istringstream(r.key("camera")) >> c.fx >> c.fy >> c.cx >> c.cy >> c.width >> c.height;
  return c;
}

ReplayResult replay_operator(rt::NonRealtime& nrt, const Scene& scene, const BoxOptions& given,
                             const Recording& recording, const std::vector<ReplayStep>& steps) {
  std::unique_ptr<FedDevice> device;
  BoxOptions options = given;
  options.wrap_device = [&](drivers::HapticDevice& twin) {
    device = std::make_unique<FedDevice>(twin.properties());
    return device.get();
  };
  OperatorBox box(nrt, scene, camera_key(recording), options);
  auto& graph = box.graph();
  FedBox fed;
  fed.feed = [&](TaskId id, const JobOp& op) {
    if (id == TaskId::kHaptic)
      device->fed = op.get<StylusInput>();
    else if (id == TaskId::kPrediction || id == TaskId::kSupervision)
      set_words(graph.link(), graph.requests(), op.get<StatusInput>());
  };
  fed.body = [&](TaskId id) -> rt::TaskBody& { return graph.body(id); };
  fed.published = [&](int writer) { return published(graph.cells(), writer); };
  fed.endpoint = &box.endpoint();
  return Replayer(recording, std::move(fed)).run(steps);
}

ReplayResult replay_robot(rt::NonRealtime& nrt, const Scene& scene, const BoxOptions& given,
                          const Recording& recording, const std::vector<ReplayStep>& steps) {
  FedBus bus;
  FedCamera camera(recording, camera_key(recording));
  BoxOptions options = given;
  options.wrap_bus = [&](drivers::MotorBus&) { return &bus; };
  options.wrap_camera = [&](drivers::Camera&) { return &camera; };
  RobotBox box(nrt, scene, options);
  auto& graph = box.graph();
  FedBox fed;
  fed.feed = [&](TaskId id, const JobOp& op) {
    if (id == TaskId::kRobotIo) {
      bus.fed = op.get<MotorInput>();
      graph.link().last_heard_ns.store(bus.fed.link_heard_ns);
      graph.link().closed.store(bus.fed.link_closed != 0);
    } else if (id == TaskId::kCapture) {
      camera.fed = op.get<CameraInput>();
    } else {
      set_words(graph.link(), graph.requests(), op.get<StatusInput>());
    }
  };
  fed.body = [&](TaskId id) -> rt::TaskBody& { return graph.body(id); };
  fed.published = [&](int writer) { return published(graph.cells(), writer); };
  fed.endpoint = &box.endpoint();
  return Replayer(recording, std::move(fed)).run(steps);
}

}  // namespace

rt::Result<ReplayResult> replay(rt::NonRealtime& nrt, Scene& scene, const rt::FaultPlan& faults,
                                const Recording& recording, std::uint64_t seed) {
  auto steps = replay_order(recording, seed);
  if (!steps) return rt::Error{steps.error()};
  if (!camera_key(recording).valid())
    return rt::Error{recording.path + ": no camera in its header"};
  const std::string box = recording.key("box");
  BoxOptions options;
  options.hash_outputs = true;
  options.faults = faults;
  ReplayResult result;
  if (box == "operator") {
    // Where fusion starts depends on whether the camera rides on the robot, not on the images.
    scene.rgbd_dir = recording.key("images") == "recorded" ? "replayed" : "";
    result = replay_operator(nrt, scene, options, recording, steps.value());
  } else if (box == "robot") {
    scene.rgbd_dir.clear();
    result = replay_robot(nrt, scene, options, recording, steps.value());
  } else {
    return rt::Error{recording.path + ": box is '" + box + "', allowed are operator, robot"};
  }
  for (const auto& op : recording.ops) {
    if (op.kind == JobOp::Kind::kLatch) ++result.unfinished;
  }
  result.unfinished -= result.jobs + result.abandoned;
  return result;
}

}  // namespace teletact
