// Records what comes into one box (input_record.hpp). Each task's body, and the device it drives,
// get a wrapper that copies into a ring of its own: two copies of 256 bytes a job, nothing inside
// step(). An ordinary thread calls drain() now and then and writes the file. A full ring loses the
// record, and the recording then says that it is not whole.
//
// Without a file it only tells a black box what the jobs latched: no images, no message bodies, no
// output hashes.
#pragma once

#include <cstdio>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "rt/channel/ring.hpp"
#include "rt/sched/task.hpp"
#include "tools/record/input_record.hpp"
#include "tools/scene/box_devices.hpp"

namespace teletact {

// Newest values of the cells that a party writes, in the slots of cell_table().
[[nodiscard]] Seqs published(tasks::OperatorCells& cells, int writer) noexcept;
[[nodiscard]] Seqs published(tasks::RobotCells& cells, int writer) noexcept;

class InputRecorder {
 public:
  using Keys = std::vector<std::pair<std::string, std::string>>;
  // `now`: box clock, for what the job's record does not know; empty on the virtual clock.
  // `path` empty: no file. Throws std::runtime_error naming the file.
  InputRecorder(rt::NonRealtime&, const std::string& path, const Keys& keys,
                std::function<rt::Time()> now = {});
  ~InputRecorder();
  InputRecorder(const InputRecorder&) = delete;
  InputRecorder& operator=(const InputRecorder&) = delete;

  // Before the box is made: puts a tap between each task and its device, and hashes outputs.
  void wrap(BoxOptions& options);
  // Once the graph stands; before the first message.
  void attach(tasks::OperatorGraph& graph, drivers::LinkEndpoint& endpoint);
  void attach(tasks::RobotGraph& graph, drivers::LinkEndpoint& endpoint);
  // What stands between the executor and a task.
  [[nodiscard]] rt::TaskBody& body(tasks::TaskId id, rt::TaskBody& inner);

  // From now on drain() hands each latch to `take`, and, with a file, how far it has come to
  // `mark`.
  using TakeOp = std::function<void(const JobOp&)>;
  using TakeTally = std::function<void(const Tally&)>;
  void also(TakeOp take, TakeTally mark);

  void drain();  // ordinary thread
  // Drains and writes the end; after it nothing is recorded. Throws std::runtime_error, problem().
  void finish();
  // One line once the disk refused a record, and nothing more is written; empty until then. By the
  // thread that drains.
  [[nodiscard]] std::string problem() const;

 private:
  class Body;
  class HapticTap;
  class BusTap;
  class SafetyTap;
  class CameraTap;
  using OpRing = rt::Ring<JobOp, 4096>;
  struct Message {
    MessageHead head;
    std::vector<std::uint8_t> bytes;
  };
  struct Close {
    void operator()(std::FILE* f) const noexcept { std::fclose(f); }
  };
  void attach(drivers::LinkEndpoint& endpoint);
  void write(char tag, const void* data, std::size_t size);

  std::string path_;
  std::unique_ptr<std::FILE, Close> file_;
  std::function<rt::Time()> now_;
  std::function<Seqs(int)> published_;
  std::function<void(tasks::TaskId, JobOp&)> sensed_;
  std::unique_ptr<HapticTap> haptic_;
  std::unique_ptr<BusTap> bus_;
  std::unique_ptr<SafetyTap> safety_;
  std::unique_ptr<CameraTap> camera_;
  std::vector<std::unique_ptr<Body>> bodies_;
  std::mutex mutex_;  // link thread and ordinary threads only
  std::vector<Message> messages_;
  Tally tally_;
  TakeOp take_;
  TakeTally mark_;
  bool failed_ = false, finished_ = false;
};

// Recordings of a run: <folder>/operator.inputs, robot.inputs, and beside them what the boxes were
// built from: scene.toml (in effect) and, with a fault plan, faults.toml. An earlier recording
// goes.
void save_setup(const std::string& folder, const Scene& scene, const std::string& fault_plan_file);
[[nodiscard]] std::string recording_file(const std::string& folder, rt::Box box);
[[nodiscard]] std::unique_ptr<InputRecorder> make_recorder(rt::NonRealtime&,
                                                           const std::string& folder, rt::Box box,
                                                           const Scene& scene,
                                                           const perception::Intrinsics& camera,
                                                           std::function<rt::Time()> now = {});

}  // namespace teletact
