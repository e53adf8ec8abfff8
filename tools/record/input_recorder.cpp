#include "tools/record/input_recorder.hpp"

#include <algorithm>
#include <atomic>
#include <filesystem>
#include <fstream>
#include <stdexcept>

#include "drivers/camera/frame_copy.hpp"
#include "tools/record/latched_inputs.hpp"

namespace teletact {

using tasks::TaskId;

namespace {

template <rt::Box B, class Cells>
Seqs published_in(const Cells& cells, int writer) noexcept {
  Seqs newest{};
  const auto note = [&]<std::size_t I>(std::integral_constant<std::size_t, I>) {
    constexpr auto id = static_cast<tasks::EdgeId>(I);
    constexpr tasks::EdgeRow row = tasks::kEdge<id>.row;
    constexpr tasks::EdgeEnd end = tasks::end_in(id, B);
    if constexpr (row.published != tasks::kUnlisted &&
                  (end == tasks::EdgeEnd::kBoth || end == tasks::EdgeEnd::kReads)) {
      if (writer_of(row) == writer)
        newest[static_cast<std::size_t>(row.published)] = cells.template newest<id>();
    }
  };
  [&]<std::size_t... I>(std::index_sequence<I...>) {
    (note(std::integral_constant<std::size_t, I>{}), ...);
  }
  (std::make_index_sequence<tasks::kEdgeCount>{});
  if (writer == kLinkWriter) return newest;
  const tasks::TaskRow& task = tasks::kTaskTable[static_cast<std::size_t>(writer)];
  if (task.watch.fault != 0) {
    newest[static_cast<std::size_t>(task.watch.published)] =
        cells.health[static_cast<std::size_t>(writer)]->latest_seq();
  }
  return newest;
}

}  // namespace

Seqs published(tasks::OperatorCells& cells, int writer) noexcept {
  return published_in<rt::Box::kOperator>(cells, writer);
}
Seqs published(tasks::RobotCells& cells, int writer) noexcept {
  return published_in<rt::Box::kRobot>(cells, writer);
}

// Keeps the newest sample for the job's own record: both happen in one latch.
class InputRecorder::HapticTap final : public drivers::HapticDevice {
 public:
  explicit HapticTap(drivers::HapticDevice& inner) : inner_(inner) {}
  [[nodiscard]] drivers::DeviceProperties properties() const noexcept override {
    return inner_.properties();
  }
  [[nodiscard]] bool sense(rt::Time now, drivers::StylusSample& out) noexcept override {
    const bool ok = inner_.sense(now, out);
    const auto buttons = static_cast<std::uint8_t>((out.button ? 1 : 0) | (out.clutch ? 2 : 0));
    newest = {out.seq,
              rt::ns_of(out.taken),
              {out.p_DH.x(), out.p_DH.y(), out.p_DH.z()},
              ok,
              buttons,
              static_cast<std::uint8_t>(out.state),
              out.repeated};
    return ok;
  }
  void act(rt::Time now, const drivers::ForceCommand& command) noexcept override {
    inner_.act(now, command);
  }
  void request_enable() noexcept override { inner_.request_enable(); }
  void make_safe() noexcept override { inner_.make_safe(); }
  StylusInput newest;

 private:
  drivers::HapticDevice& inner_;
};

class InputRecorder::BusTap final : public drivers::MotorBus {
 public:
  explicit BusTap(drivers::MotorBus& inner) : inner_(inner) {}
  [[nodiscard]] drivers::BusStatus sense(rt::Time now,
                                         drivers::MotorStates& states) noexcept override {
    const auto status = inner_.sense(now, states);
    newest.seq = states.seq;
    newest.taken_ns = rt::ns_of(states.taken);
    newest.wheel_rad = states.wheel_rad;
    newest.wheel_rad_per_s = states.wheel_rad_per_s;
    newest.current_A = states.current_A;
    newest.flags = states.flags;
    const bool of_write = status == drivers::BusStatus::kOk && sent_ != drivers::BusStatus::kOk;
    newest.put(status, sent_, of_write ? sent_detail_ : inner_.detail());
    return status;
  }
  [[nodiscard]] drivers::BusStatus act(rt::Time now,
                                       const drivers::MotorSetpoints& setpoints) noexcept override {
    const auto status = inner_.act(now, setpoints);
    sent_ = status;
    sent_detail_ = inner_.detail();
    return status;
  }
  [[nodiscard]] drivers::BusDetail detail() const noexcept override { return inner_.detail(); }
  void rearm() noexcept override { inner_.rearm(); }
  void make_safe() noexcept override { inner_.make_safe(); }
  MotorInput newest;

 private:
  drivers::MotorBus& inner_;
  drivers::BusStatus sent_ = drivers::BusStatus::kOk;
  drivers::BusDetail sent_detail_;
};

class InputRecorder::SafetyTap final : public drivers::SafetyIo {
 public:
  explicit SafetyTap(drivers::SafetyIo& inner) : inner_(inner) {}
  void sense(rt::Time now, drivers::SafetyInputs& out) noexcept override {
    inner_.sense(now, out);
    newest = drivers::to_byte(out);
  }
  void act(rt::Time now, const drivers::SafetyOutputs& out) noexcept override {
    inner_.act(now, out);
  }
  void make_safe() noexcept override { inner_.make_safe(); }
  void allow_again() noexcept override { inner_.allow_again(); }
  std::uint8_t newest = 0;

 private:
  drivers::SafetyIo& inner_;
};

// Frames are too large for a ring: they go through a few slots, handed to and fro by index.
class InputRecorder::CameraTap final : public drivers::Camera {
 public:
  static constexpr int kSlots = 24;  // 0.8 s at 30 Hz for the thread that writes
  explicit CameraTap(drivers::Camera& inner) : inner_(inner), slots_(kSlots) {
    for (int i = 0; i < kSlots; ++i) free_.try_push(i);
  }
  [[nodiscard]] perception::Intrinsics intrinsics() const noexcept override {
    return inner_.intrinsics();
  }
  [[nodiscard]] double rate_hz() const noexcept override { return inner_.rate_hz(); }
  [[nodiscard]] drivers::CameraStatus poll(rt::Time now,
                                           perception::RgbdFrame& out) noexcept override {
    const auto status = inner_.poll(now, out);
    newest.status = static_cast<std::uint8_t>(status);
    if (status != drivers::CameraStatus::kFrame) return status;
    int slot = -1;
    if (!free_.try_pop(slot)) {
      lost_.fetch_add(1, std::memory_order_relaxed);
      return status;
    }
    drivers::copy_frame(out, slots_[static_cast<std::size_t>(slot)]);
    filled_.try_push(slot);
    return status;
  }
  // Ordinary thread. Calls take(frame) for each new one, in order.
  template <class Take>
  void drain(Take&& take) {
    for (int slot = -1; filled_.try_pop(slot); free_.try_push(slot))
      take(slots_[static_cast<std::size_t>(slot)]);
  }
  [[nodiscard]] std::uint64_t lost() const noexcept { return lost_.load(); }
  CameraInput newest;

 private:
  drivers::Camera& inner_;
  std::vector<perception::RgbdFrame> slots_;
  rt::Ring<int, 32> free_, filled_;
  std::atomic<std::uint64_t> lost_{0};
};

class InputRecorder::Body final : public rt::TaskBody {
 public:
  Body(InputRecorder& owner, TaskId id, rt::TaskBody& inner)
      : owner_(owner), id_(id), inner_(inner) {}
  void latch(const rt::Tick& tick, rt::JobRecord& record) noexcept override {
    inner_.latch(tick, record);
    JobOp op = make(tick, JobOp::Kind::kLatch);
    op.at_ns = op.start_ns;
    op.seq = record.input_seq;
    owner_.sensed_(id_, op);
    ring.try_push(op);
  }
  rt::Health step(const rt::Tick& tick, rt::JobRecord& record) noexcept override {
    return inner_.step(tick, record);
  }
  void commit(const rt::Tick& tick, rt::JobRecord& record) noexcept override {
    inner_.commit(tick, record);
    end(tick, JobOp::Kind::kCommit, record.output_hash, record.end_ns);
  }
  void abandon(const rt::Tick& tick) noexcept override {
    inner_.abandon(tick);
    end(tick, JobOp::Kind::kAbandon, 0, 0);
  }
  void use(rt::ForkJoin& crew) noexcept override { inner_.use(crew); }
  void make_safe() noexcept override { inner_.make_safe(); }
  [[nodiscard]] std::int64_t twin_cpu_ns() const noexcept override { return inner_.twin_cpu_ns(); }

  OpRing ring;

 private:
  [[nodiscard]] JobOp make(const rt::Tick& tick, JobOp::Kind kind) const noexcept {
    JobOp op;
    op.k = tick.k;
    op.release_ns = rt::ns_of(tick.release);
    op.start_ns = rt::ns_of(tick.start);
    op.period_ns = tick.period.count();
    op.skipped = tick.skipped;
    op.task = static_cast<std::uint16_t>(id_);
    op.kind = kind;
    op.level = static_cast<std::uint8_t>(tick.level);
    return op;
  }
  void end(const rt::Tick& tick, JobOp::Kind kind, std::uint64_t hash, std::int64_t at) noexcept {
    if (!owner_.file_) return;
    JobOp op = make(tick, kind);
    op.at_ns = owner_.now_ ? rt::ns_of(owner_.now_()) : std::max(at, op.start_ns);
    op.put(Ended{hash, owner_.published_(static_cast<int>(id_))});
    ring.try_push(op);
  }
  InputRecorder& owner_;
  TaskId id_;
  rt::TaskBody& inner_;
};

InputRecorder::InputRecorder(rt::NonRealtime&, const std::string& path, const Keys& keys,
                             std::function<rt::Time()> now)
    : path_(path), now_(std::move(now)) {
  if (path.empty()) return;
  file_.reset(std::fopen(path.c_str(), "wb"));
  if (!file_) throw std::runtime_error(path + ": can not be written");
  std::fprintf(file_.get(), "teletact-inputs 11 %zu\n", sizeof(JobOp));
  for (const auto& [key, value] : keys)
    std::fprintf(file_.get(), "%s %s\n", key.c_str(), value.c_str());
  std::fprintf(file_.get(), "\n");
}

InputRecorder::~InputRecorder() = default;

void InputRecorder::wrap(BoxOptions& options) {
  options.wrap_device = [this](drivers::HapticDevice& device) {
    haptic_ = std::make_unique<HapticTap>(device);
    return haptic_.get();
  };
  options.wrap_bus = [this](drivers::MotorBus& bus) {
    bus_ = std::make_unique<BusTap>(bus);
    return bus_.get();
  };
  options.wrap_safety = [this](drivers::SafetyIo& io) {
    safety_ = std::make_unique<SafetyTap>(io);
    return safety_.get();
  };
  if (!file_) return;
  options.hash_outputs = true;
  options.wrap_camera = [this](drivers::Camera& camera) {
    camera_ = std::make_unique<CameraTap>(camera);
    return camera_.get();
  };
}

void InputRecorder::attach(drivers::LinkEndpoint& endpoint) {
  if (!file_) return;
  endpoint.set_tap([this](std::span<const std::uint8_t> message, rt::Time now, bool taken) {
    Message m;
    m.head = {rt::ns_of(now), static_cast<std::uint32_t>(message.size()), taken ? 1U : 0U,
              published_(kLinkWriter)};
    m.bytes.assign(message.begin(), message.end());
    const std::lock_guard lock(mutex_);
    if (!finished_) messages_.push_back(std::move(m));
  });
}

void InputRecorder::attach(tasks::OperatorGraph& graph, drivers::LinkEndpoint& endpoint) {
  auto& cells = graph.cells();
  published_ = [&cells](int writer) { return published(cells, writer); };
  sensed_ = [this, &graph, &cells](TaskId id, JobOp& op) {
    if (id == TaskId::kHaptic) {
      op.put(haptic_->newest);
    } else if (id == TaskId::kPlanning) {
      // In planning's own thread, so both of its counts rest.
      op.put(touch_input(cells.ring<tasks::EdgeId::kTouch, TaskId::kPlanning>().taken(),
                         graph.latched(id)));
    } else if (id == TaskId::kPrediction) {
      op.put(drive_input(graph.latched(id)));
    } else if (id == TaskId::kFusion) {
      op.put(scene_input(graph.latched(id)));
    } else {
      op.put(status_input(graph.latched(id)));
    }
  };
  attach(endpoint);
}

void InputRecorder::attach(tasks::RobotGraph& graph, drivers::LinkEndpoint& endpoint) {
  auto& cells = graph.cells();
  published_ = [&cells](int writer) { return published(cells, writer); };
  sensed_ = [this, &graph](TaskId id, JobOp& op) {
    if (id == TaskId::kRobotIo) {
      MotorInput in = bus_->newest;
      in.link_heard_ns = graph.latched(id).last_heard_ns;
      in.link_closed = graph.latched(id).closed;
      in.safety = safety_ ? safety_->newest : 0;
      op.put(in);
    } else if (id == TaskId::kCapture) {
      if (camera_) op.put(camera_input(camera_->newest.status, graph.latched_demand()));
    } else {
      op.put(status_input(graph.latched(id)));
    }
  };
  attach(endpoint);
}

rt::TaskBody& InputRecorder::body(TaskId id, rt::TaskBody& inner) {
  bodies_.push_back(std::make_unique<Body>(*this, id, inner));
  return *bodies_.back();
}

void InputRecorder::also(TakeOp take, TakeTally mark) {
  take_ = std::move(take);
  mark_ = std::move(mark);
}

void InputRecorder::write(char tag, const void* data, std::size_t size) {
  if (failed_) return;  // what came behind a torn record could not be read
  if (tag != 0 && std::fputc(tag, file_.get()) == EOF) failed_ = true;
  if (size > 0 && std::fwrite(data, size, 1, file_.get()) != 1) failed_ = true;
}

void InputRecorder::drain() {
  if (finished_) return;
  std::vector<Message> messages;
  {
    const std::lock_guard lock(mutex_);
    messages.swap(messages_);
  }
  for (const auto& m : messages) {
    write('M', &m.head, sizeof m.head);
    write(0, m.bytes.data(), m.bytes.size());
    ++tally_.messages;
  }
  if (camera_) {
    camera_->drain([this](const perception::RgbdFrame& f) {
      const FrameHead head{rt::ns_of(f.exposure), f.seq, f.intrinsics, f.has_colour ? 1U : 0U,
                           f.joints};
      const auto n = static_cast<std::size_t>(f.intrinsics.width) *
                     static_cast<std::size_t>(f.intrinsics.height);
      write('F', &head, sizeof head);
      write(0, f.depth_mm.data(), n * sizeof f.depth_mm[0]);
      if (f.has_colour) write(0, f.colour.data(), n * sizeof f.colour[0]);
      ++tally_.frames;
    });
  }
  for (auto& b : bodies_) {
    for (JobOp op; b->ring.try_pop(op);) {
      if (take_ && op.kind == JobOp::Kind::kLatch) take_(op);
      if (!file_) continue;
      write('O', &op, sizeof op);
      ++tally_.ops;
    }
  }
  if (file_ && mark_) mark_(tally_);
}

void InputRecorder::finish() {
  if (finished_) return;
  drain();
  {
    const std::lock_guard lock(mutex_);
    finished_ = true;
  }
  if (!file_) return;
  for (const auto& b : bodies_) tally_.lost += b->ring.dropped();
  if (camera_) tally_.lost += camera_->lost();
  write('E', &tally_, sizeof tally_);
  if (std::fflush(file_.get()) != 0) failed_ = true;
  if (failed_) throw std::runtime_error(problem());
}

std::string InputRecorder::problem() const {
  return failed_ ? path_ + ": only a part could be written (disk full?): the recording ends there"
                 : std::string();
}

std::string recording_file(const std::string& folder, rt::Box box) {
  return folder + (box == rt::Box::kOperator ? "/operator.inputs" : "/robot.inputs");
}

void save_setup(const std::string& folder, const Scene& scene, const std::string& fault_plan_file) {
  namespace fs = std::filesystem;
  fs::create_directories(folder);
  for (const char* old : {"/operator.inputs", "/robot.inputs", "/faults.toml"})
    fs::remove(folder + old);
  std::ofstream out(folder + "/scene.toml");
  out << config::effective(scene.schema);
  if (!out.flush()) throw std::runtime_error(folder + "/scene.toml: can not be written");
  if (!fault_plan_file.empty()) fs::copy_file(fault_plan_file, folder + "/faults.toml");
}

std::unique_ptr<InputRecorder> make_recorder(rt::NonRealtime& nrt, const std::string& folder,
                                             rt::Box box, const Scene& scene,
                                             const perception::Intrinsics& c,
                                             std::function<rt::Time()> now) {
  char camera[160];
  std::snprintf(camera, sizeof camera, "%.17g %.17g %.17g %.17g %d %d", c.fx, c.fy, c.cx, c.cy,
                c.width, c.height);
  const InputRecorder::Keys keys{{"box", box == rt::Box::kOperator ? "operator" : "robot"},
                                 {"camera", camera},
                                 {"images", scene.rgbd_dir.empty() ? "synthetic" : "recorded"}};
  return std::make_unique<InputRecorder>(nrt, recording_file(folder, box), keys, std::move(now));
}

}  // namespace teletact
