// Keeps a viewer's mesh of the map up to date. A message carries the triangles of a few changed
// blocks. It replaces all that the viewer has of a block; a block that is gone, or has no surface
// any more, is replaced by nothing.
//
//   sender     MeshSender, beside the map's writer. Every call looks on from where the last one
//              stopped, so no block starves, and cuts at most a given number of blocks; what has
//              not changed since it was sent costs a few compares. Everything is allocated in the
//              constructor.
//   message    MeshDelta: plain data, bounded.
//   receiver   MeshStore: what a viewer holds. Any thread of its own; allocates.
//
// The sum of all messages of a map at rest is extract_mesh() without refinement (vertices are where
// the two nodes of their edge put them), with weights from two observations on: triangle for
// triangle. A block that is compressed far from the camera (TsdfMap::page) leaves the mesh and
// returns with the block. No message may be lost: the next one is made after the previous one was
// taken. A receiver that has lost one, or is new, gets the whole mesh again (MeshSender::restart).
//
// Marching cubes: mesh.hpp. Frames: W, m.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <vector>

#include "perception/tsdf/blocks/map_view.hpp"
#include "perception/tsdf/mesh/mesh.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/time.hpp"

namespace perception {

struct MeshDelta {
  static constexpr int kMostBlocks = 512, kMostVertices = 24576, kMostTriangles = 49152;
  struct Vertex {
    float x = 0, y = 0, z = 0;
    Rgb colour;  // grey where the map has none
    std::uint8_t unused = 0;
  };
  using Triangle = std::array<std::uint16_t, 3>;  // of the block's vertices, counter-clockwise
                                                  // seen from free space
  struct Block {
    BlockCoord at;
    std::uint32_t version = 0;                  // grows with every replacement of the block
    std::uint16_t vertices = 0, triangles = 0;  // 0: nothing is left of it
  };

  std::uint64_t seq = 0;  // 0 = never published
  rt::Time fused{}, exposure{};
  bool restart = false;  // before it counts, what was there is forgotten
  std::int32_t block_count = 0, vertex_count = 0, triangle_count = 0;
  std::array<Block, kMostBlocks>
      blocks{};  // in order; their vertices and triangles follow each other
  std::array<Vertex, kMostVertices> vertices{};
  std::array<Triangle, kMostTriangles> triangles{};
};

class MeshSender {
 public:
  MeshSender(rt::NonRealtime&, const MapView& map);
  ~MeshSender();
  MeshSender(const MeshSender&) = delete;
  MeshSender& operator=(const MeshSender&) = delete;

  // Fills blocks, vertices, triangles and `restart`; cuts at most `budget` blocks. False: nothing
  // to send, `out` is void. By the thread that changes the map, between two changes.
  [[nodiscard]] bool next(int budget, MeshDelta& out) noexcept;
  // The receiver has nothing.
  void restart() noexcept;
  // Of the last next(): blocks whose cells were gone through.
  [[nodiscard]] int cut_last() const noexcept { return cut_last_; }
  [[nodiscard]] std::size_t memory_bytes() const noexcept;

 private:
  // What the receiver has from a place in the pool. revision 0: it is to be cut.
  struct Sent {
    BlockCoord at;
    std::uint32_t revision = 0;
    bool shown = false;  // there are triangles of `at` from here
  };
  [[nodiscard]] bool room(const MeshDelta& out) const noexcept;
  void withdraw(Sent& sent, MeshDelta& out) noexcept;
  [[nodiscard]] bool cut(std::int32_t block, BlockCoord at, MeshDelta& out) noexcept;
  [[nodiscard]] Rgb colour(int x, int y, int z, int axis, float share) const noexcept;

  MapView map_;
  std::vector<Sent> sent_;  // by pool index
  std::vector<std::uint16_t> vertex_of_edge_;
  std::int32_t cursor_ = 0, most_ = 0;  // most_: pool indices that were ever looked at
  std::uint32_t map_id_ = 0;
  int cut_last_ = 0;
  bool coloured_ = false, begins_ = true;
};

class MeshStore {
 public:
  // False, and nothing changed: not a message of a MeshSender (counts that do not fit, numbers that
  // are none). Then it is not to be taken as received.
  [[nodiscard]] bool take(const MeshDelta& delta);
  [[nodiscard]] std::size_t blocks() const noexcept { return parts_.size(); }
  [[nodiscard]] std::size_t triangles() const noexcept { return triangles_; }
  [[nodiscard]] std::uint64_t seq() const noexcept { return seq_; }  // of the newest taken
  // All of it, block by block in order of coordinates; vertices on a block's rim occur in each
  // block.
  [[nodiscard]] Mesh mesh() const;

 private:
  struct Part {
    std::uint32_t version = 0;
    std::vector<MeshDelta::Vertex> vertices;
    std::vector<MeshDelta::Triangle> triangles;
  };
  std::map<std::array<std::int32_t, 3>, Part> parts_;
  std::size_t triangles_ = 0;
  std::uint64_t seq_ = 0;
};

}  // namespace perception
