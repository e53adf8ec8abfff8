#include "perception/tsdf/patch/patch_copy.hpp"

#include <cmath>
#include <cstring>

#include "perception/geometry/ifloor.hpp"
#include "perception/simd/clones.hpp"
#include "rt/hash.hpp"

namespace perception {
namespace {

// words: first node of the brick in its block. Returns the free bits.
TELETACT_CLONES
std::uint64_t copy_brick(const std::uint32_t* words, const std::uint64_t* free_x, int y0, int z0,
                         std::int16_t* __restrict distance,
                         std::uint8_t* __restrict material) noexcept {
  alignas(64) std::uint32_t w[64];
  for (int row = 0; row < 16; ++row)
    std::memcpy(w + 4 * row, words + (row >> 2) * 64 + (row & 3) * 8, 16);
  alignas(64) std::uint8_t positive[64], observed[64];
  for (int n = 0; n < 64; ++n) {
    const bool seen = (w[n] >> 16U) >= static_cast<std::uint32_t>(MapLayout::kObservedWeight);
    const auto d = static_cast<std::int16_t>(w[n] & 0xffffU);
    distance[n] = seen ? d : std::int16_t{0};
    material[n] = seen ? std::uint8_t{1} : std::uint8_t{0};
    positive[n] = static_cast<std::uint8_t>(seen & (d > 0));
    observed[n] = static_cast<std::uint8_t>(seen);
  }
  std::uint64_t outside = 0, known = 0, bits = 0;
  for (int r = 0; r < 8; ++r) {
    std::uint64_t p, o;
    std::memcpy(&p, positive + 8 * r, 8);
    std::memcpy(&o, observed + 8 * r, 8);
    outside |= ((p * 0x0102040810204080ULL) >> 56U) << (8 * r);
    known |= ((o * 0x0102040810204080ULL) >> 56U) << (8 * r);
  }
  for (int x = 0; x < 4; ++x)
    for (int y = 0; y < 4; ++y)
      bits |= ((free_x[x] >> ((y0 + y) * 8 + z0)) & 0xfULL) << (x * 16 + y * 4);
  return (outside & known) | (bits & ~known);
}

// Free bits of a brick in a block that is not allocated: bit (x*4+y)*4+z of the chunk's 2^3 cells.
std::uint64_t spread_cells(std::uint64_t cells, int x0, int y0, int z0) noexcept {
  std::uint64_t bits = 0;
  for (int cell = 0; cell < 8; ++cell) {
    const int x = cell >> 2, y = (cell >> 1) & 1, z = cell & 1;
    const int at = ((x0 / 2 + x) * 4 + y0 / 2 + y) * 4 + z0 / 2 + z;
    if (((cells >> at) & 1U) != 0) bits |= 0x0000000000330033ULL << (x * 32 + y * 8 + z * 2);
  }
  return bits;
}

constexpr std::array<LabelVoxel, MapLayout::kBlockVoxels> kUnlabelled{};

void label_brick(const LabelVoxel* labels, std::span<const std::uint8_t> slot_of_label,
                 std::uint8_t* material) noexcept {
  for (int n = 0; n < 64; ++n) {
    if (material[n] == 0) continue;
    const std::uint8_t label = labels[(n >> 4) * 64 + ((n >> 2) & 3) * 8 + (n & 3)].label;
    const std::uint8_t slot = slot_of_label[label];
    material[n] = static_cast<std::uint8_t>(1 + (slot < SurfacePatch::kMaxMaterials ? slot : 0));
  }
}

}  // namespace

std::array<std::int32_t, 3> patch_origin(const Vec3& centre_W, int nodes,
                                         double voxel_size) noexcept {
  std::array<std::int32_t, 3> o{};
  for (int a = 0; a < 3; ++a) {
    // Node nearest to the low corner, then the nearest multiple of 4.
    const double low = centre_W(a) / voxel_size - 0.5 * (nodes - 1);
    o[static_cast<std::size_t>(a)] = 4 * ifloor(low / 4.0 + 0.5);
  }
  return o;
}

bool copy_patch(const MapView& of, const Vec3& centre_W, int nodes, SurfacePatch& out,
                std::span<const std::uint8_t> slot_of_label) noexcept {
  const MapView map = of;  // what is written below can not change it
  if (nodes < 8 || nodes > SurfacePatch::kMaxNodes || nodes % 4 != 0) return false;
  if (!centre_W.allFinite()) return false;
  if (!(centre_W.cwiseAbs().maxCoeff() < 4.0 * MapLayout::kMaxBlockCoord * map.voxel_size()))
    return false;
  if (!slot_of_label.empty() && slot_of_label.size() < 256) return false;
  out.map_id = map.map_id();
  out.voxel_size = map.voxel_size();
  out.metres_per_unit = map.metres_per_unit();
  out.origin_node = patch_origin(centre_W, nodes, map.voxel_size());
  out.nodes = nodes;
  const int bricks = nodes / 4;
  const MapLayout::Chunk* chunk = nullptr;
  BlockCoord have{INT32_MIN, 0, 0};
  std::size_t at = 0;
  for (int x = 0; x < bricks; ++x)
    for (int y = 0; y < bricks; ++y)
      for (int z = 0; z < bricks; ++z, ++at) {
        const int i = out.origin_node[0] + 4 * x, j = out.origin_node[1] + 4 * y,
                  k = out.origin_node[2] + 4 * z;
        const BlockCoord want{i >> 6, j >> 6, k >> 6};
        if (want != have) chunk = map.find_chunk(want.x, want.y, want.z), have = want;
        const auto slot = static_cast<std::size_t>(MapLayout::in_chunk(i >> 3, j >> 3, k >> 3));
        const std::int32_t b = chunk == nullptr ? MapLayout::kNoBlock : chunk->block[slot];
        std::int16_t* distance = out.distance.data() + at * 64;
        std::uint8_t* material = out.material.data() + at * 64;
        if (b != MapLayout::kNoBlock) {
          const int first = MapLayout::in_block(i, j, k);
          out.free[at] = copy_brick(map.block_words(b) + first, map.block_free(b) + (i & 7), j & 7,
                                    k & 7, distance, material);
          const LabelVoxel* labels = map.block_labels(b);
          if (!slot_of_label.empty() && (labels != nullptr || slot_of_label[0] != 0))
            label_brick((labels != nullptr ? labels : kUnlabelled.data()) + first, slot_of_label,
                        material);
          continue;
        }
        std::memset(distance, 0, 64 * sizeof *distance);
        std::memset(material, 0, 64);
        out.free[at] = chunk == nullptr ? 0 : spread_cells(chunk->free[slot], i & 7, j & 7, k & 7);
      }
  return true;
}

std::uint64_t patch_checksum(const SurfacePatch& p) noexcept {
  rt::Hash64 h;
  h.value(p.origin_node);
  h.value(p.nodes);
  h.bytes(p.distance.data(), p.cells() * sizeof p.distance[0]);
  h.bytes(p.material.data(), p.cells());
  h.bytes(p.free.data(), p.cells() / 8);
  return h.digest();
}

}  // namespace perception
