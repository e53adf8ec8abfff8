// Reads NPY arrays (format 1.0, 2.0, 3.0) in C order: fields of little-endian float32 or float64
// (NumPy's default), labels of uint8; nothing else is accepted. Format: https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "rt/result.hpp"

namespace teletact {

struct NpyArray {
  std::vector<std::size_t> shape;
  std::vector<float> values;  // C order: the last index runs fastest
};

// An error is one line: file, what is wrong, what is allowed. Never reads beyond the given size,
// never allocates more than the data the bytes really hold.
[[nodiscard]] rt::Result<NpyArray> read_npy(const std::string& path);
// The same from memory; `name` stands for the file in messages.
[[nodiscard]] rt::Result<NpyArray> parse_npy(const std::string& bytes, const std::string& name);

struct NpyLabels {
  std::vector<std::size_t> shape;
  std::vector<std::uint8_t> values;
};
[[nodiscard]] rt::Result<NpyLabels> read_npy_labels(const std::string& path);
[[nodiscard]] rt::Result<NpyLabels> parse_npy_labels(const std::string& bytes,
                                                     const std::string& name);

}  // namespace teletact
