// Whole chunks as records (chunk_record.hpp) for map files, near and compressed alike. Not for use
// within a frame.
#pragma once

#include <cstdint>
#include <functional>
#include <span>

#include "perception/tsdf/pager/pager.hpp"
#include "rt/memory/non_realtime.hpp"

namespace perception {

using RecordFn = std::function<void(std::span<const std::uint8_t>)>;

// fn(record) for every chunk that holds anything, put away or not, in order of coordinates. The
// same content gives the same bytes.
void write_records(rt::NonRealtime&, const MapStore& store, const FarStore& far,
                   const RecordFn& fn);

enum class RecordTaken : std::uint8_t { kOk, kMalformed, kTwice, kNoRoom };
// Adds what write_records() wrote; beyond the pool it goes to the far store. On any other result
// than kOk the map is unchanged.
[[nodiscard]] RecordTaken take_record(rt::NonRealtime&, const MapStore& store, Pager& pager,
                                      std::span<const std::uint8_t> record);

}  // namespace perception
