#include "perception/tsdf/integrate/free_space.hpp"

#include <cmath>

#include "perception/geometry/ifloor.hpp"
#include "perception/tsdf/blocks/held_bytes.hpp"

namespace perception {
namespace {

using Chunk = MapLayout::Chunk;

// Bits of the blocks of an aligned cube of `n` blocks (1, 2, 4, 8) in one word of Chunk::settled.
std::uint64_t block_bits(int by, int bz, int n) noexcept {
  const std::uint64_t row = n == 8 ? 0xffULL : ((1ULL << n) - 1ULL) << bz;
  std::uint64_t bits = 0;
  for (int y = 0; y < n; ++y) bits |= row << ((by + y) * 8);
  return bits;
}

// Bits of an aligned cube of `n` 2^3 cells (1 or 2) of one block.
std::uint64_t cell_bits(int x, int y, int z, int n) noexcept {
  const int first = (x * 4 + y) * 4 + z;
  return (n == 1 ? 1ULL : 0x0000000000330033ULL) << first;
}

bool is_settled(const Chunk& c, const std::array<int, 3>& local, int edge) noexcept {
  const int bx = local[0] >> 3, by = local[1] >> 3, bz = local[2] >> 3;
  if (edge >= 8) {
    const int n = edge >> 3;
    const std::uint64_t bits = block_bits(by, bz, n);
    for (int x = bx; x < bx + n; ++x)
      if ((c.settled[static_cast<std::size_t>(x)] & bits) != bits) return false;
    return true;
  }
  const std::uint64_t bits =
      cell_bits((local[0] & 7) >> 1, (local[1] & 7) >> 1, (local[2] & 7) >> 1, edge >> 1);
  return (c.free[static_cast<std::size_t>(MapLayout::in_chunk(bx, by, bz))] & bits) == bits;
}

void set_free(Chunk& c, const std::array<int, 3>& local, int edge) noexcept {
  const int bx = local[0] >> 3, by = local[1] >> 3, bz = local[2] >> 3;
  if (edge >= 8) {
    const int n = edge >> 3;
    for (int x = bx; x < bx + n; ++x) {
      for (int y = by; y < by + n; ++y)
        for (int z = bz; z < bz + n; ++z)
          c.free[static_cast<std::size_t>(MapLayout::in_chunk(x, y, z))] = ~0ULL;
      c.settled[static_cast<std::size_t>(x)] |= block_bits(by, bz, n);
    }
    return;
  }
  const auto slot = static_cast<std::size_t>(MapLayout::in_chunk(bx, by, bz));
  c.free[slot] |=
      cell_bits((local[0] & 7) >> 1, (local[1] & 7) >> 1, (local[2] & 7) >> 1, edge >> 1);
  if (c.free[slot] == ~0ULL) c.settled[slot >> 6U] |= 1ULL << (slot & 63U);
}

}  // namespace

FreeSpaceCarver::FreeSpaceCarver(rt::NonRealtime&, MapStore& store, BlockAllocator& allocator,
                                 const KeptVolume& volume, const DepthPyramid& pyramid)
    : store_(store),
      allocator_(allocator),
      volume_(volume),
      pyramid_(pyramid),
      to_carve_(static_cast<std::size_t>(store.config.max_chunks), nullptr) {}

std::size_t FreeSpaceCarver::memory_bytes() const noexcept { return held_bytes(to_carve_); }

void FreeSpaceCarver::carve_cube(const FrameCamera& view, Chunk*& c,
                                 const std::array<int, 3>& node0, int edge,
                                 IntegrateStats& stats) noexcept {
  const std::array<int, 3> local{node0[0] & 63, node0[1] & 63, node0[2] & 63};
  if (volume_.bounded() && edge >= 8 && !volume_.meets(node0, edge)) return;
  if (c != nullptr && is_settled(*c, local, edge)) return;
  ++stats.free_tests;
  const double mid = 0.5 * (edge - 1), voxel = store_.voxel;
  const BoxView box = view.boxes.view((node0[0] + mid) * voxel, (node0[1] + mid) * voxel,
                                      (node0[2] + mid) * voxel, static_cast<float>(mid * voxel));
  if (!box.visible) return;
  const auto margin = static_cast<float>(store_.truncation) + 1e-4F;
  const auto far = static_cast<float>(store_.config.max_depth_m);
  if (box.z_near > far) return;
  const auto range = pyramid_.range(box.u0, box.v0, box.u1, box.v1);
  if (static_cast<float>(range.greatest_mm) * 1e-3F <= box.z_near + margin) return;  // none is free
  if (box.inside && box.z_far <= far &&
      static_cast<float>(range.least_mm) * 1e-3F > box.z_far + margin &&
      (!volume_.bounded() || edge <= 8 || volume_.holds(node0, edge))) {
    if (c == nullptr) c = allocator_.chunk_for(node0[0] >> 6, node0[1] >> 6, node0[2] >> 6, stats);
    if (c == nullptr)
      ++stats.chunks_refused;
    else
      set_free(*c, local, edge);
    return;
  }
  if (edge == 2) return;
  // The rim of the view is left for the frame that sees it whole: it would be halved to the last
  // cube in every frame.
  if (edge <= 8 && (!box.inside || box.z_far > far)) return;
  // An allocated block keeps its own bits.
  if (edge == 8 && c != nullptr &&
      c->block[static_cast<std::size_t>(
          MapLayout::in_chunk(local[0] >> 3, local[1] >> 3, local[2] >> 3))] != MapLayout::kNoBlock)
    return;
  const int h = edge / 2;
  for (int i = 0; i < 8; ++i)
    carve_cube(
        view, c,
        {node0[0] + ((i >> 2) & 1) * h, node0[1] + ((i >> 1) & 1) * h, node0[2] + (i & 1) * h}, h,
        stats);
}

void FreeSpaceCarver::carve(const FrameCamera& view, std::uint32_t frame, rt::ForkJoin& crew,
                            IntegrateStats& stats) noexcept {
  const double voxel = store_.voxel;
  const Intrinsics& k = view.frame.intrinsics;
  Vec3 lo = view.X_WC.translation(), hi = lo;
  for (int corner = 0; corner < 4; ++corner) {
    const double u = (corner & 1) != 0 ? k.width - 0.5 : -0.5;
    const double v = (corner & 2) != 0 ? k.height - 0.5 : -0.5;
    const Vec3 p = view.X_WC * k.unproject(u, v, store_.config.max_depth_m);
    lo = lo.cwiseMin(p), hi = hi.cwiseMax(p);
  }
  std::array<int, 3> first{}, last{};
  for (std::size_t a = 0; a < 3; ++a) {
    first[a] = ifloor(lo(static_cast<Eigen::Index>(a)) / (64 * voxel));
    last[a] = ifloor(hi(static_cast<Eigen::Index>(a)) / (64 * voxel));
  }
  constexpr std::size_t kParts = 16;
  std::size_t count = 0;
  for (int x = first[0]; x <= last[0]; ++x)
    for (int y = first[1]; y <= last[1]; ++y)
      for (int z = first[2]; z <= last[2]; ++z) {
        const auto half = static_cast<float>(31.5 * voxel);
        const BoxView box = view.boxes.view((x * 64 + 31.5) * voxel, (y * 64 + 31.5) * voxel,
                                            (z * 64 + 31.5) * voxel, half);
        if (!box.visible) continue;
        Chunk* c = store_.blocks.find_chunk(x, y, z);
        // Half of the chunks a frame: between two frames little becomes free.
        if (c != nullptr) {
          if (c->carved + 1 == frame && ((x + y + z + static_cast<int>(frame & 1U)) & 1) != 0)
            continue;
          c->carved = frame;
          to_carve_[count++] = c;
          continue;
        }
        carve_cube(view, c, {x * 64, y * 64, z * 64}, 64, stats);
      }
  // Chunks that there are know nothing of each other.
  std::array<IntegrateStats, kParts> part{};
  crew.for_parts(kParts, [&](int p) {
    for (std::size_t n = static_cast<std::size_t>(p); n < count; n += kParts) {
      Chunk* c = to_carve_[n];
      carve_cube(view, c, {c->coord.x * 64, c->coord.y * 64, c->coord.z * 64}, 64,
                 part[static_cast<std::size_t>(p)]);
    }
  });
  for (const IntegrateStats& s : part) stats.free_tests += s.free_tests;
}

}  // namespace perception
