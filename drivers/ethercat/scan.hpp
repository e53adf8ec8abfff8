// Finds the slaves: counts them, gives addresses, reads what they are.
// Order of the steps: ETG.1000.6, annex on the master's start-up; the registers of each step are
// named in scan.cpp.
#pragma once

#include <vector>

#include "drivers/ethercat/register_access.hpp"
#include "drivers/ethercat/slave_info.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/result.hpp"

namespace drivers::ethercat {

inline constexpr int kMostSlaves = 64;

// Leaves all slaves in INIT, with addresses from kFirstStation on, their SII held by the master. An
// error: no frame comes back, or more than kMostSlaves; no slave at all is an empty list. A slave
// that can not be read is in the list, with its `problem`.
[[nodiscard]] rt::Result<std::vector<SlaveInfo>> scan(rt::NonRealtime&, RegisterAccess&);

// Looks, and changes no state: for slaves that another scan has addressed.
[[nodiscard]] AlStatus read_al_status(RegisterAccess&, std::uint16_t station) noexcept;

// The words of a slave's EEPROM through registers 0x0502 to 0x050F.
[[nodiscard]] rt::Result<std::vector<std::uint8_t>> read_sii_words(RegisterAccess&,
                                                                   std::uint16_t station,
                                                                   std::size_t first_word,
                                                                   std::size_t words);
// All of it, up to the end of the categories, of all these slaves at once.
[[nodiscard]] std::vector<rt::Result<std::vector<std::uint8_t>>> read_sii_images(
    RegisterAccess&, std::span<const std::uint16_t> stations);

}  // namespace drivers::ethercat
