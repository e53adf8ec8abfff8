#include "tools/record/input_record.hpp"

#include <fstream>
#include <sstream>

namespace teletact {

namespace {

using tasks::TaskId;
constexpr int of(TaskId id) { return static_cast<int>(id); }

constexpr std::array<CellRow, kCells> kCellTable{{
    {Cell::kFrame, "frame", kLinkWriter, 0},
    {Cell::kRobotState, "robot_state", kLinkWriter, 1},
    {Cell::kHand, "hand", of(TaskId::kHaptic), 0},
    {Cell::kTouch, "touch", of(TaskId::kHaptic), 1},
    {Cell::kPatch, "patch", of(TaskId::kFusion), 0},
    {Cell::kSurface, "surface", of(TaskId::kFusion), 5},
    {Cell::kCostMap, "cost_map", of(TaskId::kFusion), 1},
    {Cell::kCameraPose, "camera_pose", of(TaskId::kFusion), 2},
    {Cell::kObjects, "objects", of(TaskId::kFusion), 4},
    {Cell::kPath, "path", of(TaskId::kPlanning), 0},
    {Cell::kMode, "mode", of(TaskId::kSupervision), 0},
    {Cell::kOdometryFrame, "odometry_frame", of(TaskId::kPrediction), 1},
    {Cell::kHealthHaptic, "health of haptic", of(TaskId::kHaptic), 2},
    {Cell::kHealthFusion, "health of fusion", of(TaskId::kFusion), 3},
    {Cell::kHealthPrediction, "health of prediction", of(TaskId::kPrediction), 0},
    {Cell::kHealthPlanning, "health of planning", of(TaskId::kPlanning), 1},
    {Cell::kGoal, "goal", kLinkWriter, 2},
    {Cell::kRobotMode, "robot_mode", of(TaskId::kRobotSupervision), 0},
    {Cell::kHealthRobotIo, "health of robot_io", of(TaskId::kRobotIo), 0},
    {Cell::kHealthCapture, "health of capture", of(TaskId::kCapture), 0},
}};

// The order of record.input_seq in tasks/graph/operator_nodes.cpp and robot_nodes.cpp.
constexpr std::array<ReadRow, 26> kReadTable{{
    {TaskId::kHaptic, 0, Cell::kPatch, true},
    {TaskId::kHaptic, 1, Cell::kMode, false},
    {TaskId::kHaptic, 3, Cell::kCameraPose, false},
    {TaskId::kHaptic, 4, Cell::kSurface, false},
    {TaskId::kFusion, 0, Cell::kFrame, false},
    {TaskId::kFusion, 1, Cell::kHand, false},
    {TaskId::kFusion, 2, Cell::kRobotState, false},
    {TaskId::kPlanning, 0, Cell::kCostMap, false},
    {TaskId::kPlanning, 1, Cell::kRobotState, false},
    {TaskId::kPlanning, 2, Cell::kMode, false},
    {TaskId::kPlanning, 4, Cell::kObjects, false},
    {TaskId::kPlanning, 5, Cell::kOdometryFrame, false},
    {TaskId::kPrediction, 0, Cell::kRobotState, false},
    {TaskId::kPrediction, 1, Cell::kPath, false},
    {TaskId::kPrediction, 2, Cell::kCameraPose, false},
    {TaskId::kPrediction, 3, Cell::kMode, false},
    {TaskId::kSupervision, 0, Cell::kHealthHaptic, false},
    {TaskId::kSupervision, 1, Cell::kHealthFusion, false},
    {TaskId::kSupervision, 2, Cell::kHealthPrediction, false},
    {TaskId::kSupervision, 3, Cell::kHealthPlanning, false},
    {TaskId::kSupervision, 4, Cell::kRobotState, false},
    {TaskId::kRobotIo, 0, Cell::kGoal, false},
    {TaskId::kRobotIo, 1, Cell::kRobotMode, false},
    {TaskId::kRobotSupervision, 0, Cell::kHealthRobotIo, false},
    {TaskId::kRobotSupervision, 1, Cell::kHealthCapture, false},
    {TaskId::kRobotSupervision, 2, Cell::kGoal, false},
}};

template <class T>
bool get(std::ifstream& in, T& v) {
  return static_cast<bool>(in.read(reinterpret_cast<char*>(&v), sizeof v));
}
// Skips `size` bytes that must be there.
bool skip(std::ifstream& in, std::uint64_t size, std::uint64_t file_size) {
  const auto at = static_cast<std::uint64_t>(in.tellg());
  if (size > file_size || at > file_size - size) return false;
  in.seekg(static_cast<std::streamoff>(at + size));
  return true;
}

rt::Error damaged(const std::string& path, std::uint64_t at) {
  return {path + ": damaged at byte " + std::to_string(at)};
}

}  // namespace

std::span<const CellRow> cell_table() noexcept { return kCellTable; }
std::span<const ReadRow> read_table() noexcept { return kReadTable; }

std::string Recording::key(std::string_view name) const {
  for (const auto& [k, v] : keys) {
    if (k == name) return v;
  }
  return {};
}

rt::Result<Recording> read_recording(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in) return rt::Error{path + ": can not be read"};
  in.seekg(0, std::ios::end);
  const auto file_size = static_cast<std::uint64_t>(in.tellg());
  in.seekg(0);
  Recording r;
  r.path = path;
  std::string line;
  std::getline(in, line);
  if (line != "teletact-inputs 7 " + std::to_string(sizeof(JobOp)))
    return rt::Error{path + ":1: not a recording of inputs by this version"};
  while (std::getline(in, line) && !line.empty()) {
    const auto space = line.find(' ');
    if (space == std::string::npos) return rt::Error{path + ": bad header line '" + line + "'"};
    r.keys.emplace_back(line.substr(0, space), line.substr(space + 1));
  }
  const rt::Error torn{path + ": the recording ends early: it is not whole"};
  for (;;) {
    const auto at = static_cast<std::uint64_t>(in.tellg());
    const int tag = in.get();
    if (tag == EOF) return torn;
    if (tag == 'O') {
      JobOp op;
      if (!get(in, op)) return torn;
      const auto kind = static_cast<int>(op.kind);
      if (op.task >= tasks::kTaskCount || kind < 1 || kind > 3) return damaged(path, at);
      r.ops.push_back(op);
    } else if (tag == 'M') {
      MessageAt m;
      if (!get(in, m.head)) return torn;
      m.offset = static_cast<std::uint64_t>(in.tellg());
      if (!skip(in, m.head.size, file_size)) return torn;
      r.messages.push_back(m);
    } else if (tag == 'F') {
      FrameHead f;
      const auto head_at = static_cast<std::uint64_t>(in.tellg());
      if (!get(in, f)) return torn;
      if (f.intrinsics.width < 0 || f.intrinsics.width > perception::RgbdFrame::kMaxWidth ||
          f.intrinsics.height < 0 || f.intrinsics.height > perception::RgbdFrame::kMaxHeight ||
          !f.joints.plausible()) {
        return damaged(path, at);
      }
      const auto n = static_cast<std::uint64_t>(f.intrinsics.width) *
                     static_cast<std::uint64_t>(f.intrinsics.height);
      if (!skip(in, n * (f.has_colour != 0 ? 5 : 2), file_size)) return torn;
      r.frames.push_back(head_at);
    } else if (tag == 'E') {
      Tally t;
      if (!get(in, t)) return torn;
      if (t.lost > 0) {
        return rt::Error{path + ": " + std::to_string(t.lost) +
                         " inputs were lost while recording: it can not be replayed"};
      }
      if (t.ops != r.ops.size() || t.messages != r.messages.size() || t.frames != r.frames.size())
        return damaged(path, at);
      return r;
    } else {
      return damaged(path, at);
    }
  }
}

}  // namespace teletact
