// Options that are a few numbers with commas between.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "drivers/camera/tum_reader.hpp"

namespace teletact {

// Parses at least `least` and at most `most` finite numbers. Throws std::runtime_error naming the
// key and the text.
[[nodiscard]] std::vector<double> number_list(const std::string& key, const std::string& text,
                                              std::size_t least, std::size_t most);

// "fx,fy,cx,cy" in px or "fx,fy,cx,cy,depth_units_per_metre", in the ranges of intrinsics.txt.
// Throws std::runtime_error.
[[nodiscard]] drivers::TumOptions::Pinhole parse_pinhole(const std::string& text);

}  // namespace teletact
