// Storage of compressed chunks far from the camera: records of bytes in a pool of fixed pages,
// allocated and touched at start. A record is found by its chunk's coordinates. Nothing in it is
// ever moved.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "perception/tsdf/blocks/chunk_index.hpp"
#include "rt/hash.hpp"
#include "rt/memory/non_realtime.hpp"

namespace perception {

class FarStore {
 public:
  static constexpr std::int32_t kNone = ChunkIndex::kNone;
  static constexpr std::size_t kPage = 512;  // bytes

  struct Record {
    std::int32_t x = 0, y = 0, z = 0;  // in chunks
    std::int32_t first_page = kNone;
    std::uint32_t bytes = 0;
    std::int32_t blocks = 0, label_blocks = 0;
    std::uint32_t labels = 0;  // bit n: label n > 0 occurs in it and was not forgotten since
  };

  FarStore(rt::NonRealtime& nrt, std::size_t bytes, std::size_t max_records);

  // One record is written at a time: begin, append ..., then commit or cancel. False: no room; the
  // record is then cancelled.
  [[nodiscard]] bool begin() noexcept;
  [[nodiscard]] bool append(std::span<const std::uint8_t> bytes) noexcept;
  void commit(const Record& about) noexcept;  // coordinates, counts and labels of `about`
  void cancel() noexcept;

  [[nodiscard]] std::int32_t find(int x, int y, int z) const noexcept {
    return index_.find(x, y, z);
  }
  void drop(std::int32_t record) noexcept;
  void clear() noexcept;

  [[nodiscard]] const Record& at(std::int32_t record) const noexcept {
    return records_[static_cast<std::size_t>(record)];
  }
  [[nodiscard]] Record& at(std::int32_t record) noexcept {
    return records_[static_cast<std::size_t>(record)];
  }
  // Records are 0 .. slots() - 1; those with first_page == kNone are not in use.
  [[nodiscard]] std::int32_t slots() const noexcept { return used_records_; }
  [[nodiscard]] int size() const noexcept { return live_; }
  [[nodiscard]] int blocks() const noexcept { return blocks_; }
  [[nodiscard]] std::size_t bytes_used() const noexcept { return pages_taken_ * kPage; }
  [[nodiscard]] std::size_t capacity_bytes() const noexcept { return data_.size(); }
  [[nodiscard]] std::size_t memory_bytes() const noexcept;
  void add_to(rt::Hash64& h) const noexcept;  // all records, in order of their numbers

  // Reads a record from its beginning. Valid until the record is dropped.
  class Reader {
   public:
    Reader(const FarStore& store, std::int32_t record) noexcept
        : store_(&store), page_(store.at(record).first_page), left_(store.at(record).bytes) {}
    // False, and nothing is read: fewer bytes are left.
    [[nodiscard]] bool read(std::span<std::uint8_t> out) noexcept;
    [[nodiscard]] std::size_t left() const noexcept { return left_; }

   private:
    const FarStore* store_;
    std::int32_t page_;
    std::size_t in_page_ = 0, left_;
  };

 private:
  [[nodiscard]] std::int32_t take_page() noexcept;
  void free_chain(std::int32_t page) noexcept;

  std::vector<std::uint8_t> data_;
  std::vector<std::int32_t>
      next_;  // page after this one in its record, or in the list of free ones
  std::int32_t free_page_ = kNone;
  std::size_t pages_taken_ = 0;
  std::vector<Record> records_;
  std::vector<std::int32_t> recycled_;
  std::int32_t used_records_ = 0, recycled_count_ = 0;
  int live_ = 0, blocks_ = 0;
  ChunkIndex index_;
  // Being written.
  std::int32_t first_ = kNone, last_ = kNone;
  std::size_t in_last_ = 0, written_ = 0;
};

}  // namespace perception
