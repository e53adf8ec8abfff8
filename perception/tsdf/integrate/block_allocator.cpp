#include "perception/tsdf/integrate/block_allocator.hpp"

#include <algorithm>
#include <cstdint>

#include "perception/geometry/ifloor.hpp"
#include "perception/tsdf/integrate/allocate_scratch.hpp"

namespace perception {

BlockAllocator::BlockAllocator(rt::NonRealtime& nrt, MapStore& store, Pager& pager,
                               const KeptVolume& volume, const DepthPyramid& pyramid)
    : store_(store),
      pager_(pager),
      volume_(volume),
      pyramid_(pyramid),
      directory_(nrt),
      scratch_(std::make_unique<AllocateScratch>()) {}

BlockAllocator::~BlockAllocator() = default;

std::size_t BlockAllocator::memory_bytes() const noexcept {
  return directory_.memory_bytes() + sizeof *scratch_;
}

MapLayout::Chunk* BlockAllocator::chunk_for(int cx, int cy, int cz,
                                            IntegrateStats& stats) noexcept {
  BlockPool& blocks = store_.blocks;
  if (MapLayout::Chunk* c = blocks.find_chunk(cx, cy, cz); c != nullptr) return c;
  PageStats paged;
  const Pager::Held held = pager_.bring(cx, cy, cz, paged);
  if (held == Pager::Held::kNoRoom) return nullptr;
  if (held == Pager::Held::kNo && blocks.new_chunk({cx, cy, cz}) == nullptr) return nullptr;
  stats.blocks_fetched += paged.blocks_moved;
  const std::int32_t n = blocks.chunk_number(cx, cy, cz);
  directory_.add(MapView(store_), cx, cy, cz, n);
  return &blocks.chunk(n);
}

MapLayout::Chunk* BlockAllocator::touch_block(int bx, int by, int bz, MapLayout::Chunk* near,
                                              IntegrateStats& stats) noexcept {
  if (volume_.bounded() && !volume_.holds({bx * 8, by * 8, bz * 8}, 8)) return near;
  MapLayout::Chunk* c = near;
  if (c == nullptr || c->coord.x != bx >> 3 || c->coord.y != by >> 3 || c->coord.z != bz >> 3) {
    const auto far = [](int b) {
      return b >= MapLayout::kMaxBlockCoord || b < -MapLayout::kMaxBlockCoord;
    };
    c = far(bx) || far(by) || far(bz) ? nullptr : chunk_for(bx >> 3, by >> 3, bz >> 3, stats);
    if (c == nullptr) {
      ++stats.blocks_refused;
      return near;
    }
  }
  const auto slot = static_cast<std::size_t>(MapLayout::in_chunk(bx, by, bz));
  if (c->block[slot] != MapLayout::kNoBlock) return c;
  const std::int32_t b = store_.blocks.new_block(*c, {bx, by, bz});
  if (b == MapLayout::kNoBlock) {
    ++stats.blocks_refused;
    return c;
  }
  expand_free(c->free[slot], store_.blocks.free_bits(b));
  ++stats.blocks_new;
  return c;
}

// What the rows of a band lack, up to where its room ends.
void BlockAllocator::find_in_band(const Intrinsics& k, const BandJob& job, int pixel_step, int skip,
                                  int band) noexcept {
  AllocateScratch& scratch = *scratch_;
  AllocateScratch::Band& out = scratch.bands[static_cast<std::size_t>(band)];
  const int rows = (k.height + pixel_step - 1) / pixel_step,
            rays = (k.width + pixel_step - 1) / pixel_step;
  std::uint32_t end = 0;
  out.rows_seen = out.rays = 0;
  const int last = AllocateScratch::last_row(rows, band);
  for (int r = AllocateScratch::first_row(rows, band) + skip;
       r < last && end + AllocateScratch::kMostARow <= out.keys.size(); ++r) {
    const int v = r * pixel_step;
    const std::uint32_t* pixels = pyramid_.pixels() + static_cast<std::ptrdiff_t>(v) * k.width;
    if (pixel_step > 1) {  // no lane of a vector without a ray
      for (int n = 0; n < rays; ++n)
        out.pixels[static_cast<std::size_t>(n)] = pixels[n * pixel_step];
      pixels = out.pixels.data();
    }
    const BandRow row{pixels, scratch.x.data(), static_cast<float>((v - k.cy) / k.fy), rays,
                      out.keys.data() + end};
    const BandCount n = find_missing(job, row);
    std::uint64_t* const begin = out.keys.data() + end;
    std::sort(begin, begin + n.found);
    end += static_cast<std::uint32_t>(std::unique(begin, begin + n.found) - begin);
    ++out.rows_seen;
    out.rays += n.rays;
  }
  out.end = end;
}

BandJob BlockAllocator::job_of(const FrameCamera& view) noexcept {
  const double per_block = 1.0 / (8.0 * store_.voxel);
  const double shift = 1.0 / 16.0;  // half a voxel: a block owns the space nearest to its nodes
  BandJob job{};
  int middle[3];
  for (int a = 0; a < 3; ++a) {
    const double origin = view.X_WC.translation()(a) * per_block + shift;
    job.base[a] = ifloor(origin);
    job.origin[a] = static_cast<float>(origin - job.base[a]);
    middle[a] = job.base[a] >> 3;
    for (int c = 0; c < 3; ++c)
      job.axes[c][a] = static_cast<float>(view.X_WC.linear()(a, c) * per_block);
  }
  directory_.fill(MapView(store_), middle);
  for (int a = 0; a < 3; ++a) job.corner[a] = directory_.corner(a);
  job.directory = directory_.data();
  job.tables = store_.blocks.arrays().tables;
  job.truncation_m = static_cast<float>(store_.truncation);
  return job;
}

// Bands of rows at once: what do they lack? Then row by row it is made, in the order of block
// coordinates; what an earlier row has made by then is there already. So the result does not depend
// on how many rays or rows are looked at together. Where much is new (a first image) a band has no
// room for all its rows: it goes over the rest again.
void BlockAllocator::allocate_band(const FrameCamera& view, int pixel_step, rt::ForkJoin& crew,
                                   IntegrateStats& stats) noexcept {
  const Intrinsics& k = view.frame.intrinsics;
  const BandJob job = job_of(view);
  AllocateScratch& scratch = *scratch_;
  for (int n = 0; n * pixel_step < k.width; ++n)
    scratch.x[static_cast<std::size_t>(n)] = static_cast<float>((n * pixel_step - k.cx) / k.fx);
  MapLayout::Chunk* near = nullptr;
  crew.for_parts(AllocateScratch::kBands,
                 [&](int band) { find_in_band(k, job, pixel_step, 0, band); });
  const int rows = (k.height + pixel_step - 1) / pixel_step;
  for (int band = 0; band < AllocateScratch::kBands; ++band) {
    const int count =
        AllocateScratch::last_row(rows, band) - AllocateScratch::first_row(rows, band);
    const AllocateScratch::Band& found = scratch.bands[static_cast<std::size_t>(band)];
    for (int done = 0; done < count;) {
      if (done > 0) find_in_band(k, job, pixel_step, done, band);
      for (std::uint32_t n = 0; n < found.end; ++n) {
        const std::uint64_t key = found.keys[n];
        near = touch_block(block_key_axis(key, 0), block_key_axis(key, 1), block_key_axis(key, 2),
                           near, stats);
      }
      done += found.rows_seen;
      stats.rays += found.rays;
    }
  }
}

}  // namespace perception
