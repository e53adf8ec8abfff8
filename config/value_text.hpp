// How keys, values and ranges are written: in messages, in effective() and in the reference table.
// Numbers are the shortest text that reads back as the same double.
#pragma once

#include <string>

#include "config/schema.hpp"

namespace config {

[[nodiscard]] std::string number_text(double value);
// "0.005..0.08"; an unbounded side is left open: "0..", "..5", "any".
[[nodiscard]] std::string range_text(double lo, double hi);
// A TOML basic string, quotes included, on one line.
[[nodiscard]] std::string quoted_text(const std::string& text);
// A TOML key, quoted only where needed.
[[nodiscard]] std::string key_text(const std::string& key);
// The current value as TOML. Empty for a section or a list.
[[nodiscard]] std::string value_text(const Section::Field& field);
// What a field accepts, in words.
[[nodiscard]] std::string allowed_text(const Section::Field& field);

}  // namespace config
