// The fused scene: a sparse truncated signed distance field (Curless and Levoy 1996; Newcombe et
// al., KinectFusion, 2011; Niessner et al., voxel hashing, 2013), with colour, labels and free space.
//
// Grid      node (i,j,k) sits at p_W = (i,j,k) * voxel_size. 8^3 nodes make a block, 8^3 blocks a
//           chunk. Chunks are found through an open-addressing hash, blocks through the chunk's table.
// Voxel     one aligned 32-bit word: int16 distance (unit: truncation / 32767, positive outside) and
//           uint16 weight (unit: 1/128 of one full observation). Weight 0 = unknown, distance void.
//           Beside it, same index: colour (r, g, b), how often read, how often coloured.
// Labels    label and label weight of a voxel (perception/segmentation/label_vote.hpp), in a pool of
//           their own: only blocks in which something is labelled have them.
// Distance  projective: along the viewing ray, (depth - z) * |ray|, so |grad| need not be 1.
// Band      the truncation along the ray; at grazing angles up to three times that, with the distance
//           clipped to it, so that 2.5 voxels across the surface are known on either side.
// Blocks    allocated only where a ray passes through its band.
// Free      a node is seen free when a ray passed in front of its reading there: one bit a node in
//           blocks, one bit per 2^3 nodes (all of them, conservatively) where no block is; there a chunk
//           that was carved in the last frame waits for the next one every other time.
//           Free is not unknown.
// Memory    everything is allocated and touched in the constructor. A full pool loses nothing that
//           is stored: new blocks are refused and counted.
// Far       chunks farther than far_m from the camera can be put away, compressed without loss
//           (block_codec.hpp), and come back on approach: page(). Readers see only what is in the pool;
//           integrate() first brings back what its camera sees.
// Volume    with volume_m, nothing is kept outside of a cube of whole blocks, parallel to the grid, whose
//           centre lies half an edge in front of the first camera that was fused.
// Follow    a surface that moves slowly while it is looked at is followed (follow.cpp).
// Decay     with decay_half_life_s, what is not seen again loses weight and is unknown in the end.
// Order     every result is a function of the sequence of calls: same input, same bytes.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "config/schema.hpp"
#include "perception/geometry/camera_model.hpp"
#include "perception/geometry/image.hpp"
#include "perception/geometry/pose.hpp"
#include "perception/geometry/rgbd_frame.hpp"
#include "perception/segmentation/label_vote.hpp"
#include "perception/tsdf/blocks/chunk_directory.hpp"
#include "perception/tsdf/blocks/chunk_index.hpp"
#include "perception/tsdf/image/depth_pyramid.hpp"
#include "perception/tsdf/pager/far_store.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/sched/fork_join.hpp"

namespace perception {

struct UpdateCamera;  // voxel_update.hpp
class CameraBoxes;    // frame_view.hpp
struct AllocateScratch;
struct FollowScratch;
class SurfaceFollower;
struct BandJob;     // band_kernel.hpp
struct BlockImage;  // block_codec.hpp

struct TsdfConfig {
  double voxel_size_m = 0.01;
  double truncation_m = 0.05;  // at least 2.1 voxels, see effective_truncation()
  double min_depth_m = 0.2;    // nearer readings are ignored
  double max_depth_m = 5.0;    // farther readings carve free space up to here, no more
  double max_weight = 100;     // observations; a cap lets changes be learned
  std::string weighting =
      "uniform";              // or "range": weight falls with the noise, (1.5 m / z)^2, >= 1/4
  double edge_base_m = 0.04;  // a reading is on a depth edge when a neighbour differs by more than
  double edge_per_m = 0.02;   // edge_base_m + edge_per_m * z; edges carve but are not fused
  double colour_band_m = 0.02;   // colour is fused this near to the surface
  int max_blocks = 32768;        // about 4.2 KiB each
  int max_chunks = 4096;         // about 6.2 KiB each
  int max_label_blocks = 2048;   // 1 KiB each; an object of 30 cm takes about 150
  double far_m = 6.0;            // put away beyond; raised to max_depth_m + 1 m
  int far_store_kib = 16384;     // of what is put away, about 0.8 KiB a block; 0: nothing is
  double volume_m = 0;           // edge of a cube in front of the first camera, or 0: unbounded
  double decay_half_life_s = 0;  // of the weight of what is not seen again; 0: never
  bool follow = true;            // surfaces that move slowly (follow.cpp)

  void describe(config::Section& s);
  // truncation_m, raised to 2.1 voxels where the voxels are coarse.
  [[nodiscard]] double effective_truncation() const noexcept;
  // far_m, raised so that what a camera fuses is never put away.
  [[nodiscard]] double effective_far() const noexcept;
};

// What is fused. Colour is registered to depth; empty (data == nullptr) where there is none.
struct FrameView {
  Intrinsics intrinsics{};
  ImageView<const std::uint16_t> depth_mm{};  // 0 and 65535 = no reading
  ImageView<const Rgb> colour{};
  ImageView<const std::uint8_t> moving{};  // not 0: carves, is not fused; empty: nothing moves
  bool follow = true;                      // surfaces that move slowly (follow.cpp)
  Eigen::AlignedBox3d follow_W{};          // in this box; empty: everywhere

  [[nodiscard]] static FrameView of(const RgbdFrame& f) noexcept {
    return {f.intrinsics, f.depth(), f.has_colour ? f.rgb() : ImageView<const Rgb>{}};
  }
};

// Deterministic work counts of one integrate(); a job's cost follows them.
struct IntegrateStats {
  bool refused = false;     // pose or image not usable: the map is unchanged
  std::int32_t pixels = 0;  // readings in range, edges excluded
  std::int32_t rays = 0;    // readings whose band was allocated
  std::int32_t blocks_new = 0;
  std::int32_t blocks_refused = 0;  // fault when > 0: block pool or chunk pool full (band lost)
  std::int32_t chunks_refused = 0;  // free space that found no chunk
  std::int32_t blocks_updated = 0;
  std::int64_t voxels_fused = 0;    // inside the band
  std::int64_t voxels_carved = 0;   // known voxels seen through
  std::int64_t free_tests = 0;      // cubes tested for free space
  std::int32_t blocks_fetched = 0;  // that were put away and are in view
  std::int32_t blocks_moved = 0;    // with their surface
  std::int64_t follow_tests = 0;    // readings compared for that, and nodes of what was looked at
};

// Of one page() or fetch_view(). Counts are of chunks unless they say otherwise.
struct PageStats {
  std::int32_t put_away = 0, brought_back = 0;
  std::int32_t blocks_moved = 0;
  std::int32_t waiting = 0;         // near, and left for the next call: the budget was spent
  std::int32_t refused = 0;         // fault when > 0: near, and the pool has no room for it
  std::int32_t not_stored = 0;      // far, and the far store is full: stays in the pool
  std::int32_t labels_refused = 0;  // came back without labels: their pool is full
};

// Of one vote_labels().
struct LabelStats {
  bool refused = false;  // no frame, or an image of another size: nothing voted
  std::int32_t blocks_voted = 0, blocks_new = 0;
  std::int32_t blocks_refused = 0;  // pool full: what they show stays unlabelled
};

// Thread CPU of the stages of the last integrate(), ns; filled only while profile(true).
struct IntegrateTimes {
  std::int64_t ready = 0, allocate = 0, update = 0, carve = 0;
};

struct BlockCoord {
  std::int32_t x = 0, y = 0, z = 0;  // block (x,y,z) holds nodes 8x..8x+7, ...
  friend bool operator==(const BlockCoord&, const BlockCoord&) = default;
};

enum class Seen : std::uint8_t { kUnknown = 0, kFree = 1, kBand = 2 };

class TsdfMap {
 public:
  static constexpr int kBlockShift = 3, kBlockEdge = 8, kBlockVoxels = 512;
  static constexpr int kChunkShift = 6;       // of nodes: 64 along an edge
  static constexpr int kChunkBlocks = 512;    // 8^3
  static constexpr int kWeightOne = 128;      // raw weight of one full observation
  static constexpr int kDistanceOne = 32767;  // raw distance of one truncation
  static constexpr std::int32_t kNoBlock = -1;
  static constexpr std::int32_t kMaxBlockCoord = 1 << 19;  // |coordinate| beyond is refused

  static constexpr int kObservedWeight = 2 * kWeightOne;  // "observed": two full observations

  // Throws std::invalid_argument naming the key, value and range.
  TsdfMap(rt::NonRealtime&, const TsdfConfig&);
  ~TsdfMap();
  TsdfMap(const TsdfMap&) = delete;
  TsdfMap& operator=(const TsdfMap&) = delete;

  // Fuses one frame. pixel_step (1, 2, 4, 8) thins the rays that allocate; all voxels of the
  // blocks in view are always updated. X_WC: camera (optical frame) in the world, rigid.
  IntegrateStats integrate(const FrameView& frame, const Pose& X_WC, int pixel_step) noexcept;

  // The label image of the frame that was last integrated, same pixels, votes: 0 background, 1 ..
  // kMostLabel an object, anything else says nothing. Once a frame. A block that holds no label gets
  // room for them when the image shows one in it; what background would have said there in the
  // images so far is then taken from the voxel's own observations. `fresh`: see vote_at().
  LabelStats vote_labels(ImageView<const std::uint8_t> labels, std::uint8_t fresh = 0) noexcept;

  // Threads that take part in integrate(); the bytes are the same for any number.
  void use(rt::ForkJoin& crew) noexcept { crew_ = &crew; }
  void profile(bool on) noexcept { profiling_ = on; }
  [[nodiscard]] const IntegrateTimes& last_times() const noexcept { return times_; }

  // Forgets everything; map_id() changes.
  void clear() noexcept;
  // Voxels, colour, labels and free space of the nodes in the closed box become unknown; blocks left
  // without any weight go back to the pool. What is put away and reaches into the box comes back
  // for it; without room in the pool it is forgotten whole.
  void clear_region(const Eigen::AlignedBox3d& box_W) noexcept;
  // Once a frame, dt_s after the one before: every weight falls with decay_half_life_s, a kDecayRound-th
  // of the blocks a call. A voxel below a quarter observation becomes unknown.
  static constexpr int kDecayRound = 32;
  void decay(double dt_s) noexcept;

  // --- far from the camera (far_blocks.cpp)
  // Once a frame: puts away what lies beyond far_m of every anchor (camera, hand) and out of the last
  // image, brings back what an anchor has come near to. Each of the two ends when about block_budget
  // blocks were moved; one chunk more than that may be.
  PageStats page(std::span<const Vec3> anchors_W, int block_budget) noexcept;
  // Brings back what this camera can see; where the pool is full, puts away what is farthest from it and
  // not in view. `waiting` or `refused` tell that it is not all there yet.
  PageStats fetch_view(const Intrinsics& k, const Pose& X_WC, int block_budget) noexcept;
  [[nodiscard]] int far_block_count() const noexcept { return far_.blocks(); }
  [[nodiscard]] int far_chunk_count() const noexcept { return far_.size(); }
  [[nodiscard]] const FarStore& far_store() const noexcept { return far_; }

  // --- whole chunks as records (chunk_record.hpp), for map files. Not for the frame step.
  // fn(record) for every chunk that holds anything, put away or not, in order of coordinates. The same
  // content gives the same bytes.
  using RecordFn = std::function<void(std::span<const std::uint8_t>)>;
  void write_records(rt::NonRealtime&, const RecordFn& fn) const;
  enum class Taken : std::uint8_t { kOk, kMalformed, kTwice, kNoRoom };
  // Adds what write_records() wrote; beyond the pool it goes to the far store. On any other result
  // than kOk the map is unchanged.
  [[nodiscard]] Taken take_record(rt::NonRealtime&, std::span<const std::uint8_t> record);

  [[nodiscard]] const TsdfConfig& config() const noexcept { return config_; }
  [[nodiscard]] double voxel_size() const noexcept { return voxel_; }
  [[nodiscard]] double truncation() const noexcept { return truncation_; }
  [[nodiscard]] float metres_per_unit() const noexcept { return metres_per_unit_; }
  [[nodiscard]] std::uint32_t map_id() const noexcept { return map_id_; }
  [[nodiscard]] int block_count() const noexcept { return live_blocks_; }
  // Chunk numbers are below it; those not in use hold nothing and stand at no place a camera can be.
  [[nodiscard]] int chunk_count() const noexcept { return chunk_count_; }
  [[nodiscard]] std::size_t memory_bytes() const noexcept;  // held, whether in use or not
  // Of all stored words, colours, labels and free bits, in allocation order, and of what is put away.
  [[nodiscard]] std::uint64_t checksum() const noexcept;

  // --- word layout
  [[nodiscard]] static constexpr std::int16_t word_distance(std::uint32_t w) noexcept {
    return static_cast<std::int16_t>(w & 0xffffU);
  }
  [[nodiscard]] static constexpr std::uint16_t word_weight(std::uint32_t w) noexcept {
    return static_cast<std::uint16_t>(w >> 16U);
  }
  [[nodiscard]] static constexpr std::uint32_t make_word(int distance, int weight) noexcept {
    return (static_cast<std::uint32_t>(distance) & 0xffffU) |
           (static_cast<std::uint32_t>(weight) << 16U);
  }
  // Index of node (x,y,z) within its block, 0 <= x,y,z < 8; z runs fastest.
  [[nodiscard]] static constexpr int in_block(int x, int y, int z) noexcept {
    return (((x & 7) << 3 | (y & 7)) << 3) | (z & 7);
  }

  // --- blocks, by pool index; live blocks are those with in_use().
  [[nodiscard]] std::int32_t find_block(BlockCoord b) const noexcept;      // kNoBlock when absent
  [[nodiscard]] int block_slots() const noexcept { return used_blocks_; }  // indices 0..slots-1
  [[nodiscard]] bool in_use(std::int32_t block) const noexcept {
    return in_use_[static_cast<std::size_t>(block)] != 0;
  }
  [[nodiscard]] BlockCoord block_coord(std::int32_t block) const noexcept {
    return coords_[static_cast<std::size_t>(block)];
  }
  [[nodiscard]] const std::uint32_t* block_words(std::int32_t block) const noexcept {
    return words_.data() + static_cast<std::size_t>(block) * kBlockVoxels;
  }
  // Colour, how often read and how often coloured (perception/geometry/no_colour.hpp).
  [[nodiscard]] const std::uint32_t* block_colours(std::int32_t block) const noexcept {
    return colours_.data() + static_cast<std::size_t>(block) * kBlockVoxels;
  }
  // 8 words, bit (y * 8 + z) of word x.
  [[nodiscard]] const std::uint64_t* block_free(std::int32_t block) const noexcept {
    return free_.data() + static_cast<std::size_t>(block) * 8;
  }
  // 512 of the block; nullptr where nothing is labelled.
  [[nodiscard]] const LabelVoxel* block_labels(std::int32_t block) const noexcept {
    const std::int32_t at = label_of_block_[static_cast<std::size_t>(block)];
    return at < 0 ? nullptr : label_pool_.data() + static_cast<std::size_t>(at) * kBlockVoxels;
  }
  // Of one voxel; where the block holds none, the background that the images so far imply.
  [[nodiscard]] LabelVoxel label_in(std::int32_t block, int voxel) const noexcept {
    const LabelVoxel* held = block_labels(block);
    return held != nullptr ? held[voxel] : implied_background(block_words(block)[voxel]);
  }
  // Bit n: label n > 0 occurs in the block.
  [[nodiscard]] std::uint32_t labels_present(std::int32_t block) const noexcept {
    const std::int32_t at = label_of_block_[static_cast<std::size_t>(block)];
    return at < 0 ? 0U : label_bits_[static_cast<std::size_t>(at)];
  }
  // Sets the labels of a block; without any label > 0 it holds none afterwards. False: pool full.
  bool store_labels(std::int32_t block, std::span<const LabelVoxel> labels) noexcept;
  [[nodiscard]] int label_block_count() const noexcept { return label_blocks_; }
  // fn(pool index of the block, bits of its labels), in order of the label pool.
  template <class Fn>
  void for_each_label_block(Fn&& fn) const {
    for (int n = 0; n < label_used_; ++n)
      if (block_of_label_[static_cast<std::size_t>(n)] != kNoBlock)
        fn(block_of_label_[static_cast<std::size_t>(n)], label_bits_[static_cast<std::size_t>(n)]);
  }
  // Every voxel of this label becomes unlabelled.
  void forget_label(std::uint8_t label) noexcept;
  // fn(pool index, BlockCoord) for every live block, in order of pool index.
  template <class Fn>
  void for_each_block(Fn&& fn) const {
    for (std::int32_t b = 0; b < used_blocks_; ++b)
      if (in_use(b)) fn(b, coords_[static_cast<std::size_t>(b)]);
  }

  // --- what has changed since when. revision() rises with every call that may change blocks.
  [[nodiscard]] std::uint32_t revision() const noexcept { return revision_; }
  // Of the last call that changed anything the block's cells reach: its own voxels (a decay counts where it
  // makes observed voxels others), or those of the blocks one to the x, y, z, or that these are there.
  [[nodiscard]] std::uint32_t cells_revision(std::int32_t block) const noexcept {
    std::uint32_t newest = 0;
    const std::int32_t* ahead = ahead_.data() + static_cast<std::size_t>(block) * 8;
    for (int n = 0; n < 8; ++n)
      newest = std::max(newest, changed_[static_cast<std::size_t>(ahead[n])]);
    return newest;
  }

  // --- for vector kernels: the arrays themselves. Chunk n's table of block numbers begins at
  // n * table_stride; table `empty_table` holds no block, block `empty_block` holds zeros. ahead[8 b + n]:
  // the block one to the x (n bit 2), y (bit 1), z (bit 0) of block b; empty_block where none is.
  struct Arrays {
    const std::int32_t* tables;
    const std::int32_t* words;
    const std::int32_t* ahead;
    std::int32_t table_stride, empty_table, empty_block;
  };
  [[nodiscard]] Arrays arrays() const noexcept;

  // --- single nodes (any world node; slow, see MapReader for runs of reads)
  [[nodiscard]] std::uint32_t word_at(int i, int j, int k) const noexcept;  // 0 when unknown
  // Seen free: an observed voxel by its sign, any other by its bit.
  [[nodiscard]] bool free_at(int i, int j, int k) const noexcept;
  [[nodiscard]] LabelVoxel label_at(int i, int j, int k) const noexcept;
  // kBand: weight >= 2 observations; else free or unknown.
  [[nodiscard]] Seen seen_at(int i, int j, int k) const noexcept;

  // --- chunks: what raycast, patch copy and the readers walk.
  struct Chunk {
    std::array<std::int32_t, kChunkBlocks> block;  // pool index or kNoBlock
    std::array<std::uint64_t, kChunkBlocks> free;  // one bit per 2^3 nodes, bit (x*4+y)*4+z
    std::array<std::uint64_t, 8> settled;  // bit by*8+bz of word bx: block allocated, or all free
    BlockCoord coord;                      // in chunks
    std::int32_t blocks;                   // allocated
    std::uint32_t carved;                  // frame that last carved here
  };
  [[nodiscard]] const Chunk* find_chunk(int cx, int cy, int cz) const noexcept;
  [[nodiscard]] const Chunk& chunk(int n) const noexcept {  // n < chunk_count(), allocation order
    return chunks_[static_cast<std::size_t>(n)];
  }
  [[nodiscard]] static constexpr int in_chunk(int bx, int by, int bz) noexcept {
    return (((bx & 7) << 3 | (by & 7)) << 3) | (bz & 7);
  }

 private:
  struct InView {
    std::int32_t block;
    bool inside;  // every node falls into the image
  };
  struct View;  // one frame's camera, in floats (integrate.cpp)

  // Makes it, or brings it back; nullptr: pool full.
  Chunk* chunk_for(int cx, int cy, int cz, IntegrateStats&) noexcept;
  Chunk* new_chunk(BlockCoord at) noexcept;  // nullptr: pool full
  void drop_chunk(std::int32_t number) noexcept;
  // A block of unknown voxels, its free bits void; kNoBlock: pool full.
  std::int32_t new_block(Chunk& c, BlockCoord at) noexcept;
  void drop_block(Chunk& c, int slot) noexcept;
  [[nodiscard]] int free_blocks() const noexcept {
    return config_.max_blocks - used_blocks_ + recycled_count_;
  }
  [[nodiscard]] bool fits(const FarStore::Record& r) const noexcept;
  [[nodiscard]] bool put_away(std::int32_t number) noexcept;
  // Of a record that fits.
  void bring_back(std::int32_t record, PageStats& stats) noexcept;
  template <class Source>
  void restore_chunk(Source& source, std::uint32_t labels, PageStats& stats) noexcept;
  template <class Sink>
  bool write_chunk(const Chunk& c, std::uint32_t carved, Sink& sink) const noexcept;
  template <class Sink>
  void rewrite_record(std::int32_t record, Sink& sink) const;
  // Puts away what is farthest from `centre` and not in view, until the record fits.
  bool make_room(const FarStore::Record& r, const CameraBoxes& boxes, const Vec3& centre,
                 PageStats& stats) noexcept;
  void fetch_boxes(const CameraBoxes& boxes, const Vec3& centre, int budget, bool evict,
                   PageStats& stats) noexcept;
  [[nodiscard]] bool seen_from(const CameraBoxes& boxes, BlockCoord chunk) const noexcept;
  void clear_far_region(const Eigen::AlignedBox3d& box_W) noexcept;
  [[nodiscard]] double distance_to_chunk(const Vec3& p_W, int x, int y, int z) const noexcept;
  bool decay_block(std::int32_t block, std::uint32_t keep) noexcept;
  // Makes the block exist. `near` is a chunk to try first (or null); returns the one to try next.
  Chunk* touch_block(int bx, int by, int bz, Chunk* near, IntegrateStats&) noexcept;
  void free_block(Chunk& c, int slot) noexcept;
  // Block number `block` now stands (kNoBlock: no longer) at `at`: tells those behind it.
  void link(BlockCoord at, std::int32_t block) noexcept;
  void clear_nodes(Chunk& c, int slot, const std::array<int, 3>& lo,
                   const std::array<int, 3>& hi) noexcept;
  void allocate_band(const View&, int pixel_step, IntegrateStats&) noexcept;
  void find_in_band(const View&, const BandJob&, int pixel_step, int skip, int band) noexcept;
  void update_blocks(const View&, IntegrateStats&) noexcept;
  void update_range(const View&, const UpdateCamera&, int first, int last,
                    IntegrateStats&) noexcept;
  void carve(const View&, IntegrateStats&) noexcept;
  friend class SurfaceFollower;
  void follow(const View&, IntegrateStats&) noexcept;
  void place_volume(const Pose& X_WC) noexcept;
  // Of an aligned cube of nodes, its first node and edge: whether any, or all, of it may be kept.
  [[nodiscard]] bool meets_volume(const std::array<int, 3>& node0, int edge) const noexcept;
  [[nodiscard]] bool in_volume(const std::array<int, 3>& node0, int edge) const noexcept;
  void carve_cube(const View&, Chunk*& c, const std::array<int, 3>& node0, int edge,
                  IntegrateStats&) noexcept;
  [[nodiscard]] UpdateCamera update_camera(const Intrinsics& k, const Pose& X_CW) const noexcept;
  void release_labels(std::int32_t block) noexcept;
  // Of a voxel without room for labels, as the images so far would have left it: background, if it lies
  // within the band of the surface, with a weight of the images that can have seen it.
  [[nodiscard]] LabelVoxel implied_background(std::uint32_t word) const noexcept {
    const int units = word_distance(word);
    const bool near =
        static_cast<float>(units < 0 ? -units : units) * metres_per_unit_ <= kLabelBand_m;
    const int seen = word_weight(word) / kWeightOne;
    return {0, static_cast<std::uint8_t>(near ? (seen < label_images_ ? seen : label_images_) : 0)};
  }
  void mark_tiles(ImageView<const std::uint8_t> labels) noexcept;
  [[nodiscard]] bool shows_label(std::int32_t block, const CameraBoxes& boxes) const noexcept;
  static bool is_settled(const Chunk& c, const std::array<int, 3>& local, int edge) noexcept;
  static void set_free(Chunk& c, const std::array<int, 3>& local, int edge) noexcept;

  TsdfConfig config_;
  double voxel_ = 0, truncation_ = 0;
  float metres_per_unit_ = 0;
  std::uint32_t map_id_ = 1;

  ChunkIndex index_;
  std::vector<Chunk> chunks_;
  std::vector<std::int32_t> recycled_chunks_;
  int chunk_count_ = 0, recycled_chunk_count_ = 0;
  FarStore far_;
  std::unique_ptr<BlockImage> unpacked_;  // room for one
  int decay_at_ = 0;                      // next of kDecayRound parts

  bool bounded_ = false;
  std::array<int, 3> volume_first_{}, volume_end_{};  // nodes, multiples of 8
  std::vector<std::uint32_t> words_, colours_;
  std::vector<std::uint64_t> free_;
  std::vector<BlockCoord> coords_;
  std::vector<std::int32_t> ahead_;
  std::vector<std::uint32_t> changed_;  // revision of the last call that did
  std::uint32_t revision_ = 1;
  std::vector<std::uint8_t> in_use_;
  std::vector<std::int32_t> recycled_;  // stack of returned pool indices
  std::vector<InView> in_view_;         // of the frame being fused
  std::vector<Chunk*> to_carve_;        // of the frame being fused
  int used_blocks_ = 0, recycled_count_ = 0, live_blocks_ = 0;
  // The frame last integrated, for the votes on it; in_view_count_ 0: there is none.
  int in_view_count_ = 0;
  Intrinsics last_camera_{};
  Pose X_CW_last_ = Pose::Identity();

  std::vector<LabelVoxel> label_pool_;
  std::vector<std::uint32_t> label_bits_;
  std::vector<std::int32_t> label_of_block_, block_of_label_, label_recycled_;
  int label_used_ = 0, label_recycled_count_ = 0, label_blocks_ = 0;
  int label_images_ = 0;  // that voted, up to the cap
  static constexpr BlockCoord kNowhere{-(1 << 24), -(1 << 24), -(1 << 24)};
  static constexpr std::size_t kMostFarChunks = 1U << 15U;
  static constexpr int kTile = 16;
  std::array<std::uint64_t, (DepthPyramid::kMaxHeight + kTile - 1) / kTile> label_tiles_{};
  static_assert(DepthPyramid::kMaxWidth <= 64 * kTile);

  bool range_weight_ = false, profiling_ = false;
  std::uint32_t frame_ = 0;  // of integrate()
  IntegrateTimes times_;
  DepthPyramid pyramid_;
  ChunkDirectory directory_;  // round the camera of the frame being fused
  std::unique_ptr<AllocateScratch> allocate_;
  std::unique_ptr<FollowScratch> follow_;
  rt::ForkJoin* crew_ = &rt::serial();
};

}  // namespace perception
