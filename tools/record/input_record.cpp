#include "tools/record/input_record.hpp"

#include <fstream>
#include <optional>
#include <sstream>

namespace teletact {

namespace {

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

std::span<const CellRow> cell_table() {
  static const std::vector<CellRow> rows = [] {
    std::vector<CellRow> all;
    for (const tasks::EdgeRow& e : tasks::kEdgeTable) {
      if (e.published != tasks::kUnlisted)
        all.push_back({cell_of(e.id), std::string(e.name), writer_of(e), e.published});
    }
    for (const tasks::TaskRow& t : tasks::kTaskTable) {
      if (t.watch.fault != 0)
        all.push_back({health_of(t.id), "health of " + std::string(t.name), static_cast<int>(t.id),
                       t.watch.published});
    }
    return all;
  }();
  return rows;
}

std::span<const ReadRow> read_table() {
  static const std::vector<ReadRow> rows = [] {
    std::vector<ReadRow> all;
    for (const tasks::LimitRow& r : tasks::kLimitTable) {
      if (r.input != tasks::kUnlisted &&
          !tasks::fed_from_outside(tasks::kEdgeTable[index_of(r.edge)]))
        all.push_back({r.reader, r.input, cell_of(r.edge), r.may_skip});
    }
    for (const tasks::TaskRow& t : tasks::kTaskTable) {
      if (t.watch.fault == 0) continue;
      const auto by = t.box == rt::Box::kOperator ? tasks::TaskId::kSupervision
                                                  : tasks::TaskId::kRobotSupervision;
      all.push_back({by, t.watch.input, health_of(t.id), false});
    }
    return all;
  }();
  return rows;
}

const CellRow* row_of_cell(int cell) {
  for (const CellRow& row : cell_table()) {
    if (row.cell == cell) return &row;
  }
  return nullptr;
}

std::string Recording::key(std::string_view name) const {
  for (const auto& [k, v] : keys) {
    if (k == name) return v;
  }
  return {};
}

namespace {

// The lines before the records; none: they are as they should be.
std::optional<rt::Error> read_keys(std::ifstream& in, Recording& r) {
  std::string line;
  std::getline(in, line);
  if (line != "teletact-inputs 11 " + std::to_string(sizeof(JobOp)))
    return rt::Error{r.path + ":1: not a recording of inputs by this version"};
  while (std::getline(in, line) && !line.empty()) {
    const auto space = line.find(' ');
    if (space == std::string::npos) return rt::Error{r.path + ": bad header line '" + line + "'"};
    r.keys.emplace_back(line.substr(0, space), line.substr(space + 1));
  }
  return std::nullopt;
}

}  // namespace

rt::Result<Recording> read_recording(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in) return rt::Error{path + ": can not be read"};
  in.seekg(0, std::ios::end);
  const auto file_size = static_cast<std::uint64_t>(in.tellg());
  in.seekg(0);
  Recording r;
  r.path = path;
  if (auto wrong = read_keys(in, r)) return *wrong;
  const rt::Error torn{path + ": the recording is cut off"};
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
