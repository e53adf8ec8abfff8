// The envelope of an intent, as a page sends it: one JSON object of at most 4 KiB with a number
// `id`
// and a word `act`. What else is in it is for who does the act.
#pragma once

#include <cstddef>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

#include "rt/result.hpp"

namespace teletact {

inline constexpr std::size_t kMostIntentBytes = 4096;

struct IntentEnvelope {
  std::int64_t id = 0;  // 0..2^53 - 1: what a page's numbers hold
  std::string act;      // 1 to 24 of a-z and '_'
  nlohmann::json intent;
};

// Refused as a whole, with one line: too long, not JSON (NaN and numbers without an end are not),
// no
// object, nested deeper than 6, a key of the object twice, `id` or `act` missing or wrong.
[[nodiscard]] rt::Result<IntentEnvelope> read_envelope(std::string_view text);

}  // namespace teletact
