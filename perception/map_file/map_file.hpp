// Maps on disk: all chunks of a TsdfMap, near and compressed, and the keyframes for relocalisation.
// With it a camera finds itself again in a stored map.
//
//   header, 96 bytes, little-endian
//     0  "teletmap"              8  uint32 version (2)         12  uint32 bytes of the header (96)
//    16  uint32 chunks          20  uint32 blocks              24  uint32 keyframes
//    28  uint16 cells of a thumbnail: width, height            32  double voxel_size_m, truncation_m
//    48  uint64 bytes that follow                              56  uint64 Hash64 of them
//    64  zeros                                                 88  uint64 Hash64 of the 88 bytes before
//   chunks: uint32 bytes, then the record (tsdf/chunk_record.hpp), by rising coordinates
//   keyframes: 12 doubles (R_WC row by row, then t_WC in m), depth cells, brightness cells
//
// Version 1 did not count readings apart from colours and used black for missing colour. It is
// refused by its number. The same map gives the same bytes. The file may come from anywhere: the
// header is checked against the size of the file before memory is allocated, every number against
// what a map can hold, and nothing of a bad file is kept. Errors are one line: file, what, allowed
// range.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "perception/relocalisation/keyframes.hpp"
#include "perception/tsdf/tsdf_map.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/result.hpp"

namespace perception {

struct MapFileInfo {
  std::uint32_t chunks = 0, blocks = 0, keyframes = 0;
  double voxel_size_m = 0, truncation_m = 0;
};

// The bytes of a file whose header and hash were found right.
struct MapFile {
  std::string name;  // for messages
  MapFileInfo info;
  std::string bytes;
};

inline constexpr std::size_t kMapHeaderBytes = 96;
inline constexpr std::uint64_t kMostMapBytes = std::uint64_t{1} << 32U;

[[nodiscard]] std::string encode_map(rt::NonRealtime&, const TsdfMap& map,
                                     const Keyframes& keyframes);

[[nodiscard]] rt::Result<MapFile> parse_map(rt::NonRealtime&, std::string bytes,
                                            const std::string& name);
[[nodiscard]] rt::Result<MapFile> read_map_file(rt::NonRealtime&, const std::string& path);

// Replaces the content of both. The map's voxel and truncation must be the file's. On an error both
// are empty.
[[nodiscard]] rt::Result<bool> restore_map(rt::NonRealtime&, const MapFile& file, TsdfMap& map,
                                           Keyframes& keyframes);

// Recomputes both hashes, so that tests can reach the checks behind them. Does nothing for less
// than a header.
void seal_map(rt::NonRealtime&, std::string& bytes);

}  // namespace perception
