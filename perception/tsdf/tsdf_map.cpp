#include "perception/tsdf/tsdf_map.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <stdexcept>

#include "perception/tsdf/follow/follow_scratch.hpp"
#include "perception/tsdf/integrate/allocate_scratch.hpp"
#include "perception/tsdf/pager/block_codec.hpp"
#include "rt/hash.hpp"

namespace perception {
namespace {

constexpr int kChunkEdgeBlocks = 8;

void require(bool ok, const char* key, double value, const char* range) {
  if (ok) return;
  throw std::invalid_argument("tsdf." + std::string(key) + " = " + std::to_string(value) +
                              ": must be " + range);
}

const TsdfConfig& checked(const TsdfConfig& c) {
  require(c.voxel_size_m >= 0.002 && c.voxel_size_m <= 0.1, "voxel_size_m", c.voxel_size_m,
          "0.002 to 0.1");
  require(c.truncation_m >= 0.005 && c.truncation_m <= 0.5, "truncation_m", c.truncation_m,
          "0.005 to 0.5");
  require(c.min_depth_m >= 0.05 && c.min_depth_m < c.max_depth_m, "min_depth_m", c.min_depth_m,
          "0.05 to max_depth_m");
  require(c.max_depth_m <= 20, "max_depth_m", c.max_depth_m, "at most 20");
  require(c.max_weight >= 2 && c.max_weight <= 255, "max_weight", c.max_weight, "2 to 255");
  require(c.edge_base_m >= 0 && c.edge_base_m <= 10, "edge_base_m", c.edge_base_m, "0 to 10");
  require(c.edge_per_m >= 0 && c.edge_per_m <= 0.4, "edge_per_m", c.edge_per_m, "0 to 0.4");
  require(c.colour_band_m >= 0 && c.colour_band_m <= 0.5, "colour_band_m", c.colour_band_m,
          "0 to 0.5");
  require(c.max_blocks >= 1 && c.max_blocks <= 1 << 20, "max_blocks", c.max_blocks, "1 to 1048576");
  require(c.max_label_blocks >= 1 && c.max_label_blocks <= 1 << 18, "max_label_blocks",
          c.max_label_blocks, "1 to 262144");
  require(c.max_chunks >= 1 && c.max_chunks <= 1 << 16, "max_chunks", c.max_chunks, "1 to 65536");
  require(c.far_m >= 1 && c.far_m <= 1000, "far_m", c.far_m, "1 to 1000");
  require(c.far_store_kib >= 0 && c.far_store_kib <= 1 << 21, "far_store_kib", c.far_store_kib,
          "0 to 2097152");
  require(c.volume_m == 0 || (c.volume_m >= 0.1 && c.volume_m <= 1000), "volume_m", c.volume_m,
          "0 (unbounded), or 0.1 to 1000");
  require(c.decay_half_life_s >= 0 && c.decay_half_life_s <= 1e6, "decay_half_life_s",
          c.decay_half_life_s, "0 to 1000000");
  if (c.weighting != "uniform" && c.weighting != "range")
    throw std::invalid_argument("tsdf.weighting = \"" + c.weighting +
                                "\": must be \"uniform\" or \"range\"");
  return c;
}

// Free bits of a block from the bits of its 2^3 cells, and back (a cell is free when all of it is).
void expand_free(std::uint64_t cells, std::uint64_t* bits) noexcept {
  for (int x = 0; x < 8; ++x) {
    std::uint64_t word = 0;
    for (int y = 0; y < 8; ++y)
      for (int z = 0; z < 8; ++z)
        if (((cells >> (((x >> 1) * 4 + (y >> 1)) * 4 + (z >> 1))) & 1U) != 0)
          word |= 1ULL << (y * 8 + z);
    bits[x] = word;
  }
}
std::uint64_t shrink_free(const std::uint64_t* bits) noexcept {
  std::uint64_t cells = 0;
  for (int cell = 0; cell < 64; ++cell) {
    const int x = (cell >> 4) * 2, y = ((cell >> 2) & 3) * 2, z = (cell & 3) * 2;
    const std::uint64_t both = bits[x] & bits[x + 1];
    const std::uint64_t pair = (3ULL << (y * 8 + z)) | (3ULL << (y * 8 + 8 + z));
    if ((both & pair) == pair) cells |= 1ULL << cell;
  }
  return cells;
}

}  // namespace

void TsdfConfig::describe(config::Section& s) {
  s.number("voxel_size_m", voxel_size_m, 0.005, 0.08, "edge of a voxel");
  s.number("truncation_m", truncation_m, 0.01, 0.4,
           "half width of the stored band; raised to 2.1 voxels");
  s.number("min_depth_m", min_depth_m, 0.05, 2, "nearer readings are ignored");
  s.number("max_depth_m", max_depth_m, 0.5, 12, "farther readings only carve free space");
  s.number("max_weight", max_weight, 2, 255, "cap of the running mean, observations");
  s.text("weighting", weighting, {"uniform", "range"},
         "weight of a reading: 1, or falling with depth as the sensor's noise grows");
  s.number("edge_base_m", edge_base_m, 0, 1, "depth step that is an edge, at depth 0");
  s.number("edge_per_m", edge_per_m, 0, 0.4, "growth of that step with depth");
  s.number("colour_band_m", colour_band_m, 0, 0.1, "distance from the surface that takes colour");
  s.integer("max_blocks", max_blocks, 64, 262144, "pool of 8^3 blocks, 4.2 KiB each");
  s.integer("max_label_blocks", max_label_blocks, 64, 65536,
            "pool of the labels of blocks that hold a part of an object, 1 KiB each");
  s.integer("max_chunks", max_chunks, 8, 65536, "pool of 64^3 chunks, 6.2 KiB each");
  s.number("far_m", far_m, 1, 1000,
           "chunks farther from camera and hand are compressed out of the pool; at least "
           "max_depth_m + 1");
  s.integer("far_store_kib", far_store_kib, 0, 1 << 21,
            "where they are put, about 0.8 KiB a block; 0: nothing is put away");
  s.number("volume_m", volume_m, 0, 1000,
           "edge of a cube in front of the first camera, outside of which nothing is kept; 0: "
           "unbounded");
  s.number("decay_half_life_s", decay_half_life_s, 0, 1e6,
           "weight of what is not seen again halves in this time; 0: never");
  s.flag("follow", follow, "surfaces that move slowly while they are looked at are followed");
}

double TsdfConfig::effective_far() const noexcept { return std::max(far_m, max_depth_m + 1.0); }

double TsdfConfig::effective_truncation() const noexcept {
  return std::max(truncation_m, 2.1 * voxel_size_m);
}

TsdfMap::TsdfMap(rt::NonRealtime& nrt, const TsdfConfig& config)
    : config_(checked(config)),
      voxel_(config.voxel_size_m),
      truncation_(config.effective_truncation()),
      metres_per_unit_(static_cast<float>(truncation_ / kDistanceOne)),
      index_(nrt, static_cast<std::size_t>(config.max_chunks)),
      far_(nrt, static_cast<std::size_t>(config.far_store_kib) * 1024, kMostFarChunks),
      unpacked_(std::make_unique<BlockImage>()),
      range_weight_(config.weighting == "range"),
      pyramid_(nrt),
      directory_(nrt),
      allocate_(std::make_unique<AllocateScratch>()),
      follow_(std::make_unique<FollowScratch>(static_cast<std::size_t>(config_.max_blocks))) {
  const auto blocks = static_cast<std::size_t>(config_.max_blocks);
  const auto chunks = static_cast<std::size_t>(config_.max_chunks);
  chunks_.resize(chunks + 1);
  recycled_chunks_.assign(chunks, 0);
  chunks_.back().block.fill(kNoBlock);
  words_.assign((blocks + 1) * kBlockVoxels, 0);
  colours_.assign(blocks * kBlockVoxels, 0);
  const auto labelled = static_cast<std::size_t>(config_.max_label_blocks);
  label_pool_.assign(labelled * kBlockVoxels, {});
  label_bits_.assign(labelled, 0);
  block_of_label_.assign(labelled, kNoBlock);
  label_recycled_.assign(labelled, 0);
  label_of_block_.assign(blocks, kNoBlock);
  free_.assign(blocks * 8, 0);
  coords_.assign(blocks, {});
  ahead_.assign((blocks + 1) * 8, config_.max_blocks);
  changed_.assign(blocks + 1, 0);
  in_use_.assign(blocks, 0);
  recycled_.assign(blocks, 0);
  in_view_.assign(blocks, InView{});
  to_carve_.assign(chunks, nullptr);
}

TsdfMap::~TsdfMap() = default;

std::size_t TsdfMap::memory_bytes() const noexcept {
  const auto bytes = [](const auto& v) {
    // Of the elements, which may be pointers. NOLINTNEXTLINE(bugprone-sizeof-expression)
    return v.capacity() * sizeof(typename std::decay_t<decltype(v)>::value_type);
  };
  return sizeof *this + index_.memory_bytes() + bytes(chunks_) + bytes(recycled_chunks_) +
         far_.memory_bytes() + sizeof(BlockImage) + bytes(words_) + bytes(colours_) +
         bytes(label_pool_) + bytes(label_bits_) + bytes(label_of_block_) + bytes(block_of_label_) +
         bytes(label_recycled_) + bytes(free_) + bytes(coords_) + bytes(ahead_) + bytes(changed_) +
         bytes(in_use_) + bytes(recycled_) + bytes(in_view_) + bytes(to_carve_) +
         sizeof *allocate_ + sizeof *follow_ + bytes(follow_->memory) + bytes(follow_->met) +
         bytes(follow_->asked) + bytes(follow_->loosened) + pyramid_.memory_bytes() +
         directory_.memory_bytes();
}

void TsdfMap::clear() noexcept {
  ++revision_;
  index_.clear();
  far_.clear();
  decay_at_ = 0;
  std::fill_n(in_use_.begin(), used_blocks_, std::uint8_t{0});
  std::fill_n(label_of_block_.begin(), used_blocks_, kNoBlock);
  std::fill_n(block_of_label_.begin(), label_used_, kNoBlock);
  chunk_count_ = recycled_chunk_count_ = used_blocks_ = recycled_count_ = live_blocks_ = 0;
  bounded_ = false;
  label_used_ = label_recycled_count_ = label_blocks_ = label_images_ = in_view_count_ = 0;
  ++map_id_;
}

const TsdfMap::Chunk* TsdfMap::find_chunk(int cx, int cy, int cz) const noexcept {
  const std::int32_t n = index_.find(cx, cy, cz);
  return n == ChunkIndex::kNone ? nullptr : &chunks_[static_cast<std::size_t>(n)];
}

TsdfMap::Chunk* TsdfMap::new_chunk(BlockCoord at) noexcept {
  std::int32_t n;
  if (recycled_chunk_count_ > 0) {
    n = recycled_chunks_[static_cast<std::size_t>(--recycled_chunk_count_)];
  } else if (chunk_count_ < config_.max_chunks) {
    n = chunk_count_++;
  } else {
    return nullptr;
  }
  index_.insert(at.x, at.y, at.z, n);
  directory_.add(*this, at.x, at.y, at.z, n);
  Chunk& c = chunks_[static_cast<std::size_t>(n)];
  c.block.fill(kNoBlock);
  c.free.fill(0);
  c.settled.fill(0);
  c.coord = at;
  c.blocks = 0;
  c.carved = 0;
  return &c;
}

// Of a chunk without blocks.
void TsdfMap::drop_chunk(std::int32_t number) noexcept {
  Chunk& c = chunks_[static_cast<std::size_t>(number)];
  index_.erase(c.coord.x, c.coord.y, c.coord.z);
  c.free.fill(0);
  c.settled.fill(0);
  c.coord = kNowhere;
  recycled_chunks_[static_cast<std::size_t>(recycled_chunk_count_++)] = number;
}

TsdfMap::Chunk* TsdfMap::chunk_for(int cx, int cy, int cz, IntegrateStats& stats) noexcept {
  const std::int32_t n = index_.find(cx, cy, cz);
  if (n != ChunkIndex::kNone) return &chunks_[static_cast<std::size_t>(n)];
  const std::int32_t record = far_.find(cx, cy, cz);
  if (record == FarStore::kNone) return new_chunk({cx, cy, cz});
  if (!fits(far_.at(record))) return nullptr;
  PageStats paged;
  bring_back(record, paged);
  stats.blocks_fetched += paged.blocks_moved;
  return &chunks_[static_cast<std::size_t>(index_.find(cx, cy, cz))];
}

std::int32_t TsdfMap::new_block(Chunk& c, BlockCoord at) noexcept {
  std::int32_t b;
  if (recycled_count_ > 0) {
    b = recycled_[static_cast<std::size_t>(--recycled_count_)];
  } else if (used_blocks_ < config_.max_blocks) {
    b = used_blocks_++;
  } else {
    return kNoBlock;
  }
  const auto first = static_cast<std::ptrdiff_t>(b) * kBlockVoxels;
  std::fill_n(words_.begin() + first, kBlockVoxels, 0U);
  std::fill_n(colours_.begin() + first, kBlockVoxels, 0U);
  coords_[static_cast<std::size_t>(b)] = at;
  in_use_[static_cast<std::size_t>(b)] = 1;
  changed_[static_cast<std::size_t>(b)] = revision_;
  follow_->memory[static_cast<std::size_t>(b)] = {};
  c.block[static_cast<std::size_t>(in_chunk(at.x, at.y, at.z))] = b;
  c.settled[static_cast<std::size_t>(at.x & 7)] |= 1ULL << ((at.y & 7) * 8 + (at.z & 7));
  ++c.blocks;
  ++live_blocks_;
  link(at, b);
  return b;
}

TsdfMap::Chunk* TsdfMap::touch_block(int bx, int by, int bz, Chunk* near,
                                     IntegrateStats& stats) noexcept {
  if (bounded_ && !in_volume({bx * 8, by * 8, bz * 8}, 8)) return near;
  Chunk* c = near;
  if (c == nullptr || c->coord.x != bx >> 3 || c->coord.y != by >> 3 || c->coord.z != bz >> 3) {
    const auto far = [](int b) { return b >= kMaxBlockCoord || b < -kMaxBlockCoord; };
    c = far(bx) || far(by) || far(bz) ? nullptr : chunk_for(bx >> 3, by >> 3, bz >> 3, stats);
    if (c == nullptr) {
      ++stats.blocks_refused;
      return near;
    }
  }
  const auto slot = static_cast<std::size_t>(in_chunk(bx, by, bz));
  if (c->block[slot] != kNoBlock) return c;
  const std::int32_t b = new_block(*c, {bx, by, bz});
  if (b == kNoBlock) {
    ++stats.blocks_refused;
    return c;
  }
  expand_free(c->free[slot], free_.data() + static_cast<std::ptrdiff_t>(b) * 8);
  ++stats.blocks_new;
  return c;
}

void TsdfMap::link(BlockCoord at, std::int32_t block) noexcept {
  const std::int32_t none = config_.max_blocks;
  for (std::int32_t n = 0; n < 8; ++n) {
    const int x = n >> 2, y = (n >> 1) & 1, z = n & 1;
    if (block != kNoBlock) {
      const std::int32_t next = n == 0 ? block : find_block({at.x + x, at.y + y, at.z + z});
      ahead_[static_cast<std::size_t>(8 * block + n)] = next == kNoBlock ? none : next;
    }
    if (n == 0) continue;
    const std::int32_t behind = find_block({at.x - x, at.y - y, at.z - z});
    if (behind == kNoBlock) continue;
    ahead_[static_cast<std::size_t>(8 * behind + n)] = block == kNoBlock ? none : block;
    changed_[static_cast<std::size_t>(behind)] = revision_;
  }
}

void TsdfMap::free_block(Chunk& c, int slot) noexcept {
  const auto s = static_cast<std::size_t>(slot);
  c.free[s] = shrink_free(block_free(c.block[s]));
  if (c.free[s] != ~0ULL) c.settled[s >> 6U] &= ~(1ULL << (s & 63U));
  drop_block(c, slot);
}

void TsdfMap::drop_block(Chunk& c, int slot) noexcept {
  const auto s = static_cast<std::size_t>(slot);
  const std::int32_t b = c.block[s];
  c.block[s] = kNoBlock;
  link(coords_[static_cast<std::size_t>(b)], kNoBlock);
  release_labels(b);
  --c.blocks;
  --live_blocks_;
  in_use_[static_cast<std::size_t>(b)] = 0;
  recycled_[static_cast<std::size_t>(recycled_count_++)] = b;
}

void TsdfMap::clear_nodes(Chunk& c, int slot, const std::array<int, 3>& lo,
                          const std::array<int, 3>& hi) noexcept {
  const auto s = static_cast<std::size_t>(slot);
  const std::int32_t b = c.block[s];
  std::array<std::uint64_t, 8> bits{};
  std::uint64_t* free =
      b == kNoBlock ? bits.data() : free_.data() + static_cast<std::ptrdiff_t>(b) * 8;
  if (b == kNoBlock) expand_free(c.free[s], free);
  if (b != kNoBlock) changed_[static_cast<std::size_t>(b)] = revision_;
  LabelVoxel* labels = b == kNoBlock ? nullptr : const_cast<LabelVoxel*>(block_labels(b));
  for (int x = lo[0]; x <= hi[0]; ++x)
    for (int y = lo[1]; y <= hi[1]; ++y)
      for (int z = lo[2]; z <= hi[2]; ++z) {
        free[x] &= ~(1ULL << (y * 8 + z));
        if (b == kNoBlock) continue;
        const auto n = static_cast<std::size_t>(b) * kBlockVoxels +
                       static_cast<std::size_t>(in_block(x, y, z));
        words_[n] = colours_[n] = 0;
        if (labels != nullptr) labels[in_block(x, y, z)] = {};
      }
  if (b == kNoBlock) {
    c.free[s] = shrink_free(free);
    if (c.free[s] != ~0ULL) c.settled[s >> 6U] &= ~(1ULL << (s & 63U));
  } else if (std::all_of(block_words(b), block_words(b) + kBlockVoxels,
                         [](std::uint32_t w) { return word_weight(w) == 0; })) {
    free_block(c, slot);
  } else if (labels != nullptr) {
    static_cast<void>(store_labels(b, {labels, kBlockVoxels}));  // what is left of them
  }
}

void TsdfMap::clear_region(const Eigen::AlignedBox3d& box_W) noexcept {
  ++revision_;
  in_view_count_ = 0;  // blocks may go
  if (box_W.isEmpty() || !box_W.min().allFinite() || !box_W.max().allFinite()) return;
  std::array<int, 3> lo{}, hi{};  // first and last node inside
  for (std::size_t a = 0; a < 3; ++a) {
    const auto i = static_cast<Eigen::Index>(a);
    constexpr double kLimit = 8.0 * kMaxBlockCoord;
    lo[a] = static_cast<int>(std::ceil(std::clamp(box_W.min()(i) / voxel_, -kLimit, kLimit)));
    hi[a] = static_cast<int>(std::floor(std::clamp(box_W.max()(i) / voxel_, -kLimit, kLimit)));
    if (lo[a] > hi[a]) return;
  }
  clear_far_region(box_W);
  for (int n = 0; n < chunk_count_; ++n) {
    Chunk& c = chunks_[static_cast<std::size_t>(n)];
    if (c.coord == kNowhere) continue;
    const std::array<int, 3> base{c.coord.x * 64, c.coord.y * 64, c.coord.z * 64};
    bool apart = false;
    for (std::size_t a = 0; a < 3; ++a) apart |= base[a] > hi[a] || base[a] + 63 < lo[a];
    if (apart) continue;
    for (int slot = 0; slot < kChunkBlocks; ++slot) {
      const std::array<int, 3> node{base[0] + (slot >> 6) * kChunkEdgeBlocks,
                                    base[1] + ((slot >> 3) & 7) * kChunkEdgeBlocks,
                                    base[2] + (slot & 7) * kChunkEdgeBlocks};
      std::array<int, 3> from{}, to{};
      bool touched = true;
      for (std::size_t a = 0; a < 3; ++a) {
        from[a] = std::max(lo[a] - node[a], 0);
        to[a] = std::min(hi[a] - node[a], 7);
        touched &= from[a] <= to[a];
      }
      if (touched && (c.block[static_cast<std::size_t>(slot)] != kNoBlock ||
                      c.free[static_cast<std::size_t>(slot)] != 0))
        clear_nodes(c, slot, from, to);
    }
  }
}

TsdfMap::Arrays TsdfMap::arrays() const noexcept {
  static_assert(sizeof(Chunk) % sizeof(std::int32_t) == 0);
  constexpr auto kStride = static_cast<std::int32_t>(sizeof(Chunk) / sizeof(std::int32_t));
  return {chunks_.front().block.data(),
          reinterpret_cast<const std::int32_t*>(words_.data()),
          ahead_.data(),
          kStride,
          config_.max_chunks * kStride,
          config_.max_blocks};
}

std::int32_t TsdfMap::find_block(BlockCoord b) const noexcept {
  const Chunk* c = find_chunk(b.x >> 3, b.y >> 3, b.z >> 3);
  return c == nullptr ? kNoBlock : c->block[static_cast<std::size_t>(in_chunk(b.x, b.y, b.z))];
}

std::uint32_t TsdfMap::word_at(int i, int j, int k) const noexcept {
  const std::int32_t b = find_block({i >> 3, j >> 3, k >> 3});
  return b == kNoBlock ? 0U : block_words(b)[in_block(i, j, k)];
}

LabelVoxel TsdfMap::label_at(int i, int j, int k) const noexcept {
  const std::int32_t b = find_block({i >> 3, j >> 3, k >> 3});
  const LabelVoxel* labels = b == kNoBlock ? nullptr : block_labels(b);
  return labels == nullptr ? LabelVoxel{} : labels[in_block(i, j, k)];
}

bool TsdfMap::free_at(int i, int j, int k) const noexcept {
  const Chunk* c = find_chunk(i >> 6, j >> 6, k >> 6);
  if (c == nullptr) return false;
  const auto slot = static_cast<std::size_t>(in_chunk(i >> 3, j >> 3, k >> 3));
  const std::int32_t b = c->block[slot];
  if (b == kNoBlock) {
    const int cell = ((((i & 7) >> 1) * 4) + ((j & 7) >> 1)) * 4 + ((k & 7) >> 1);
    return ((c->free[slot] >> cell) & 1U) != 0;
  }
  const std::uint32_t word = block_words(b)[in_block(i, j, k)];
  if (word_weight(word) >= kObservedWeight) return word_distance(word) > 0;
  return ((block_free(b)[i & 7] >> ((j & 7) * 8 + (k & 7))) & 1U) != 0;
}

Seen TsdfMap::seen_at(int i, int j, int k) const noexcept {
  if (word_weight(word_at(i, j, k)) >= kObservedWeight) return Seen::kBand;
  return free_at(i, j, k) ? Seen::kFree : Seen::kUnknown;
}

std::uint64_t TsdfMap::checksum() const noexcept {
  rt::Hash64 h;
  for (int n = 0; n < chunk_count_; ++n) {
    const Chunk& c = chunks_[static_cast<std::size_t>(n)];
    h.value(c.coord);
    h.bytes(c.block.data(), sizeof c.block);
    h.bytes(c.free.data(), sizeof c.free);
  }
  for_each_block([&](std::int32_t b, BlockCoord) {
    h.bytes(block_words(b), kBlockVoxels * sizeof(std::uint32_t));
    h.bytes(block_colours(b), kBlockVoxels * sizeof(std::uint32_t));
    if (block_labels(b) != nullptr) h.bytes(block_labels(b), kBlockVoxels * sizeof(LabelVoxel));
    h.bytes(block_free(b), 8 * sizeof(std::uint64_t));
  });
  for (std::int32_t r = 0; r < far_.slots(); ++r) {
    if (far_.at(r).first_page == FarStore::kNone) continue;
    FarStore::Reader reader(far_, r);
    std::array<std::uint8_t, FarStore::kPage> part;
    for (std::size_t n = 1; n > 0;) {
      n = std::min(part.size(), reader.left());
      static_cast<void>(reader.read({part.data(), n}));
      h.bytes(part.data(), n);
    }
    h.value(far_.at(r).labels);
  }
  return h.digest();
}

}  // namespace perception
