// The reconstructed surface for pages: all blocks as they cross the wire, and what each viewer has
// not seen of them. A viewer is a cursor of a few bytes: a block that changed three times while it
// was slow is sent once. Body of kind 3: docs/console_protocol.md.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <vector>

#include "tools/console/console_views.hpp"
#include "tools/console/view_bytes.hpp"

namespace perception {
struct MeshDelta;
}

namespace teletact {

class ConsoleMesh {
 public:
  // What is kept at most; a block beyond is left out. The demo's room has 2 MiB.
  static constexpr std::size_t kMostBytes = std::size_t{128} << 20U, kMostBlocks = 200'000;
  // Of one message, where a single block is not longer: a pose behind it must not wait for long.
  static constexpr std::size_t kMessageBytes = std::size_t{128} << 10U;

  struct Cursor {
    std::uint32_t epoch = 0, next_seq = 0;
    std::uint64_t seen = 0;
  };

  // Forgets all; what comes is thrown away until a delta with `restart`.
  void clear();
  // False: thrown away, or not a message of a MeshSender; nothing changed.
  [[nodiscard]] bool take(const perception::MeshDelta& delta, const ViewStamp& stamp,
                          double block_edge_m);
  [[nodiscard]] bool has_news(const Cursor& cursor) const noexcept {
    return !waits_ && (cursor.epoch != epoch_ || cursor.seen < changes_);
  }
  // The next message for that viewer, head and all; null: it has everything.
  [[nodiscard]] ViewBytes next(Cursor& cursor) const;

  [[nodiscard]] std::size_t blocks() const noexcept { return blocks_.size(); }
  [[nodiscard]] std::size_t bytes() const noexcept { return bytes_; }
  [[nodiscard]] std::uint64_t left_out() const noexcept { return left_out_; }

 private:
  using Key = std::array<std::int32_t, 3>;
  struct Block {
    std::uint32_t version = 0;
    std::uint64_t changed = 0;
    std::vector<std::uint8_t> vertices, triangles;
  };
  void put(const Key& key, Block block);

  std::map<Key, Block> blocks_;
  std::map<std::uint64_t, Key> by_change_;
  std::uint64_t changes_ = 0, left_out_ = 0;
  std::uint32_t epoch_ = 0;
  std::size_t bytes_ = 0;
  double edge_m_ = 0;
  ViewStamp stamp_;
  bool waits_ = true;
};

}  // namespace teletact
