// A part of a run: what is kept of one segment, or of neighbouring ones, once its records are gone.
//
// File of a part, numbers little-endian:
//   magic "TLPT", version 1 (u32), segments first and last (u32), first and last release (i64 ns,
//   box clock), size of the payload (u64), CRC-32 of all before it and of the payload (u32);
//   payload.
// A part with a wrong CRC is not there. The payload is read with every length checked against what
// is left, so that damage that the CRC happens to miss can not do harm.
#pragma once

#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "rt/audit/run_log.hpp"
#include "rt/audit/task_past.hpp"
#include "rt/result.hpp"

namespace rt {

// Something that happened beside the jobs: a mode change, a cut, a full disk.
struct StoreEvent {
  static constexpr std::size_t kMaxText = 160;
  std::int64_t time_ns = 0;  // box clock
  std::string text;          // one line
};

struct Part {
  static constexpr std::size_t kMaxEvents = 4096;

  std::uint32_t first = 0, last = 0;    // segments
  std::int64_t from_ns = 0, to_ns = 0;  // first and last release; equal to 0: no record
  std::map<std::uint16_t, TaskPast> tasks;
  std::map<int, Histogram> sentinels;  // lateness by core
  std::vector<StoreEvent> events;      // the first kMaxEvents; the rest is counted
  std::uint64_t events_left_out = 0;

  void add(StoreEvent event);
  // The one that follows in time.
  void merge(Part&& later);
};

[[nodiscard]] std::vector<std::uint8_t> encode_part(const Part& part);
[[nodiscard]] Result<Part> decode_part(std::span<const std::uint8_t> bytes);
// Its segments and times alone; the CRC is not looked at.
[[nodiscard]] Result<Part> decode_part_head(std::span<const std::uint8_t> bytes);

// CRC-32 (ISO 3309) of both, one after the other.
[[nodiscard]] std::uint32_t store_crc(std::span<const std::uint8_t> head,
                                      std::span<const std::uint8_t> rest = {}) noexcept;

// Folds the segments of a run, one after the other, into parts.
class Folder {
 public:
  explicit Folder(const RunLog& header);
  // Jobs by the header's order of tasks, in order of k. `around`: the segment's sentinel samples
  // and those of its neighbours.
  [[nodiscard]] Part fold(const std::vector<std::vector<JobRecord>>& jobs,
                          std::span<const SentinelRecord> own,
                          std::span<const SentinelRecord> around);

 private:
  struct Row {
    TaskLog task;
    BlameWalk walk;
    TaskPast before;  // of the last segment that had jobs; only what carries over
  };
  std::vector<Row> rows_;
};

}  // namespace rt
