#include "perception/tsdf/pager/map_records.hpp"

#include <algorithm>
#include <array>
#include <memory>
#include <utility>
#include <vector>

#include "perception/tsdf/pager/chunk_io.hpp"

namespace perception {
namespace {

bool any_free(const FreeCells& cells) noexcept {
  return std::any_of(cells.begin(), cells.end(), [](std::uint64_t c) { return c != 0; });
}

std::uint32_t labels_of(std::span<const LabelVoxel> voxels) noexcept {
  std::uint32_t bits = 0;
  for (const LabelVoxel& v : voxels) bits |= 1U << (v.label & 31U);
  return bits & ~1U;
}

// As a resident chunk would be written: not carved of late, without forgotten labels.
template <class Sink>
void rewrite_record(const FarStore& far, std::int32_t record, Sink& sink) {
  FarStore::Reader reader(far, record);
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
      if (v.label != 0 && ((far.at(record).labels >> v.label) & 1U) == 0) v = {};
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

// All of it is read before any of it is stored. False: malformed.
bool check_record(std::span<const std::uint8_t> bytes, BlockImage& room, FarStore::Record& about) {
  SpanSource check(bytes);
  ChunkHead head;
  FreeCells cells;
  constexpr int kFarthest = MapLayout::kMaxBlockCoord / 8;
  const auto outside = [](int c) { return c < -kFarthest || c >= kFarthest; };
  if (!check.read(bytes_into(head)) || outside(head.x) || outside(head.y) || outside(head.z) ||
      head.blocks > MapLayout::kChunkBlocks || head.carved != 0 || !read_cells(check, cells))
    return false;
  std::uint32_t labels = 0;
  int labelled = 0, last = -1;
  for (int n = 0; n < head.blocks; ++n) {
    std::uint16_t slot = 0;
    if (!read_block(check, slot, room) || slot <= last) return false;
    last = slot;
    if (!room.labelled) continue;
    const std::uint32_t bits = labels_of(room.labels);
    if (bits == 0) return false;
    ++labelled;
    labels |= bits;
  }
  if (check.left() != 0 || labelled != head.label_blocks || labels != head.labels) return false;
  about.x = head.x, about.y = head.y, about.z = head.z;
  about.blocks = head.blocks, about.label_blocks = head.label_blocks, about.labels = head.labels;
  return true;
}

struct Place {
  BlockCoord at;
  std::int32_t chunk, record;  // the number of one of them, the other kNone
};

}  // namespace

void write_records(rt::NonRealtime&, const MapStore& store, const FarStore& far,
                   const RecordFn& fn) {
  std::vector<Place> places;
  for (std::int32_t n = 0; n < store.blocks.chunk_count(); ++n) {
    const MapLayout::Chunk& c = store.blocks.chunk(n);
    if (c.coord == MapLayout::kNowhere) continue;
    if (c.blocks > 0 || any_free(c.free)) places.push_back({c.coord, n, FarStore::kNone});
  }
  for (std::int32_t r = 0; r < far.slots(); ++r) {
    const FarStore::Record& record = far.at(r);
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
      static_cast<void>(write_chunk(store, store.blocks.chunk(p.chunk), 0, sink));
    } else {
      rewrite_record(far, p.record, sink);
    }
    if (!bytes.empty()) fn(bytes);
  }
}

RecordTaken take_record(rt::NonRealtime&, const MapStore& store, Pager& pager,
                        std::span<const std::uint8_t> bytes) {
  FarStore::Record about;
  if (!check_record(bytes, pager.image(), about)) return RecordTaken::kMalformed;
  if (store.blocks.chunk_number(about.x, about.y, about.z) != ChunkIndex::kNone ||
      pager.far_store().find(about.x, about.y, about.z) != FarStore::kNone)
    return RecordTaken::kTwice;
  return pager.admit(about, bytes) ? RecordTaken::kOk : RecordTaken::kNoRoom;
}

}  // namespace perception
