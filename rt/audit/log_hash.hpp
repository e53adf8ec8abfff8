// Hashes of a run: sched_hash over every job record's schedule (same on any machine in virtual
// time), log_hash over that plus every committed output (same binary and instruction set).
#pragma once

#include "rt/audit/run_log.hpp"
#include "rt/hash.hpp"

namespace rt {

class LogHasher {
 public:
  void add(const JobRecord& r) noexcept {
    for (Hash64* h : {&sched_, &log_}) {
      h->word(r.task);
      h->word(r.k);
      h->word(static_cast<std::uint64_t>(r.release_ns));
      h->word(static_cast<std::uint64_t>(r.start_ns));
      h->word(static_cast<std::uint64_t>(r.end_ns));
      h->word(static_cast<std::uint64_t>(r.cpu_ns));
      h->word((static_cast<std::uint64_t>(r.skipped) << 32U) |
              (static_cast<std::uint64_t>(r.core) << 16U) |
              (static_cast<std::uint64_t>(r.level) << 8U) | static_cast<std::uint64_t>(r.outcome));
    }
    log_.word(r.output_hash);
    log_.word((static_cast<std::uint64_t>(r.fault) << 8U) | static_cast<std::uint64_t>(r.severity));
    for (const std::uint64_t seq : r.input_seq) log_.word(seq);
  }
  // Bytes that left on the link.
  void add_bytes(const void* data, std::size_t size) noexcept { log_.bytes(data, size); }
  [[nodiscard]] std::uint64_t sched() const noexcept { return sched_.digest(); }
  [[nodiscard]] std::uint64_t log() const noexcept { return log_.digest(); }

 private:
  Hash64 sched_, log_;
};

}  // namespace rt
