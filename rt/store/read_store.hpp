// A store (run_store.hpp) back into a run's log: records where they are whole, counts and
// histograms (TaskLog::past) where they are not.
//
//   choice    a segment's records if its file is whole to the last block, else its part if there is
//             one, else the records up to the tear
//   kill      the last segments have no part yet: their records up to the tear
//   damage    a part with a wrong CRC and no records is left out; the log says so (RunLog::told)
//   piece     of a run: seconds since its epoch (of a file without one: since its first record).
//             Records outside are left out. A part that lies on the border is counted whole, and
//             the log says from when to when it then counts. Totals of the whole run are left out.
//   parser    every length is checked, every block has its CRC; fuzzed (tests/fuzz)
#pragma once

#include <limits>
#include <string>
#include <vector>

#include "rt/audit/run_log.hpp"
#include "rt/result.hpp"
#include "rt/store/part.hpp"

namespace rt {

struct StorePiece {
  double from_s = 0;
  double to_s = std::numeric_limits<double>::infinity();
  // Records of the newest so many seconds; older segments by their parts, where they have them.
  double whole_s = std::numeric_limits<double>::infinity();

  [[nodiscard]] bool all() const noexcept {
    return from_s <= 0 && to_s == std::numeric_limits<double>::infinity();
  }
};

struct StoreLog {
  RunLog log;
  std::vector<StoreEvent> events;  // in order of time
  std::uint64_t whole_records = 0, part_records = 0, files = 0;
};

[[nodiscard]] bool is_store(const std::string& path);
[[nodiscard]] Result<StoreLog> read_store(const std::string& folder, const StorePiece& piece = {});
// A store, or the single file of an older run (rt/audit/run_file.hpp).
[[nodiscard]] Result<RunLog> read_run(const std::string& path, const StorePiece& piece = {});

// Bytes of the files of a store, 0 where there is none.
[[nodiscard]] std::uint64_t store_bytes(const std::string& folder);

// The records of one segment's file, into `log`. False: the file does not end with a whole block.
// Records of tasks and levels that the log does not know are left out.
[[nodiscard]] bool read_segment(std::span<const std::uint8_t> bytes, RunLog& log,
                                std::vector<StoreEvent>& events, std::uint64_t& records);

}  // namespace rt
