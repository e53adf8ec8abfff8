// Working memory of SurfaceFollower: the blocks in which readings ended. Their history is kept with
// the blocks (blocks/block_past.hpp).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "perception/geometry/pose.hpp"

namespace perception {

struct FollowScratch {
  explicit FollowScratch(std::size_t blocks) : met(blocks), asked(blocks), loosened(blocks) {}

  std::vector<std::int32_t> met;  // of this frame, in order of first readings
  int met_count = 0;
  std::vector<std::uint32_t> asked;  // frame in which a block was looked at node by node
  std::vector<std::uint32_t> loosened;

  // Mean camera position over the readings that the history holds.
  Vec3 eye_W = Vec3::Zero();
  double eyes = 0;

  // Looked at node by node, and off.
  struct Looked {
    std::int32_t block = 0;
    std::array<int, 3> at{};  // its coordinates
    double off_m = 0,
           error_m = 0;  // how far its surface has moved along the rays; the standard error of that
    double noise_m = 0;  // of a node
    double beyond_m = 0;  // of it what the camera's own error does not explain
    bool moves = false;   // not only kept where it is seen
    bool part = false;    // not all of its nodes
    double by_m = 0;      // what its nodes are moved by
  };
  static constexpr int kMostLooked = 256;
  std::array<Looked, kMostLooked> looked{};
  int looked_count = 0;

  // A tile of the image: sums of its readings' offsets and of their derivatives by a small camera
  // motion.
  struct Tile {
    double count = 0, sum = 0, squares = 0, z_m = 0;
    std::array<double, 6> row{};
  };
  static constexpr int kAcross = 16, kTiles = kAcross * kAcross;
  std::array<Tile, kTiles> tiles{};
  std::array<double, kTiles> room{};
};

}  // namespace perception
