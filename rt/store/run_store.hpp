// The job records of a run of any length, on a disk of bounded size.
//
//   write     records go to the newest segment's file, in blocks; a segment ends after segment_s of
//             the box's time or kSegmentBytes
//   fold      a segment that has ended is folded into a part (part.hpp) once the next one has run
//             for a second, for blame needs the sentinel's samples on both sides; the part is
//             written
//   thin      above the cap the oldest whole segments go; their parts stay. Of parts of one size
//             (1, 6, 36, ... segments) kKeepParts stay; above that the oldest six become one. So a
//             day is a few hundred files, and the age of a record decides how finely its time is
//             known
//   full disk is told once (problem()), then the store thins harder: it gives up its oldest whole
//             segments, and takes what it then has as its cap. Records that can not be written are
//             counted (unwritten()); the counts and histograms of their segments are kept in
//             memory and written when there is room again. The run goes on in every case.
//   kill      at any moment: all blocks and parts before it are readable. What the store holds
//             back is less than block_bytes and what came since the last flush().
//
// Ordinary threads only: every call takes a mutex, and some write to the disk. Readers:
// read_store.hpp.
#pragma once

#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "rt/audit/run_file.hpp"
#include "rt/store/part.hpp"
#include "rt/store/store_disk.hpp"
#include "rt/store/store_files.hpp"

namespace rt {

struct StoreOptions {
  // Of the files of one box. At the default scene's rates a box writes about .25 MB a second, so
  // about a quarter of an hour is whole.
  std::uint64_t cap_bytes = std::uint64_t{256} << 20U;
  double segment_s = 10;
  std::size_t block_bytes = std::size_t{16} << 10U;

  static constexpr std::uint64_t kLeastCap = std::uint64_t{32} << 20U;
};

class RunStore {
 public:
  static constexpr std::size_t kSegmentBytes = std::size_t{4} << 20U;
  static constexpr std::uint32_t kFan = 6;
  static constexpr std::size_t kKeepParts = 60;

  // Files of an earlier store in this folder are removed. Throws std::runtime_error naming the
  // folder where it can not be made, also for a cap below kLeastCap. A header that the disk refuses
  // is a problem().
  RunStore(const std::string& folder, const RunLog& header, const StoreOptions& options = {});
  // The same on another disk, which is empty.
  RunStore(std::unique_ptr<StoreDisk> disk, const RunLog& header, const StoreOptions& options);
  ~RunStore();
  RunStore(const RunStore&) = delete;
  RunStore& operator=(const RunStore&) = delete;

  void add(const JobRecord& record) noexcept;
  void add(const SentinelRecord& record) noexcept;
  // Kept however thin the store becomes, up to Part::kMaxEvents; at most StoreEvent::kMaxText
  // bytes.
  void event(std::int64_t time_ns, std::string_view text) noexcept;
  // Once, after the last record.
  void finish(const std::vector<RunFileTotals>& totals, std::uint64_t dropped) noexcept;
  // Hands everything added so far to the kernel.
  void flush() noexcept;

  struct Use {
    std::uint64_t bytes = 0, most_bytes = 0;  // on the disk: now, at any time
    std::size_t files = 0;                    // of ended segments
    std::uint64_t unwritten = 0;              // records that the disk refused
  };
  [[nodiscard]] Use use() const noexcept;
  // One line once the disk refused something; empty until then.
  [[nodiscard]] std::string problem() const;

 private:
  struct Segment {
    std::uint32_t number = 0;
    std::int64_t from_ns = 0;
    std::uint64_t bytes = 0, records = 0;
    bool broken = false;                       // a block could not be written
    std::vector<std::vector<JobRecord>> jobs;  // by the header's order
    std::vector<SentinelRecord> sentinels;
    std::vector<StoreEvent> events;

    // Empty, with the memory that it has: two take turns, so that a run of days asks for none.
    void begin_anew(std::uint32_t number_);
  };
  void begin(const RunLog& header);
  [[nodiscard]] std::uint64_t bytes() const noexcept;
  Segment& take(std::int64_t release_ns);
  void roll();
  void fold_waiting();
  void write_block() noexcept;
  void write_held();
  void thin();
  bool merge_from(std::size_t at, std::size_t count);
  bool merge_a_ladder_step();
  void drop(std::size_t file);
  [[nodiscard]] bool drop_oldest_whole();
  void disk_refused(std::string_view what) noexcept;

  mutable std::mutex mutex_;
  std::unique_ptr<StoreDisk> disk_;
  StoreOptions options_;
  std::vector<std::uint16_t> ids_;  // of the tasks, by the header's order
  Folder folder_;
  Segment open_, waiting_;
  bool has_waiting_ = false;
  std::vector<SentinelRecord> before_;  // of the segment before waiting_
  std::vector<std::uint8_t> block_;
  std::vector<StoreFile> files_;  // of ended segments, in the order of `first`
  std::optional<Part> held_;      // folded, but the disk refused it
  std::uint64_t cap_ = 0, most_bytes_ = 0, unwritten_ = 0, fixed_bytes_ = 0;
  std::string problem_;
};

}  // namespace rt
