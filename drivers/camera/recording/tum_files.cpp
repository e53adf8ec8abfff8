#include "drivers/camera/recording/tum_files.hpp"

#include <cerrno>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iterator>
#include <sstream>

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "drivers/camera/recording/image_header.hpp"

namespace drivers {

rt::Error file_error(const std::string& path, int line, const std::string& what) {
  std::string text = path;
  if (line > 0) text.append(":").append(std::to_string(line));
  return {text.append(": ").append(what)};
}

void opencv_threads_off() { cv::setNumThreads(0); }

rt::Result<bool> for_each_line(
    const std::string& path,
    const std::function<rt::Result<bool>(int, const std::vector<std::string>&)>& line) {
  std::ifstream file(path);
  if (!file) return file_error(path, 0, std::string("can not be opened: ") + std::strerror(errno));
  std::string text;
  for (int n = 1; std::getline(file, text); ++n) {
    std::istringstream in(text);
    const std::vector<std::string> tokens{std::istream_iterator<std::string>(in), {}};
    if (tokens.empty() || tokens[0][0] == '#') continue;
    auto ok = line(n, tokens);
    if (!ok) return ok;
  }
  if (file.bad()) return file_error(path, 0, "reading failed");
  return true;
}

rt::Result<double> parse_number(const std::string& path, int line, const std::string& name,
                                const std::string& token) {
  char* end = nullptr;
  const double v = std::strtod(token.c_str(), &end);
  if (end == token.c_str() || *end != '\0' || !std::isfinite(v)) {
    return file_error(path, line, name + " is not a finite number: '" + token + "'");
  }
  return v;
}

rt::Result<cv::Mat> read_image(const std::string& path, int type, int width, int height) {
  std::ifstream file(path, std::ios::binary);
  if (!file) return file_error(path, 0, std::string("can not be opened: ") + std::strerror(errno));
  const std::vector<char> bytes{std::istreambuf_iterator<char>(file), {}};
  if (file.bad()) return file_error(path, 0, "reading failed");
  return decode_image({reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()}, path,
                      type, width, height);
}

rt::Result<cv::Mat> decode_image(std::span<const std::uint8_t> bytes, const std::string& path,
                                 int type, int width, int height) {
  const auto header = image_header(bytes, path);
  if (!header) return rt::Error{header.error()};
  if (header.value().width != width || header.value().height != height) {
    return file_error(path, 0,
                      "is " + std::to_string(header.value().width) + " x " +
                          std::to_string(header.value().height) + ", the sequence is " +
                          std::to_string(width) + " x " + std::to_string(height));
  }
  cv::Mat image;
  try {
    const cv::Mat raw(1, static_cast<int>(bytes.size()), CV_8U,
                      const_cast<std::uint8_t*>(bytes.data()));
    image = cv::imdecode(raw, type == CV_16UC1 ? cv::IMREAD_UNCHANGED
                                               : cv::IMREAD_COLOR | cv::IMREAD_IGNORE_ORIENTATION);
  } catch (const cv::Exception& e) {
    return file_error(path, 0, "is not an image: " + e.err);
  }
  if (image.empty() || image.cols != width || image.rows != height) {
    return file_error(path, 0, "is not a whole PNG or JPEG image");
  }
  if (image.type() != type) {
    return file_error(path, 0,
                      "has " + std::to_string(8 * static_cast<int>(image.elemSize1())) + " bit x " +
                          std::to_string(image.channels()) + " channels, wanted " +
                          (type == CV_16UC1 ? "16 bit x 1" : "8 bit x 3"));
  }
  return image;
}

}  // namespace drivers
