// Text and image files of a TUM folder, read strictly. Every error names file, line and value.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include <opencv2/core/mat.hpp>

#include "rt/result.hpp"

namespace drivers {

// Of one line: what stands between its spaces.
using Tokens = std::vector<std::string>;

// Calls `line(number, tokens)` for each line that is neither empty nor a '#' comment, until one
// returns an error.
[[nodiscard]] rt::Result<bool> for_each_line(
    const std::string& path, const std::function<rt::Result<bool>(int, const Tokens&)>& line);

// A finite number, and nothing behind it.
[[nodiscard]] rt::Result<double> parse_number(const std::string& path, int line,
                                              const std::string& name, const std::string& token);

[[nodiscard]] rt::Error file_error(const std::string& path, int line, const std::string& what);

// Decodes a PNG or JPEG as it is stored; it must have type `type` (CV_16UC1, CV_8UC3). Decoding
// starts only after the container was checked to be whole and of this size.
[[nodiscard]] rt::Result<cv::Mat> decode_image(std::span<const std::uint8_t> bytes,
                                               const std::string& path, int type, int width,
                                               int height);
[[nodiscard]] rt::Result<cv::Mat> read_image(const std::string& path, int type, int width,
                                             int height);

// Reads of images in a task's process must not start OpenCV's thread pool. Idempotent.
void opencv_threads_off();

}  // namespace drivers
