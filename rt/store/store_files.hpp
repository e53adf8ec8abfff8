// Names and frames of a store's files. A store is a folder:
//   header                      text: version, sizes of the records, the lines of a run file's
//                               header (rt/audit/run_file.hpp), "crc <of all before>"
//   whole-00000012              records of segment 12, in blocks; the newest is being written
//   part-00000012-00000017      what is kept of segments 12 to 17 (part.hpp)
//   end                         totals and lost records, as a part's frame; only of a run that
//                               ended
// There is no index: the folder's listing is one that can not be lost or be wrong.
//
// File of whole records, numbers little-endian:
//   magic "TLSG", version 1, segment, 0 (u32 each); then blocks:
//   magic "TLBK", size, CRC-32 of the payload (u32 each); payload: tagged records of this
//     machine's layout 'J' JobRecord   'S' SentinelRecord   'E' time (i64 ns), size (u8), text
// The first block whose frame or CRC is wrong ends the file: what a kill tore is left out.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace rt {

inline constexpr std::uint32_t kSegmentMagic = 0x47534c54, kBlockMagic = 0x4b424c54;
inline constexpr std::uint32_t kSegmentVersion = 1;
inline constexpr std::uint32_t kEndMagic = 0x444e4c54;  // "TLND"
inline constexpr const char* kStoreTitle = "teletact-store 1 ";

struct StoreFile {
  bool whole = false;  // else a part
  std::uint32_t first = 0, last = 0;
  std::uint64_t bytes = 0;

  [[nodiscard]] std::uint32_t segments() const noexcept { return last - first + 1; }
  [[nodiscard]] std::string name() const;
};

// None: not the name of one.
[[nodiscard]] std::optional<StoreFile> store_file_of(std::string_view name);
// Of a store, whichever file: the header, the end, and what a kill left half written, too.
[[nodiscard]] bool is_store_file(std::string_view name);

}  // namespace rt
