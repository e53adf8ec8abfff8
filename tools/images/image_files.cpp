#include "tools/images/image_files.hpp"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <iterator>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <stdexcept>
#include <vector>

#include "drivers/camera/image_header.hpp"

namespace teletact {
namespace {

using Bytes = std::span<const std::uint8_t>;

rt::Error error(const std::string& name, const std::string& what) {
  return rt::Error{name + ": " + what};
}

rt::Result<cv::Mat> decode(Bytes b, const drivers::ImageHeader& h, int flags,
                           const std::string& name) {
  cv::Mat image;
  try {
    const cv::Mat raw(1, static_cast<int>(b.size()), CV_8U, const_cast<std::uint8_t*>(b.data()));
    image = cv::imdecode(raw, flags);
  } catch (const cv::Exception& e) {
    return error(name, "can not be decoded: " + e.err);
  }
  if (image.empty() || image.cols != h.width || image.rows != h.height) {
    return error(name, "can not be decoded");
  }
  return image;
}

rt::Result<std::vector<std::uint8_t>> slurp(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) return error(path, std::string("can not be opened: ") + std::strerror(errno));
  file.seekg(0, std::ios::end);
  const std::streamoff size = file.tellg();
  if (size > (std::streamoff{1} << 28U)) return error(path, "is larger than 256 MiB");
  file.seekg(0);
  std::vector<std::uint8_t> bytes{std::istreambuf_iterator<char>(file), {}};
  if (file.bad() || bytes.empty()) return error(path, "is empty or can not be read");
  return bytes;
}

}  // namespace

rt::Result<perception::Image<perception::Rgb>> decode_colour(Bytes b, const std::string& name) {
  const auto h = drivers::image_header(b, name);
  if (!h) return rt::Error{h.error()};
  if (h.value().bits != 8) {
    return error(name, "has " + std::to_string(h.value().bits) + " bit x " +
                           std::to_string(h.value().channels) + " channels; must be 8 bit colour");
  }
  const auto m = decode(b, h.value(), cv::IMREAD_COLOR | cv::IMREAD_IGNORE_ORIENTATION, name);
  if (!m) return rt::Error{m.error()};
  if (m.value().type() != CV_8UC3) return error(name, "can not be decoded as 8 bit colour");
  perception::Image<perception::Rgb> out(h.value().width, h.value().height);
  for (int v = 0; v < out.height(); ++v) {
    const auto* row = m.value().ptr<cv::Vec3b>(v);
    for (int u = 0; u < out.width(); ++u) out.at(u, v) = {row[u][2], row[u][1], row[u][0]};
  }
  return out;
}

rt::Result<perception::Image<std::uint16_t>> decode_grey(Bytes b, const std::string& name) {
  const auto h = drivers::image_header(b, name);
  if (!h) return rt::Error{h.error()};
  const bool grey = h.value().png && h.value().channels == 1;
  if (!grey || (h.value().bits != 16 && h.value().bits != 8)) {
    return error(name, "has " + std::to_string(h.value().bits) + " bit x " +
                           std::to_string(h.value().channels) +
                           " channels; must be a grey PNG of 16 or 8 bit");
  }
  const auto m = decode(b, h.value(), cv::IMREAD_UNCHANGED, name);
  if (!m) return rt::Error{m.error()};
  perception::Image<std::uint16_t> out(h.value().width, h.value().height);
  for (int v = 0; v < out.height(); ++v) {
    for (int u = 0; u < out.width(); ++u) {
      if (m.value().type() == CV_16UC1) {
        out.at(u, v) = m.value().at<std::uint16_t>(v, u);
      } else if (m.value().type() == CV_8UC1) {
        out.at(u, v) = m.value().at<std::uint8_t>(v, u);
      } else {
        return error(name, "can not be decoded as grey");
      }
    }
  }
  return out;
}

rt::Result<perception::Image<perception::Rgb>> read_colour(const std::string& path) {
  const auto bytes = slurp(path);
  if (!bytes) return rt::Error{bytes.error()};
  return decode_colour(bytes.value(), path);
}

rt::Result<perception::Image<std::uint16_t>> read_grey(const std::string& path) {
  const auto bytes = slurp(path);
  if (!bytes) return rt::Error{bytes.error()};
  return decode_grey(bytes.value(), path);
}

std::string encode_labels(perception::ImageView<const std::uint16_t> labels) {
  std::uint16_t most = 0;
  for (int v = 0; v < labels.height; ++v) {
    for (int u = 0; u < labels.width; ++u) most = std::max(most, labels.at(u, v));
  }
  cv::Mat image(labels.height, labels.width, most < 256 ? CV_8UC1 : CV_16UC1);
  for (int v = 0; v < labels.height; ++v) {
    for (int u = 0; u < labels.width; ++u) {
      if (most < 256) {
        image.at<std::uint8_t>(v, u) = static_cast<std::uint8_t>(labels.at(u, v));
      } else {
        image.at<std::uint16_t>(v, u) = labels.at(u, v);
      }
    }
  }
  std::vector<std::uint8_t> png;
  if (!cv::imencode(".png", image, png, {cv::IMWRITE_PNG_COMPRESSION, 6})) {
    throw std::runtime_error("a label image could not be encoded");
  }
  return {png.begin(), png.end()};
}

}  // namespace teletact
