// The recording of one box: everything that came into its tasks from outside, and what each job
// committed. Enough to run the tasks again, bit for bit, whatever the timing was.
//
// From outside come: messages on the link (whole, with the local instant of their arrival, so that
// the endpoint's clock measurement comes out the same), sensed data (stylus, motor states, camera
// frames), and the values of shared words that a latch took (LinkStatus, OperatorRequests).
// Everything else a job uses another task of the box published; its sequence number says which one.
//
// File, of this machine's layout, read by the build that wrote it:
//   text   "teletact-inputs 11 <sizeof JobOp>", one "key value" a line, an empty line
//   'O' JobOp          the latch or the end of a job; in order within a task
//   'M' MessageHead, bytes     a message as it arrived on the link, in order
//   'F' FrameHead, depth, colour    a camera frame as its driver gave it, in order
//   'E' Tally          the end; without it the recording is not whole
#pragma once

#include <array>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <type_traits>
#include <vector>

#include "drivers/youbot/motor_bus.hpp"
#include "perception/geometry/rgbd_frame.hpp"
#include "rt/result.hpp"
#include "tasks/contract/table.hpp"

namespace teletact {

// What one party publishes and another task of the same box latches: the edges, then the tasks'
// health. Which they are, who writes and who reads them follows from the rows of
// tasks/contract/table.hpp.
inline constexpr int kCells = tasks::kEdgeCount + tasks::kTaskCount;
[[nodiscard]] constexpr int cell_of(tasks::EdgeId id) noexcept { return static_cast<int>(id); }
[[nodiscard]] constexpr int health_of(tasks::TaskId id) noexcept {
  return tasks::kEdgeCount + static_cast<int>(id);
}
inline constexpr int kLinkWriter = tasks::kTaskCount;  // beside the task ids

using Seqs = std::array<std::uint64_t, 6>;

struct CellRow {
  int cell;
  std::string name;
  int writer;  // task id or kLinkWriter
  int slot;    // in the writer's Seqs
};
// A latch of `reader` used value JobOp::seq[input] of `cell`.
struct ReadRow {
  tasks::TaskId reader;
  int input;
  int cell;
  bool may_not_ask;  // 0 after the first value means: this job did not look
};

[[nodiscard]] std::span<const CellRow> cell_table();
[[nodiscard]] std::span<const ReadRow> read_table();
// Task id or kLinkWriter: who fills the edge's cell in the box of its readers.
[[nodiscard]] constexpr int writer_of(const tasks::EdgeRow& row) noexcept {
  return row.kind == tasks::EdgeKind::kRemote ? kLinkWriter : static_cast<int>(row.from);
}
// Its row; null: no task reads it.
[[nodiscard]] const CellRow* row_of_cell(int cell);

// Sensed data of one job, by task.
struct StylusInput {  // haptic
  std::uint64_t seq = 0;
  std::int64_t taken_ns = 0;
  std::array<double, 3> p_DH{};
  std::uint8_t ok = 0, buttons = 0, state = 0, repeated = 0;  // buttons: 1 mark, 2 clutch
};
struct MotorInput {  // robot_io
  std::uint64_t seq = 0;
  std::int64_t taken_ns = 0;
  std::array<double, 4> wheel_rad{}, wheel_rad_per_s{}, current_A{};
  std::array<std::uint32_t, 4> flags{};
  std::int64_t link_heard_ns = 0;
  std::uint8_t halves = 0;  // status of the read; of the write before it, times 16
  std::uint8_t link_closed = 0;
  std::uint8_t safety = 0;  // drivers::to_byte(SafetyInputs); 0: none are fitted
  // drivers::BusDetail of the read; of a good one, of the write before it.
  std::uint8_t trouble = 0, slave = 0, al_state = 0;
  std::uint16_t al_code = 0;
  [[nodiscard]] drivers::BusStatus status() const noexcept {
    return static_cast<drivers::BusStatus>(halves & 15U);
  }
  [[nodiscard]] drivers::BusStatus sent() const noexcept {
    return static_cast<drivers::BusStatus>(halves >> 4U);
  }
  void put(drivers::BusStatus read, drivers::BusStatus write,
           const drivers::BusDetail& d) noexcept {
    halves =
        static_cast<std::uint8_t>(static_cast<unsigned>(read) | static_cast<unsigned>(write) << 4U);
    trouble = static_cast<std::uint8_t>(d.trouble);
    slave = static_cast<std::uint8_t>(d.slave);
    al_state = static_cast<std::uint8_t>(d.al_state);
    al_code = d.al_code;
  }
  [[nodiscard]] drivers::BusDetail detail() const noexcept {
    return {static_cast<drivers::BusTrouble>(trouble), slave, al_state, al_code};
  }
};
struct TouchInput {         // planning
  std::uint64_t taken = 0;  // events taken off the ring since the start
  std::uint8_t full = 0;    // it took all it had room for; there may have been more
  std::uint8_t acted = 0;   // it took an act of the operator off its ring: the fields below
  std::uint8_t kind = 0, turns = 0;
  std::uint64_t seq = 0;
  std::int64_t stamp_ns = 0;
  std::array<double, 3> p_W{}, normal_W{};
  double yaw_rad = 0;
};
struct StatusInput {  // prediction and both supervisions
  std::int64_t last_heard_ns = 0, round_trip_ns = 0, uncertainty_ns = 0;
  std::uint64_t session = 0;
  std::int32_t engage = 0;
  std::uint8_t refused = 0, expected = 0, closed = 0, ramp_down = 0, stop = 0, clear = 0,
               watchdog_bit = 0;
};
struct DriveInput {  // prediction: the words above, and what it took of the edge `drive`
  StatusInput status;
  std::uint64_t number = 0, seq = 0;  // number 0: nothing yet
  std::int64_t stamp_ns = 0, published_ns = 0;
  double vx = 0, vy = 0, wz = 0;
  std::uint8_t held = 0;
};
struct SceneInput {  // fusion
  std::uint64_t mesh_taken = 0, seq = 0;
  std::int64_t stamp_ns = 0;
  std::array<double, 3> centre_W{}, half_m{};
  double yaw_rad = 0;
  std::uint16_t id = 0;
  std::uint8_t kind = 0, taken = 0;  // taken: it took an edit off the ring
};
struct CameraInput {  // capture
  std::uint8_t status = 0;
  // What it took of the edge `demand`; number 0: nothing yet, or there is no such edge.
  std::uint8_t coarser = 0, key = 0;
  std::uint32_t rate_kbit_per_s = 0;
  std::uint64_t number = 0, seq = 0;
  std::int64_t made_ns = 0, published_ns = 0;
};

// End of a job.
struct Ended {
  std::uint64_t output_hash = 0;  // of what was committed
  Seqs published{};               // newest value of each cell that its task writes
};

// `part` holds the sensed data of a latch (the struct of its task, or StatusInput) or an Ended.
struct JobOp {
  enum class Kind : std::uint8_t { kLatch = 1, kCommit = 2, kAbandon = 3 };
  std::uint64_t k = 0;
  std::int64_t at_ns = 0;  // when it happened, box clock; orders what nothing else orders
  // Latch.
  std::int64_t release_ns = 0, start_ns = 0, period_ns = 0;
  std::array<std::uint64_t, 8> seq{};  // of the inputs, as in the job's record
  std::uint32_t skipped = 0;
  std::uint16_t task = 0;
  Kind kind = Kind::kLatch;
  std::uint8_t level = 0;

  template <class T>
  void put(const T& v) noexcept {
    static_assert(std::is_trivially_copyable_v<T>);
    static_assert(sizeof(T) <= sizeof(part_));
    std::memcpy(part_.data(), &v, sizeof v);
  }
  template <class T>
  [[nodiscard]] T get() const noexcept {
    T v;
    std::memcpy(&v, part_.data(), sizeof v);
    return v;
  }

 private:
  std::array<std::byte, 144> part_{};
};
static_assert(sizeof(JobOp) <= 256, "travels by Ring");

struct MessageHead {
  std::int64_t at_ns = 0;  // local arrival
  std::uint32_t size = 0;
  std::uint32_t taken = 0;  // the endpoint accepted it
  Seqs published{};
};
struct FrameHead {
  std::int64_t exposure_ns = 0;
  std::uint64_t seq = 0;
  perception::Intrinsics intrinsics;
  std::uint64_t has_colour = 0;
  perception::JointAngles joints;
};
struct Tally {
  std::uint64_t ops = 0, messages = 0, frames = 0, lost = 0;
};

// Where a message or a frame lies in the file.
struct MessageAt {
  MessageHead head;
  std::uint64_t offset = 0;
};

struct Recording {
  std::string path;
  std::vector<std::pair<std::string, std::string>> keys;
  std::vector<JobOp> ops;
  std::vector<MessageAt> messages;
  std::vector<std::uint64_t> frames;  // offsets of the heads

  [[nodiscard]] std::string key(std::string_view name) const;  // empty: not there
};

// Refused, with one message: not a recording, torn, or one that lost something on the way.
[[nodiscard]] rt::Result<Recording> read_recording(const std::string& path);

}  // namespace teletact
