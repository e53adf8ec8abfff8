#include "tools/host/replay.hpp"

#include <cinttypes>
#include <cstdio>
#include <fstream>
#include <memory>
#include <sstream>

#include "drivers/camera/frame_copy.hpp"
#include "rt/clock/box_time.hpp"
#include "rt/hash.hpp"
#include "rt/memory/section.hpp"
#include "rt/sched/worker_pool.hpp"
#include "tools/host/console.hpp"
#include "tools/host/replay_feeds.hpp"
#include "tools/record/input_recorder.hpp"
#include "tools/scene/box_devices.hpp"

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
    out.button = (fed.buttons & 1U) != 0;
    out.clutch = (fed.buttons & 2U) != 0;
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

class FedSafety final : public drivers::SafetyIo {
 public:
  void sense(rt::Time, drivers::SafetyInputs& out) noexcept override {
    out = drivers::safety_inputs_of(fed);
  }
  void act(rt::Time, const drivers::SafetyOutputs&) noexcept override {}
  std::uint8_t fed = 0;
};

// Frames come from the file, one for each poll that had one; read when fed, so that a poll costs a
// copy as a driver's does.
class FedCamera final : public drivers::Camera {
 public:
  FedCamera(const Recording& recording, const perception::Intrinsics& camera)
      : recording_(recording),
        camera_(camera),
        in_(recording.path, std::ios::binary),
        frame_(std::make_unique<perception::RgbdFrame>()) {}
  [[nodiscard]] perception::Intrinsics intrinsics() const noexcept override { return camera_; }
  [[nodiscard]] double rate_hz() const noexcept override { return 30; }
  void feed(const CameraInput& input, rt::Hash64& inputs) {
    status_ = static_cast<drivers::CameraStatus>(input.status);
    inputs.word(input.status);
    if (status_ != drivers::CameraStatus::kFrame) return;
    FrameHead head;
    if (next_ >= recording_.frames.size()) {
      status_ = drivers::CameraStatus::kFault;
      return;
    }
    auto& f = *frame_;
    in_.seekg(static_cast<std::streamoff>(recording_.frames[next_++]));
    in_.read(reinterpret_cast<char*>(&head), sizeof head);
    f.exposure = rt::time_from_ns(head.exposure_ns);
    f.seq = head.seq;
    f.intrinsics = head.intrinsics;
    f.has_colour = head.has_colour != 0;
    f.joints = head.joints;
    const auto n = static_cast<std::streamsize>(head.intrinsics.width) * head.intrinsics.height;
    in_.read(reinterpret_cast<char*>(f.depth_mm.data()), n * 2);
    if (f.has_colour) in_.read(reinterpret_cast<char*>(f.colour.data()), n * 3);
    if (!in_) status_ = drivers::CameraStatus::kFault;
    inputs.word(f.seq);
    if (f.joints.count > 0) {
      inputs.bytes(f.joints.position.data(), sizeof f.joints.position);
      inputs.bytes(f.joints.speed.data(), sizeof f.joints.speed);
    }
    inputs.bytes(f.depth_mm.data(), static_cast<std::size_t>(n) * 2);
    if (f.has_colour) inputs.bytes(f.colour.data(), static_cast<std::size_t>(n) * 3);
  }
  [[nodiscard]] drivers::CameraStatus poll(rt::Time, perception::RgbdFrame& out) noexcept override {
    if (status_ == drivers::CameraStatus::kFrame) drivers::copy_frame(*frame_, out);
    return status_;
  }

 private:
  const Recording& recording_;
  perception::Intrinsics camera_;
  std::ifstream in_;
  std::unique_ptr<perception::RgbdFrame> frame_;
  drivers::CameraStatus status_{};
  std::size_t next_ = 0;
};

// A box and its feeds: what differs between the two boxes.
struct FedBox {
  std::function<void(TaskId, const JobOp&, rt::Hash64&)> feed;
  std::function<rt::TaskBody&(TaskId)> body;
  std::function<Seqs(int)> published;
  std::function<void(rt::Time)> console;  // empties what the tasks tell the console
  drivers::LinkEndpoint* endpoint = nullptr;
};

class Replayer {
 public:
  // With a trial: its levels, CPU measured, outputs not compared.
  Replayer(const Recording& recording, FedBox box, const Trial* trial)
      : r_(recording), box_(std::move(box)), trial_(trial) {
    if (trial != nullptr && trial->fusion_workers > 0)
      crew_ = std::make_unique<rt::InlineForkJoin>(trial->fusion_workers, true);
  }

  ReplayResult run(const std::vector<ReplayStep>& steps) {
    std::ifstream bytes(r_.path, std::ios::binary);
    for (const auto& s : steps) {
      if (trial_ != nullptr && !s.message) console(r_.ops[s.index].at_ns);
      if (s.message)
        message(s.index, bytes);
      else if (r_.ops[s.index].kind == JobOp::Kind::kLatch)
        latch(r_.ops[s.index]);
      else
        end(r_.ops[s.index]);
    }
    result_.inputs_hash = inputs_.digest();
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
  // As often as in a run; a full ring would make commits cheaper.
  void console(std::int64_t at_ns) {
    if (at_ns < next_console_ns_) return;
    next_console_ns_ = at_ns + 20'000'000;
    box_.console(rt::time_from_ns(at_ns));
  }
  static std::string job(const JobOp& op) {
    return std::string(tasks::kTaskTable[op.task].name) + " job " + std::to_string(op.k);
  }

  void message(std::uint32_t index, std::ifstream& bytes) {
    const auto& m = r_.messages[index];
    buffer_.resize(m.head.size);
    bytes.seekg(static_cast<std::streamoff>(m.offset));
    bytes.read(reinterpret_cast<char*>(buffer_.data()), m.head.size);
    inputs_.word(static_cast<std::uint64_t>(m.head.at_ns));
    inputs_.bytes(buffer_.data(), buffer_.size());
    // A run over several connections: each begins with a Hello.
    drivers::Header head;
    if (box_.endpoint->hello_ok() &&
        drivers::read_header(buffer_, head) == drivers::WireStatus::kOk &&
        head.id == drivers::MessageId::kHello)
      box_.endpoint->renew();
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
    const auto id = static_cast<TaskId>(op.task);
    const int level = trial_ != nullptr ? trial_->level(id, op.level) : op.level;
    Running& job_now = running_[op.task];
    job_now.record = rt::JobRecord{};
    job_now.record.k = op.k;
    job_now.record.task = op.task;
    job_now.record.level = static_cast<std::uint8_t>(level);
    job_now.tick = rt::Tick{op.k,
                            rt::time_from_ns(op.release_ns),
                            rt::time_from_ns(op.start_ns),
                            rt::Nanos{op.period_ns},
                            op.skipped,
                            level,
                            &job_now.cancel};
    job_now.same = true;
    box_.feed(id, op, inputs_);
    auto& body = box_.body(id);
    if (crew_ && id == TaskId::kFusion) {
      body.use(*crew_);
      crew_->begin_job();
    }
    const std::int64_t cpu0 = trial_ != nullptr ? rt::thread_cpu_ns() : 0;
    body.latch(job_now.tick, job_now.record);
    {
      const rt::Section section(true);
      (void)body.step(job_now.tick, job_now.record);
    }
    if (trial_ != nullptr) job_now.record.cpu_ns = rt::thread_cpu_ns() - cpu0;
    compare_latched(op, job_now);
  }

  void compare_latched(const JobOp& op, Running& job_now) {
    for (std::size_t i = 0; i < op.seq.size(); ++i) {
      if (job_now.record.input_seq[i] == op.seq[i]) continue;
      if (trial_ != nullptr && !from_link(op.task, i)) continue;
      job_now.same = false;
      differs(job(op) + ": input " + std::to_string(i) + " is number " +
              std::to_string(job_now.record.input_seq[i]) + ", recorded " +
              std::to_string(op.seq[i]));
    }
  }
  static bool from_link(int task, std::size_t input) {
    for (const auto& row : read_table()) {
      if (static_cast<int>(row.reader) != task || row.input != static_cast<int>(input)) continue;
      return row_of_cell(row.cell)->writer == kLinkWriter;
    }
    return false;
  }

  void end(const JobOp& op) {
    Running& job_now = running_[op.task];
    auto& body = box_.body(static_cast<TaskId>(op.task));
    if (op.kind == JobOp::Kind::kAbandon) {
      ++result_.abandoned;
      body.abandon(job_now.tick);
    } else {
      ++result_.jobs;
      const std::int64_t cpu0 = trial_ != nullptr ? rt::thread_cpu_ns() : 0;
      body.commit(job_now.tick, job_now.record);
      if (trial_ != nullptr) {
        job_now.record.cpu_ns += rt::thread_cpu_ns() - cpu0;
        if (crew_ && op.task == static_cast<int>(TaskId::kFusion)) take_shares(job_now.record);
        trial_->took(job_now.record);
      }
    }
    if (trial_ == nullptr) compare_ended(op, job_now);
    if (op.kind == JobOp::Kind::kCommit && job_now.same) ++result_.equal;
  }

  void take_shares(rt::JobRecord& fusion) {
    rt::JobRecord worker = fusion;
    worker.task = tasks::kTaskCount;
    worker.cpu_ns = crew_->largest_shares_ns();
    worker.work = 0;
    trial_->took(worker);
    for (int w = 0; w < trial_->fusion_workers; ++w) fusion.cpu_ns -= crew_->cpu_ns(w);
  }

  void compare_ended(const JobOp& op, Running& job_now) {
    const auto recorded = op.get<Ended>();
    if (op.kind == JobOp::Kind::kCommit && job_now.record.output_hash != recorded.output_hash) {
      job_now.same = false;
      char text[96];
      std::snprintf(text, sizeof text, ": output %016" PRIx64 ", recorded %016" PRIx64,
                    job_now.record.output_hash, recorded.output_hash);
      differs(job(op) + text);
    }
    if (box_.published(op.task) != recorded.published) {
      job_now.same = false;
      differs(job(op) + ": made other publications than recorded");
    }
  }

  const Recording& r_;
  FedBox box_;
  const Trial* trial_;
  std::unique_ptr<rt::InlineForkJoin> crew_;
  rt::Hash64 inputs_;
  std::int64_t next_console_ns_ = 0;
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
                             const Recording& recording, const std::vector<ReplayStep>& steps,
                             const Trial* trial) {
  std::unique_ptr<FedDevice> device;
  BoxOptions options = given;
  options.wrap_device = [&](drivers::HapticDevice& twin) {
    device = std::make_unique<FedDevice>(twin.properties());
    return device.get();
  };
  OperatorBox box(nrt, scene, camera_key(recording), options);
  auto& graph = box.graph();
  FedBox fed;
  OperatorConsole console(box, scene, {});
  console.leave_the_scene();  // its edits are recorded
  fed.console = [&](rt::Time now) { console.tick(now); };
  fed.feed = [&](TaskId id, const JobOp& op, rt::Hash64& inputs) {
    if (id == TaskId::kHaptic) {
      device->fed = op.get<StylusInput>();
      for (const double x : device->fed.p_DH) inputs.value(x);
      inputs.word(device->fed.seq << 2U | device->fed.buttons);
    } else if (id == TaskId::kFusion) {
      set_scene(graph, op.get<SceneInput>(), inputs);
    } else if (id == TaskId::kPlanning) {
      set_act(graph, op.get<TouchInput>(), inputs);
    } else if (id == TaskId::kPrediction) {
      set_words(graph.link(), graph.requests(), op.get<DriveInput>().status);
      set_drive(graph, op.get<DriveInput>(), inputs);
    } else if (id == TaskId::kSupervision) {
      set_words(graph.link(), graph.requests(), op.get<StatusInput>());
    }
  };
  fed.body = [&](TaskId id) -> rt::TaskBody& { return graph.body(id); };
  fed.published = [&](int writer) { return published(graph.cells(), writer); };
  fed.endpoint = &box.endpoint();
  ReplayResult result = Replayer(recording, std::move(fed), trial).run(steps);
  if (trial != nullptr && trial->fused) {
    console.tick(recording.ops.empty() ? rt::Time{} : rt::time_from_ns(recording.ops.back().at_ns));
    trial->fused(console.seen().fusion);
  }
  return result;
}

ReplayResult replay_robot(rt::NonRealtime& nrt, const Scene& scene, const BoxOptions& given,
                          const Recording& recording, const std::vector<ReplayStep>& steps,
                          const Trial* trial) {
  FedBus bus(recording);
  FedSafety safety;
  FedCamera camera(recording, camera_key(recording));
  BoxOptions options = given;
  options.wrap_bus = [&](drivers::MotorBus&) { return &bus; };
  options.wrap_safety = [&](drivers::SafetyIo&) { return &safety; };
  options.wrap_camera = [&](drivers::Camera&) { return &camera; };
  RobotBox box(nrt, scene, options);
  auto& graph = box.graph();
  FedBox fed;
  RobotConsole console(box);
  fed.console = [&](rt::Time now) { console.tick(now); };
  fed.feed = [&](TaskId id, const JobOp& op, rt::Hash64& inputs) {
    if (id == TaskId::kRobotIo) {
      const MotorInput& in = bus.feed();
      for (const double x : in.wheel_rad) inputs.value(x);
      for (const double x : in.wheel_rad_per_s) inputs.value(x);
      safety.fed = in.safety;
      if (safety.fed != 0) inputs.word(safety.fed);
      graph.link().last_heard_ns.store(in.link_heard_ns);
      graph.link().closed.store(in.link_closed != 0);
    } else if (id == TaskId::kCapture) {
      camera.feed(op.get<CameraInput>(), inputs);
      set_demand(graph, op.get<CameraInput>(), inputs);
    } else {
      set_words(graph.link(), graph.requests(), op.get<StatusInput>());
    }
  };
  fed.body = [&](TaskId id) -> rt::TaskBody& { return graph.body(id); };
  fed.published = [&](int writer) { return published(graph.cells(), writer); };
  fed.endpoint = &box.endpoint();
  return Replayer(recording, std::move(fed), trial).run(steps);
}

rt::Result<ReplayResult> replay_box(rt::NonRealtime& nrt, Scene& scene, const BoxOptions& options,
                                    const Recording& recording, std::uint64_t seed,
                                    const Trial* trial) {
  auto steps = replay_order(recording, seed);
  if (!steps) return rt::Error{steps.error()};
  if (!camera_key(recording).valid())
    return rt::Error{recording.path + ": no camera in its header"};
  const std::string box = recording.key("box");
  if (box == "operator") {
    // Where fusion starts depends on whether the camera rides on the robot, not on the images.
    scene.rgbd_dir = recording.key("images") == "recorded" ? "replayed" : "";
    return replay_operator(nrt, scene, options, recording, steps.value(), trial);
  }
  if (box == "robot") {
    scene.rgbd_dir.clear();
    return replay_robot(nrt, scene, options, recording, steps.value(), trial);
  }
  return rt::Error{recording.path + ": box is '" + box + "', allowed are operator, robot"};
}

}  // namespace

rt::Result<ReplayResult> replay(rt::NonRealtime& nrt, Scene& scene, const rt::FaultPlan& faults,
                                const Recording& recording, std::uint64_t seed) {
  BoxOptions options;
  options.hash_outputs = true;
  options.faults = faults;
  auto result = replay_box(nrt, scene, options, recording, seed, nullptr);
  if (!result) return result;
  ReplayResult& r = result.value();
  for (const auto& op : recording.ops) {
    if (op.kind == JobOp::Kind::kLatch) ++r.unfinished;
  }
  r.unfinished -= r.jobs + r.abandoned;
  return result;
}

rt::Result<ReplayResult> run_trial(rt::NonRealtime& nrt, Scene& scene, const Recording& recording,
                                   const Trial& trial) {
  return replay_box(nrt, scene, {}, recording, 0, &trial);
}

}  // namespace teletact
