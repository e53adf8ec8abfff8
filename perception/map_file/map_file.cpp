#include "perception/map_file/map_file.hpp"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>

#include "perception/tsdf/pager/chunk_record.hpp"
#include "rt/hash.hpp"

namespace perception {
namespace {

constexpr char kMagic[8] = {'t', 'e', 'l', 'e', 't', 'm', 'a', 'p'};
constexpr std::uint32_t kVersion = 2;

struct Header {
  char magic[8];
  std::uint32_t version, header_bytes;
  std::uint32_t chunks, blocks, keyframes;
  std::uint16_t cells_wide, cells_high;
  double voxel_size_m, truncation_m;
  std::uint64_t payload_bytes, payload_hash;
  std::uint64_t zeros[3];
  std::uint64_t header_hash;
};
static_assert(sizeof(Header) == kMapHeaderBytes);
constexpr std::size_t kHashed = kMapHeaderBytes - sizeof(std::uint64_t);

constexpr std::size_t kPoseBytes = 12 * sizeof(double);
constexpr std::size_t kKeyframeBytes = kPoseBytes + 2 * Thumbnail::kCells;
constexpr std::uint32_t kMostChunks = 1U << 17U;
constexpr double kMostTranslation_m = 1e6;

std::uint64_t hash_of(const void* data, std::size_t size) {
  rt::Hash64 h;
  h.bytes(data, size);
  return h.digest();
}

rt::Error error(const std::string& name, const std::string& what) {
  return rt::Error{name + ": " + what};
}

template <class T>
void put(std::string& out, const T& v) {
  out.append(reinterpret_cast<const char*>(&v), sizeof v);
}

std::string expected(const char* key, double value, const std::string& range) {
  return std::string(key) + " = " + std::to_string(value) + "; must be " + range;
}

// What a header may say of a file of this size.
std::string wrong_header(const Header& h, std::uint64_t file_bytes) {
  if (std::memcmp(h.magic, kMagic, sizeof kMagic) != 0) return "is not a map file";
  if (h.version != kVersion)
    return "is a map of version " + std::to_string(h.version) + "; this program reads version " +
           std::to_string(kVersion);
  if (hash_of(&h, kHashed) != h.header_hash) return "has a damaged header (wrong checksum)";
  if (h.header_bytes != kMapHeaderBytes || h.zeros[0] != 0 || h.zeros[1] != 0 || h.zeros[2] != 0 ||
      h.cells_wide != Thumbnail::kWidth || h.cells_high != Thumbnail::kHeight)
    return "has a header of another layout";
  if (h.payload_bytes != file_bytes - kMapHeaderBytes)
    return "holds " + std::to_string(file_bytes - kMapHeaderBytes) + " bytes behind its header; " +
           std::to_string(h.payload_bytes) + " are announced";
  if (!(h.voxel_size_m >= 0.002 && h.voxel_size_m <= 0.1))
    return expected("voxel_size_m", h.voxel_size_m, "0.002 to 0.1");
  if (!(h.truncation_m >= 0.005 && h.truncation_m <= 0.5))
    return expected("truncation_m", h.truncation_m, "0.005 to 0.5");
  if (h.keyframes > static_cast<std::uint32_t>(Keyframes::kMax))
    return expected("keyframes", h.keyframes, "at most " + std::to_string(Keyframes::kMax));
  if (h.chunks > kMostChunks)
    return expected("chunks", h.chunks, "at most " + std::to_string(kMostChunks));
  const std::uint64_t least = std::uint64_t{h.chunks} * (4 + kLeastRecordBytes) +
                              std::uint64_t{h.blocks} * (4 + kLeastBlockBytes) +
                              std::uint64_t{h.keyframes} * kKeyframeBytes;
  if (least > h.payload_bytes)
    return "announces " + std::to_string(h.chunks) + " chunks, " + std::to_string(h.blocks) +
           " blocks and " + std::to_string(h.keyframes) + " keyframes, more than " +
           std::to_string(h.payload_bytes) + " bytes can hold";
  return {};
}

bool read_keyframe(SpanSource& source, Pose& X_WC, Thumbnail& view) {
  double v[12];
  if (!source.read(bytes_into(v)) || !source.read(bytes_into(view.depth)) ||
      !source.read(bytes_into(view.grey)))
    return false;
  for (int i = 0; i < 9; ++i) X_WC.linear()(i / 3, i % 3) = v[i];
  X_WC.translation() = Vec3(v[9], v[10], v[11]);
  const Mat3 R = X_WC.linear();
  return X_WC.matrix().allFinite() &&
         X_WC.translation().cwiseAbs().maxCoeff() <= kMostTranslation_m &&
         (R.transpose() * R - Mat3::Identity()).cwiseAbs().maxCoeff() <= 1e-6 &&
         R.determinant() > 0;
}

// What does not fit, or is not of this map; empty: nothing.
std::string wrong_for(const MapFileInfo& info, const MapView& map) {
  if (std::abs(info.voxel_size_m - map.voxel_size()) > 1e-9)
    return "has voxels of " + std::to_string(info.voxel_size_m) + " m; this map needs " +
           std::to_string(map.voxel_size());
  if (std::abs(info.truncation_m - map.truncation()) > 1e-9)
    return "has a truncation of " + std::to_string(info.truncation_m) + " m; this map needs " +
           std::to_string(map.truncation());
  return {};
}

// The next chunk of `rest`; what is wrong with it, or nothing.
std::string take_chunk(rt::NonRealtime& nrt, const MapFileInfo& info,
                       std::span<const std::uint8_t>& rest, std::uint64_t& blocks, TsdfMap& map) {
  std::uint32_t bytes = 0;
  if (rest.size() < sizeof bytes) return "is missing";
  std::memcpy(&bytes, rest.data(), sizeof bytes);
  rest = rest.subspan(sizeof bytes);
  if (bytes < kLeastRecordBytes || bytes > kMostRecordBytes || bytes > rest.size())
    return "has " + std::to_string(bytes) + " bytes; must be " + std::to_string(kLeastRecordBytes) +
           " to what is left, " + std::to_string(std::min(kMostRecordBytes, rest.size()));
  const std::span<const std::uint8_t> record = rest.first(bytes);
  rest = rest.subspan(bytes);
  ChunkHead head;
  std::memcpy(&head, record.data(), sizeof head);
  blocks += head.blocks;
  switch (map.take_record(nrt, record)) {
    case TsdfMap::Taken::kOk:
      return {};
    case TsdfMap::Taken::kMalformed:
      return "is malformed";
    case TsdfMap::Taken::kTwice:
      return "is there twice";
    case TsdfMap::Taken::kNoRoom:
      break;
  }
  return "finds no room for the " + std::to_string(info.blocks) +
         " blocks of the map: tsdf.max_blocks = " + std::to_string(map.config().max_blocks) +
         ", tsdf.max_chunks = " + std::to_string(map.config().max_chunks) +
         ", tsdf.far_store_kib = " + std::to_string(map.config().far_store_kib);
}

}  // namespace

std::string encode_map(rt::NonRealtime& nrt, const TsdfMap& map, const Keyframes& keyframes) {
  std::string out(kMapHeaderBytes, '\0');
  Header h{};
  std::memcpy(h.magic, kMagic, sizeof kMagic);
  h.version = kVersion;
  h.header_bytes = kMapHeaderBytes;
  h.cells_wide = Thumbnail::kWidth, h.cells_high = Thumbnail::kHeight;
  h.voxel_size_m = map.voxel_size(), h.truncation_m = map.truncation();
  map.write_records(nrt, [&](std::span<const std::uint8_t> record) {
    ChunkHead head;
    SpanSource source(record);
    static_cast<void>(source.read(bytes_into(head)));
    ++h.chunks;
    h.blocks += head.blocks;
    put(out, static_cast<std::uint32_t>(record.size()));
    out.append(reinterpret_cast<const char*>(record.data()), record.size());
  });
  for (int i = 0; i < keyframes.size(); ++i) {
    const Keyframes::Entry& e = keyframes.at(i);
    for (int n = 0; n < 9; ++n) put(out, double{e.X_WC.linear()(n / 3, n % 3)});
    for (int n = 0; n < 3; ++n) put(out, double{e.X_WC.translation()(n)});
    put(out, e.view.depth);
    put(out, e.view.grey);
    ++h.keyframes;
  }
  std::memcpy(out.data(), &h, sizeof h);
  seal_map(nrt, out);
  return out;
}

void seal_map(rt::NonRealtime&, std::string& bytes) {
  if (bytes.size() < kMapHeaderBytes) return;
  Header h;
  std::memcpy(&h, bytes.data(), sizeof h);
  h.payload_bytes = bytes.size() - kMapHeaderBytes;
  h.payload_hash = hash_of(bytes.data() + kMapHeaderBytes, h.payload_bytes);
  h.header_hash = hash_of(&h, kHashed);
  std::memcpy(bytes.data(), &h, sizeof h);
}

rt::Result<MapFile> parse_map(rt::NonRealtime&, std::string bytes, const std::string& name) {
  if (bytes.size() < kMapHeaderBytes) return error(name, "is shorter than the header of a map");
  Header h;
  std::memcpy(&h, bytes.data(), sizeof h);
  const std::string wrong = wrong_header(h, bytes.size());
  if (!wrong.empty()) return error(name, wrong);
  if (hash_of(bytes.data() + kMapHeaderBytes, h.payload_bytes) != h.payload_hash)
    return error(name, "is damaged (wrong checksum)");
  MapFile file;
  file.name = name;
  file.info = {h.chunks, h.blocks, h.keyframes, h.voxel_size_m, h.truncation_m};
  file.bytes = std::move(bytes);
  return file;
}

rt::Result<MapFile> read_map_file(rt::NonRealtime& nrt, const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in) return error(path, std::string("can not be opened: ") + std::strerror(errno));
  std::error_code ignored;
  in.seekg(0, std::ios::end);
  const auto end = static_cast<std::streamoff>(in.tellg());
  if (end < 0 || std::filesystem::is_directory(path, ignored))
    return error(path, "is no plain file");
  const auto size = static_cast<std::uint64_t>(end);
  if (size > kMostMapBytes) return error(path, "is larger than 4 GiB");
  in.seekg(0);
  Header h{};
  if (size < sizeof h || !in.read(reinterpret_cast<char*>(&h), sizeof h))
    return error(path, "is shorter than the header of a map");
  const std::string wrong = wrong_header(h, size);
  if (!wrong.empty()) return error(path, wrong);
  std::string bytes(size, '\0');
  in.seekg(0);
  if (!in.read(bytes.data(), static_cast<std::streamsize>(size)))
    return error(path, "could not be read to its end");
  return parse_map(nrt, std::move(bytes), path);
}

rt::Result<bool> restore_map(rt::NonRealtime& nrt, const MapFile& file, TsdfMap& map,
                             Keyframes& keyframes) {
  map.clear();
  keyframes.clear();
  const auto fail = [&](const std::string& what) {
    map.clear();
    keyframes.clear();
    return error(file.name, what);
  };
  const std::string other = wrong_for(file.info, map);
  if (!other.empty()) return fail(other);
  std::span<const std::uint8_t> rest(
      reinterpret_cast<const std::uint8_t*>(file.bytes.data()) + kMapHeaderBytes,
      file.bytes.size() - kMapHeaderBytes);
  std::uint64_t blocks = 0;
  for (std::uint32_t n = 0; n < file.info.chunks; ++n) {
    const std::string wrong = take_chunk(nrt, file.info, rest, blocks, map);
    if (!wrong.empty()) return fail("chunk " + std::to_string(n) + " " + wrong);
  }
  if (blocks != file.info.blocks)
    return fail("holds " + std::to_string(blocks) + " blocks; its header says " +
                std::to_string(file.info.blocks));
  SpanSource source(rest);
  for (std::uint32_t n = 0; n < file.info.keyframes; ++n) {
    Keyframes::Entry e;
    if (!read_keyframe(source, e.X_WC, e.view))
      return fail("keyframe " + std::to_string(n) + " is malformed");
    keyframes.add(e.X_WC, e.view);
  }
  if (source.left() != 0) return fail("goes on behind its last keyframe");
  return true;
}

}  // namespace perception
