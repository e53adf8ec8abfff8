// The last seconds of a run, in a file that outlives the process.
//
// A ring of records in a file that is mapped into memory. Nothing has to be written when the
// process ends: the kernel keeps the pages, even after SIGKILL. Only the records that the drain
// thread had not fetched yet (20 ms) are lost. For ordinary threads only, since add() takes a
// mutex.
//
// File, of this machine's layout:
//   0         text: "teletact-blackbox 1 <sizeof JobRecord> <sizeof SentinelRecord> <window ns>
//             <ring bytes>", the lines of a run file's header, an empty line; zeros follow
//   kStopAt   text: why the run stopped; empty: the process ended without a message
//   kRingAt   records, each at a multiple of 8 and never over the end: Head, payload
// A record is valid when its check fits; a reader takes every valid one and orders them by number.
// So a torn record, and the one it was written over, are left out, and nothing else.
//   'J' JobRecord   'S' SentinelRecord   others: defined by their writer
#pragma once

#include <cstddef>
#include <cstdint>
#include <mutex>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "rt/audit/run_log.hpp"
#include "rt/result.hpp"
#include "rt/time.hpp"

namespace rt {

class BlackBoxWriter {
 public:
  static constexpr std::size_t kStopAt = 16384 - 512, kStopSize = 512, kRingAt = 16384;
  static constexpr std::size_t kMaxPayload = 2048;

  // Space on the disk is taken here. Throws std::runtime_error naming the file.
  BlackBoxWriter(const std::string& path, const RunLog& header, Nanos window,
                 std::size_t ring_bytes);
  ~BlackBoxWriter();  // the file stays
  BlackBoxWriter(const BlackBoxWriter&) = delete;
  BlackBoxWriter& operator=(const BlackBoxWriter&) = delete;

  void add(const JobRecord& record) noexcept;
  void add(const SentinelRecord& record) noexcept;
  // Larger than kMaxPayload: cut.
  void add(char tag, std::span<const std::byte> payload) noexcept;
  // The first reason stays. Safe in a signal handler.
  void note_stop(std::string_view why) noexcept;
  // Writes a snapshot with this reason to a second file; the ring continues. False: could not be
  // written.
  [[nodiscard]] bool copy_to(const std::string& path, std::string_view why) noexcept;
  void remove() noexcept;  // a normal end: no black box

  // Bytes that records of this payload take, head and alignment included.
  [[nodiscard]] static constexpr std::size_t stored(std::size_t payload) noexcept {
    return (sizeof(Head) + payload + 7) / 8 * 8;
  }

  struct Head {
    std::uint32_t magic = 0, check = 0;  // check: of the rest of the head and the payload
    std::uint64_t number = 0;            // 1, 2, ...
    std::uint32_t size = 0;
    std::uint32_t tag = 0;
  };
  static constexpr std::uint32_t kMagic = 0x58424c54;  // "TLBX"

 private:
  void put(char tag, const void* data, std::size_t size) noexcept;
  std::string path_;
  std::byte* map_ = nullptr;
  std::size_t ring_bytes_ = 0, at_ = 0;
  std::uint64_t number_ = 0;
  std::mutex mutex_;
};

// Bytes of a ring that holds `window` of everything the tasks of `header` and the sentinels of
// their cores produce, and of `more_per_s` bytes a second besides; a quarter is added.
[[nodiscard]] std::size_t black_box_size(const RunLog& header, Nanos window, double more_per_s);

struct BlackBox {
  struct Entry {
    char tag = 0;
    std::vector<std::byte> payload;
  };
  RunLog log;  // jobs in order of k
  Nanos window{0};
  std::string stop;            // empty: the process ended without a message
  std::vector<Entry> entries;  // the others, in order
  std::uint64_t records = 0;   // valid ones
  std::uint64_t missing = 0;   // numbers between the first and the last that no record has
};

[[nodiscard]] bool is_black_box(const std::string& path);
// A short or damaged file gives what is left of it; an error when the header is none of ours.
[[nodiscard]] Result<BlackBox> read_black_box(const std::string& path);

}  // namespace rt
