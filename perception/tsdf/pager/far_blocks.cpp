// Chunks that are put away and come back: compressed out of the pools, nothing lost.
#include <algorithm>
#include <limits>
#include <memory>
#include <utility>
#include <vector>

#include "perception/tsdf/image/frame_view.hpp"
#include "perception/tsdf/pager/chunk_record.hpp"

namespace perception {
namespace {

// Comes back this much nearer than it is put away, so that a hand's tremor moves nothing.
constexpr double kHysteresis_m = 0.4;

bool any_free(const FreeCells& cells) noexcept {
  return std::any_of(cells.begin(), cells.end(), [](std::uint64_t c) { return c != 0; });
}

std::uint32_t labels_of(std::span<const LabelVoxel> voxels) noexcept {
  std::uint32_t bits = 0;
  for (const LabelVoxel& v : voxels) bits |= 1U << (v.label & 31U);
  return bits & ~1U;
}

}  // namespace

double TsdfMap::distance_to_chunk(const Vec3& p_W, int x, int y, int z) const noexcept {
  const double edge = 64 * voxel_;
  const Vec3 low(x * edge, y * edge, z * edge);
  return (p_W - p_W.cwiseMax(low).cwiseMin(low + Vec3::Constant(edge))).norm();
}

bool TsdfMap::fits(const FarStore::Record& r) const noexcept {
  return (recycled_chunk_count_ > 0 || chunk_count_ < config_.max_chunks) &&
         free_blocks() >= r.blocks;
}

template <class Sink>
bool TsdfMap::write_chunk(const Chunk& c, std::uint32_t carved, Sink& sink) const noexcept {
  ChunkHead head{c.coord.x, c.coord.y, c.coord.z, carved, static_cast<std::uint16_t>(c.blocks),
                 0,         0};
  for (const std::int32_t b : c.block) {
    if (b == kNoBlock || block_labels(b) == nullptr) continue;
    ++head.label_blocks;
    head.labels |= labels_present(b);
  }
  if (!sink(bytes_of(head)) || !write_cells(c.free, sink)) return false;
  std::array<std::uint8_t, kMostBlockBytes> body;
  for (std::uint16_t slot = 0; slot < kChunkBlocks; ++slot) {
    const std::int32_t b = c.block[slot];
    if (b == kNoBlock) continue;
    const LabelVoxel* labels = block_labels(b);
    const auto bytes = static_cast<std::uint16_t>(encode_block(
        std::span<const std::uint32_t, kBlockVoxels>(block_words(b), kBlockVoxels),
        std::span<const std::uint32_t, kBlockVoxels>(block_colours(b), kBlockVoxels),
        std::span<const std::uint64_t, 8>(block_free(b), 8),
        {labels, labels == nullptr ? 0U : static_cast<std::size_t>(kBlockVoxels)}, body));
    if (!sink(bytes_of(slot)) || !sink(bytes_of(bytes)) || !sink({body.data(), bytes}))
      return false;
  }
  return true;
}

bool TsdfMap::put_away(std::int32_t number) noexcept {
  Chunk& c = chunks_[static_cast<std::size_t>(number)];
  if (!far_.begin()) return false;
  const auto sink = [this](std::span<const std::uint8_t> bytes) { return far_.append(bytes); };
  if (!write_chunk(c, c.carved, sink)) return false;
  FarStore::Record about;
  about.x = c.coord.x, about.y = c.coord.y, about.z = c.coord.z;
  about.blocks = c.blocks;
  for (int slot = 0; slot < kChunkBlocks; ++slot) {
    const std::int32_t b = c.block[static_cast<std::size_t>(slot)];
    if (b == kNoBlock) continue;
    about.labels |= labels_present(b);
    about.label_blocks += block_labels(b) == nullptr ? 0 : 1;
    drop_block(c, slot);
  }
  far_.commit(about);
  drop_chunk(number);
  in_view_count_ = 0;  // blocks went
  return true;
}

template <class Source>
void TsdfMap::restore_chunk(Source& source, std::uint32_t labels, PageStats& stats) noexcept {
  ChunkHead head;
  if (!source.read(bytes_into(head))) return;
  Chunk& c = *new_chunk({head.x, head.y, head.z});
  c.carved = head.carved;
  if (!read_cells(source, c.free)) return;
  for (std::size_t i = 0; i < c.free.size(); ++i)
    c.settled[i >> 6U] |= std::uint64_t{c.free[i] == ~0ULL} << (i & 63U);
  BlockImage& image = *unpacked_;
  for (int n = 0; n < head.blocks; ++n) {
    std::uint16_t slot = 0;
    if (!read_block(source, slot, image)) return;
    const std::int32_t b = new_block(
        c, {head.x * 8 + (slot >> 6), head.y * 8 + ((slot >> 3) & 7), head.z * 8 + (slot & 7)});
    const auto at = static_cast<std::ptrdiff_t>(b) * kBlockVoxels;
    std::copy(image.words.begin(), image.words.end(), words_.begin() + at);
    std::copy(image.colours.begin(), image.colours.end(), colours_.begin() + at);
    std::copy(image.free.begin(), image.free.end(),
              free_.begin() + static_cast<std::ptrdiff_t>(b) * 8);
    ++stats.blocks_moved;
    if (!image.labelled) continue;
    for (LabelVoxel& v : image.labels)
      if (v.label != 0 && ((labels >> v.label) & 1U) == 0) v = {};
    if (!store_labels(b, image.labels)) ++stats.labels_refused;
  }
}

void TsdfMap::bring_back(std::int32_t record, PageStats& stats) noexcept {
  FarStore::Reader reader(far_, record);
  restore_chunk(reader, far_.at(record).labels, stats);
  far_.drop(record);
  ++stats.brought_back;
}

PageStats TsdfMap::page(std::span<const Vec3> anchors_W, int block_budget) noexcept {
  PageStats stats;
  if (far_.capacity_bytes() == 0 || anchors_W.empty()) return stats;
  ++revision_;
  const auto nearest = [&](int x, int y, int z) {
    double d = std::numeric_limits<double>::infinity();
    for (const Vec3& p : anchors_W) d = std::min(d, distance_to_chunk(p, x, y, z));
    return d;
  };
  const double far = config_.effective_far();
  const CameraBoxes last(last_camera_, X_CW_last_);
  for (std::int32_t n = 0; n < chunk_count_ && stats.blocks_moved < block_budget; ++n) {
    const Chunk& c = chunks_[static_cast<std::size_t>(n)];
    if (c.coord == kNowhere || nearest(c.coord.x, c.coord.y, c.coord.z) <= far) continue;
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

bool TsdfMap::make_room(const FarStore::Record& r, const CameraBoxes& boxes, const Vec3& centre,
                        PageStats& stats) noexcept {
  while (!fits(r)) {
    std::int32_t farthest = ChunkIndex::kNone;
    double most = 0;
    for (std::int32_t n = 0; n < chunk_count_; ++n) {
      const Chunk& c = chunks_[static_cast<std::size_t>(n)];
      if (c.coord == kNowhere) continue;
      const double d = distance_to_chunk(centre, c.coord.x, c.coord.y, c.coord.z);
      if (d > most && !seen_from(boxes, c.coord)) most = d, farthest = n;
    }
    if (farthest == ChunkIndex::kNone) return false;
    const std::int32_t blocks = chunks_[static_cast<std::size_t>(farthest)].blocks;
    if (!put_away(farthest)) {
      ++stats.not_stored;
      return false;
    }
    stats.blocks_moved += std::max(blocks, 1);
    ++stats.put_away;
  }
  return true;
}

void TsdfMap::fetch_boxes(const CameraBoxes& boxes, const Vec3& centre, int budget, bool evict,
                          PageStats& stats) noexcept {
  for (std::int32_t r = 0; r < far_.slots(); ++r) {
    const FarStore::Record& record = far_.at(r);
    if (record.first_page == FarStore::kNone || !seen_from(boxes, {record.x, record.y, record.z}))
      continue;
    if (stats.blocks_moved >= budget) {
      ++stats.waiting;
    } else if (fits(record) || (evict && make_room(record, boxes, centre, stats))) {
      bring_back(r, stats);
    } else {
      ++stats.refused;
    }
  }
}

// Can some of the chunk be in the image, as far as depth is fused?
bool TsdfMap::seen_from(const CameraBoxes& boxes, BlockCoord chunk) const noexcept {
  // A little more than the chunk's nodes: a ray cast reads one beyond.
  const auto half = static_cast<float>(33.0 * voxel_);
  const BoxView box = boxes.view((chunk.x * 64 + 31.5) * voxel_, (chunk.y * 64 + 31.5) * voxel_,
                                 (chunk.z * 64 + 31.5) * voxel_, half);
  return box.visible && static_cast<double>(box.z_near) <= config_.max_depth_m + 3 * truncation_;
}

PageStats TsdfMap::fetch_view(const Intrinsics& k, const Pose& X_WC, int block_budget) noexcept {
  PageStats stats;
  if (far_.size() == 0 || !k.valid() || !X_WC.matrix().allFinite()) return stats;
  ++revision_;
  fetch_boxes(CameraBoxes(k, X_WC.inverse(Eigen::Isometry)), X_WC.translation(), block_budget, true,
              stats);
  return stats;
}

void TsdfMap::clear_far_region(const Eigen::AlignedBox3d& box_W) noexcept {
  const double edge = 64 * voxel_;
  for (std::int32_t r = 0; r < far_.slots(); ++r) {
    const FarStore::Record& record = far_.at(r);
    if (record.first_page == FarStore::kNone) continue;
    const Vec3 low(record.x * edge, record.y * edge, record.z * edge);
    const Eigen::AlignedBox3d whole(low, low + Vec3::Constant(edge - voxel_));
    if (!box_W.intersects(whole)) continue;
    PageStats stats;
    if (!box_W.contains(whole) && fits(record)) {
      bring_back(r, stats);
    } else {
      far_.drop(r);
    }
  }
}

// ---------------------------------------------------------------- records for files

// As a resident chunk would be written: not carved of late, without forgotten labels.
template <class Sink>
void TsdfMap::rewrite_record(std::int32_t record, Sink& sink) const {
  FarStore::Reader reader(far_, record);
  ChunkHead head;
  auto cells = std::make_unique<FreeCells>();
  auto images = std::vector<std::pair<std::uint16_t, BlockImage>>();
  if (!reader.read(bytes_into(head)) || !read_cells(reader, *cells)) return;
  if (head.blocks == 0 && !any_free(*cells)) return;
  images.resize(head.blocks);
  head.carved = 0;
  head.labels = 0;
  head.label_blocks = 0;
  for (auto& [slot, image] : images) {
    if (!read_block(reader, slot, image)) return;
    for (LabelVoxel& v : image.labels)
      if (v.label != 0 && ((far_.at(record).labels >> v.label) & 1U) == 0) v = {};
    const std::uint32_t bits = labels_of(image.labels);
    image.labelled = bits != 0;
    head.labels |= bits;
    head.label_blocks = static_cast<std::uint16_t>(head.label_blocks + (bits != 0 ? 1 : 0));
  }
  static_cast<void>(sink(bytes_of(head)));
  static_cast<void>(write_cells(*cells, sink));
  std::array<std::uint8_t, kMostBlockBytes> body;
  for (const auto& [slot, image] : images) {
    const std::span<const LabelVoxel> labels(image.labels);
    const auto n = static_cast<std::uint16_t>(
        encode_block(image.words, image.colours, image.free,
                     image.labelled ? labels : std::span<const LabelVoxel>{}, body));
    static_cast<void>(sink(bytes_of(slot)));
    static_cast<void>(sink(bytes_of(n)));
    static_cast<void>(sink({body.data(), n}));
  }
}

void TsdfMap::write_records(rt::NonRealtime&, const RecordFn& fn) const {
  struct Place {
    BlockCoord at;
    std::int32_t chunk, record;
  };
  std::vector<Place> places;
  for (std::int32_t n = 0; n < chunk_count_; ++n) {
    const Chunk& c = chunks_[static_cast<std::size_t>(n)];
    if (c.coord == kNowhere) continue;
    if (c.blocks > 0 || any_free(c.free)) places.push_back({c.coord, n, FarStore::kNone});
  }
  for (std::int32_t r = 0; r < far_.slots(); ++r) {
    const FarStore::Record& record = far_.at(r);
    if (record.first_page != FarStore::kNone)
      places.push_back({{record.x, record.y, record.z}, ChunkIndex::kNone, r});
  }
  std::sort(places.begin(), places.end(), [](const Place& a, const Place& b) {
    return std::array{a.at.x, a.at.y, a.at.z} < std::array{b.at.x, b.at.y, b.at.z};
  });
  std::vector<std::uint8_t> bytes;
  const auto sink = [&](std::span<const std::uint8_t> part) {
    bytes.insert(bytes.end(), part.begin(), part.end());
    return true;
  };
  for (const Place& p : places) {
    bytes.clear();
    if (p.chunk != ChunkIndex::kNone) {
      static_cast<void>(write_chunk(chunks_[static_cast<std::size_t>(p.chunk)], 0, sink));
    } else {
      rewrite_record(p.record, sink);
    }
    if (!bytes.empty()) fn(bytes);
  }
}

TsdfMap::Taken TsdfMap::take_record(rt::NonRealtime&, std::span<const std::uint8_t> bytes) {
  // All of it is read before any of it is stored.
  SpanSource check(bytes);
  ChunkHead head;
  FreeCells cells;
  constexpr int kFarthest = kMaxBlockCoord / 8;
  const auto outside = [](int c) { return c < -kFarthest || c >= kFarthest; };
  if (!check.read(bytes_into(head)) || outside(head.x) || outside(head.y) || outside(head.z) ||
      head.blocks > kChunkBlocks || head.carved != 0 || !read_cells(check, cells))
    return Taken::kMalformed;
  std::uint32_t labels = 0;
  int labelled = 0, last = -1;
  for (int n = 0; n < head.blocks; ++n) {
    std::uint16_t slot = 0;
    if (!read_block(check, slot, *unpacked_) || slot <= last) return Taken::kMalformed;
    last = slot;
    if (!unpacked_->labelled) continue;
    const std::uint32_t bits = labels_of(unpacked_->labels);
    if (bits == 0) return Taken::kMalformed;
    ++labelled;
    labels |= bits;
  }
  if (check.left() != 0 || labelled != head.label_blocks || labels != head.labels)
    return Taken::kMalformed;
  if (index_.find(head.x, head.y, head.z) != ChunkIndex::kNone ||
      far_.find(head.x, head.y, head.z) != FarStore::kNone)
    return Taken::kTwice;
  FarStore::Record about;
  about.x = head.x, about.y = head.y, about.z = head.z;
  about.blocks = head.blocks, about.label_blocks = head.label_blocks, about.labels = head.labels;
  in_view_count_ = 0;
  ++revision_;
  if (fits(about)) {
    PageStats stats;
    SpanSource source(bytes);
    restore_chunk(source, labels, stats);
    return Taken::kOk;
  }
  if (!far_.begin() || !far_.append(bytes)) return Taken::kNoRoom;
  far_.commit(about);
  return Taken::kOk;
}

}  // namespace perception
