#include "perception/tsdf/pager/pager.hpp"

#include <algorithm>
#include <limits>

#include "perception/tsdf/pager/chunk_io.hpp"

namespace perception {
namespace {

// Comes back this much nearer than it is put away, so that a hand's tremor moves nothing.
constexpr double kHysteresis_m = 0.4;
constexpr std::size_t kMostFarChunks = 1U << 15U;

}  // namespace

Pager::Pager(rt::NonRealtime& nrt, MapStore& store, ViewedBlocks& viewed)
    : store_(store),
      viewed_(viewed),
      far_(nrt, static_cast<std::size_t>(store.config.far_store_kib) * 1024, kMostFarChunks),
      unpacked_(std::make_unique<BlockImage>()) {}

Pager::~Pager() = default;

std::size_t Pager::memory_bytes() const noexcept {
  return far_.memory_bytes() + sizeof(BlockImage);
}

double Pager::distance_to_chunk(const Vec3& p_W, int x, int y, int z) const noexcept {
  const double edge = 64 * store_.voxel;
  const Vec3 low(x * edge, y * edge, z * edge);
  return (p_W - p_W.cwiseMax(low).cwiseMin(low + Vec3::Constant(edge))).norm();
}

bool Pager::put_away(std::int32_t number) noexcept {
  MapLayout::Chunk& c = store_.blocks.chunk(number);
  if (!far_.begin()) return false;
  const auto sink = [this](std::span<const std::uint8_t> bytes) { return far_.append(bytes); };
  if (!write_chunk(store_, c, c.carved, sink)) return false;
  FarStore::Record about;
  about.x = c.coord.x, about.y = c.coord.y, about.z = c.coord.z;
  about.blocks = c.blocks;
  for (int slot = 0; slot < MapLayout::kChunkBlocks; ++slot) {
    const std::int32_t b = c.block[static_cast<std::size_t>(slot)];
    if (b == MapLayout::kNoBlock) continue;
    about.labels |= store_.labels.present(b);
    about.label_blocks += store_.labels.of(b) == nullptr ? 0 : 1;
    store_.drop_block(c, slot);
  }
  far_.commit(about);
  store_.blocks.drop_chunk(number);
  viewed_.forget();  // blocks went
  return true;
}

void Pager::bring_back(std::int32_t record, PageStats& stats) noexcept {
  FarStore::Reader reader(far_, record);
  restore_chunk(store_, reader, far_.at(record).labels, *unpacked_, stats);
  far_.drop(record);
  ++stats.brought_back;
}

PageStats Pager::page(std::span<const Vec3> anchors_W, int block_budget) noexcept {
  PageStats stats;
  if (far_.capacity_bytes() == 0 || anchors_W.empty()) return stats;
  store_.blocks.next_revision();
  const auto nearest = [&](int x, int y, int z) {
    double d = std::numeric_limits<double>::infinity();
    for (const Vec3& p : anchors_W) d = std::min(d, distance_to_chunk(p, x, y, z));
    return d;
  };
  const double far = store_.config.effective_far();
  const CameraBoxes last(viewed_.camera(), viewed_.X_CW());
  for (std::int32_t n = 0; n < store_.blocks.chunk_count() && stats.blocks_moved < block_budget;
       ++n) {
    const MapLayout::Chunk& c = store_.blocks.chunk(n);
    if (c.coord == MapLayout::kNowhere || nearest(c.coord.x, c.coord.y, c.coord.z) <= far) continue;
    if (seen_from(last, c.coord)) continue;  // in a corner of the image
    const std::int32_t blocks = c.blocks;
    if (!put_away(n)) {
      ++stats.not_stored;
      break;
    }
    stats.blocks_moved += std::max(blocks, 1);
    ++stats.put_away;
  }
  for (std::int32_t r = 0; r < far_.slots(); ++r) {
    const FarStore::Record& record = far_.at(r);
    if (record.first_page == FarStore::kNone ||
        nearest(record.x, record.y, record.z) > far - kHysteresis_m)
      continue;
    if (!fits(record)) {
      ++stats.refused;
    } else if (stats.blocks_moved >= 2 * block_budget) {
      ++stats.waiting;
    } else {
      bring_back(r, stats);
    }
  }
  return stats;
}

bool Pager::make_room(const FarStore::Record& r, const CameraBoxes& boxes, const Vec3& centre_W,
                      PageStats& stats) noexcept {
  while (!fits(r)) {
    std::int32_t farthest = ChunkIndex::kNone;
    double most = 0;
    for (std::int32_t n = 0; n < store_.blocks.chunk_count(); ++n) {
      const MapLayout::Chunk& c = store_.blocks.chunk(n);
      if (c.coord == MapLayout::kNowhere) continue;
      const double d = distance_to_chunk(centre_W, c.coord.x, c.coord.y, c.coord.z);
      if (d > most && !seen_from(boxes, c.coord)) most = d, farthest = n;
    }
    if (farthest == ChunkIndex::kNone) return false;
    const std::int32_t blocks = store_.blocks.chunk(farthest).blocks;
    if (!put_away(farthest)) {
      ++stats.not_stored;
      return false;
    }
    stats.blocks_moved += std::max(blocks, 1);
    ++stats.put_away;
  }
  return true;
}

void Pager::fetch_boxes(const CameraBoxes& boxes, const Vec3& centre_W, int budget, bool evict,
                        PageStats& stats) noexcept {
  for (std::int32_t r = 0; r < far_.slots(); ++r) {
    const FarStore::Record& record = far_.at(r);
    if (record.first_page == FarStore::kNone || !seen_from(boxes, {record.x, record.y, record.z}))
      continue;
    if (stats.blocks_moved >= budget) {
      ++stats.waiting;
    } else if (fits(record) || (evict && make_room(record, boxes, centre_W, stats))) {
      bring_back(r, stats);
    } else {
      ++stats.refused;
    }
  }
}

// Can some of the chunk be in the image, as far as depth is fused?
bool Pager::seen_from(const CameraBoxes& boxes, BlockCoord chunk) const noexcept {
  // A little more than the chunk's nodes: a ray cast reads one beyond.
  const auto half = static_cast<float>(33.0 * store_.voxel);
  const BoxView box =
      boxes.view((chunk.x * 64 + 31.5) * store_.voxel, (chunk.y * 64 + 31.5) * store_.voxel,
                 (chunk.z * 64 + 31.5) * store_.voxel, half);
  return box.visible &&
         static_cast<double>(box.z_near) <= store_.config.max_depth_m + 3 * store_.truncation;
}

PageStats Pager::fetch_view(const Intrinsics& k, const Pose& X_WC, int block_budget) noexcept {
  PageStats stats;
  if (far_.size() == 0 || !k.valid() || !X_WC.matrix().allFinite()) return stats;
  store_.blocks.next_revision();
  fetch_boxes(CameraBoxes(k, X_WC.inverse(Eigen::Isometry)), X_WC.translation(), block_budget, true,
              stats);
  return stats;
}

void Pager::clear_region(const Eigen::AlignedBox3d& box_W) noexcept {
  const double edge = 64 * store_.voxel;
  for (std::int32_t r = 0; r < far_.slots(); ++r) {
    const FarStore::Record& record = far_.at(r);
    if (record.first_page == FarStore::kNone) continue;
    const Vec3 low(record.x * edge, record.y * edge, record.z * edge);
    const Eigen::AlignedBox3d whole(low, low + Vec3::Constant(edge - store_.voxel));
    if (!box_W.intersects(whole)) continue;
    PageStats stats;
    if (!box_W.contains(whole) && fits(record)) {
      bring_back(r, stats);
    } else {
      far_.drop(r);
    }
  }
}

Pager::Held Pager::bring(int cx, int cy, int cz, PageStats& stats) noexcept {
  const std::int32_t record = far_.find(cx, cy, cz);
  if (record == FarStore::kNone) return Held::kNo;
  if (!fits(far_.at(record))) return Held::kNoRoom;
  bring_back(record, stats);
  return Held::kBack;
}

void Pager::forget_label(std::uint8_t label) noexcept {
  for (std::int32_t r = 0; r < far_.slots(); ++r) far_.at(r).labels &= ~(1U << label);
}

bool Pager::admit(const FarStore::Record& about, std::span<const std::uint8_t> bytes) noexcept {
  viewed_.forget();
  store_.blocks.next_revision();
  if (fits(about)) {
    PageStats stats;
    SpanSource source(bytes);
    restore_chunk(store_, source, about.labels, *unpacked_, stats);
    return true;
  }
  if (!far_.begin() || !far_.append(bytes)) return false;
  far_.commit(about);
  return true;
}

}  // namespace perception
