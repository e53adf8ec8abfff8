#include "tools/images/image_files.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <iterator>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <stdexcept>
#include <vector>

namespace teletact {
namespace {

using Bytes = std::span<const std::uint8_t>;

struct Header {
  int width = 0, height = 0, bits = 8, channels = 3;
  bool png = false;
};

rt::Error error(const std::string& name, const std::string& what) {
  return rt::Error{name + ": " + what};
}

std::uint32_t big_endian(Bytes b, std::size_t at) {
  return std::uint32_t{b[at]} << 24U | std::uint32_t{b[at + 1]} << 16U |
         std::uint32_t{b[at + 2]} << 8U | b[at + 3];
}

// CRC-32 of ISO 3309, as PNG uses it.
std::uint32_t crc32(Bytes b) {
  static const auto kTable = [] {
    std::array<std::uint32_t, 256> t{};
    for (std::uint32_t i = 0; i < 256; ++i) {
      std::uint32_t c = i;
      for (int k = 0; k < 8; ++k) c = (c & 1U) != 0 ? 0xedb88320U ^ (c >> 1U) : c >> 1U;
      t[i] = c;
    }
    return t;
  }();
  std::uint32_t c = 0xffffffffU;
  for (const std::uint8_t x : b) c = kTable[(c ^ x) & 0xffU] ^ (c >> 8U);
  return ~c;
}

rt::Result<Header> check_size(Header h, const std::string& name) {
  if (h.width < 1 || h.height < 1 || h.width > kMaxImageSide || h.height > kMaxImageSide) {
    return error(name, "is " + std::to_string(h.width) + " x " + std::to_string(h.height) +
                           "; each side must be 1 to " + std::to_string(kMaxImageSide));
  }
  return h;
}

rt::Result<Header> png_header(Bytes b, const std::string& name) {
  Header h;
  h.png = true;
  std::size_t at = 8;
  bool data = false;
  for (;;) {
    if (b.size() - at < 12) return error(name, "PNG ends before its end chunk");
    const std::size_t length = big_endian(b, at);
    if (length > b.size() - at - 12) return error(name, "PNG chunk reaches beyond the file");
    const Bytes body = b.subspan(at + 4, length + 4);
    const bool is_header = std::memcmp(body.data(), "IHDR", 4) == 0;
    if (is_header != (at == 8))
      return error(name, "PNG header chunk is not the first and only one");
    if (crc32(body) != big_endian(b, at + 8 + length))
      return error(name, "PNG chunk with a wrong CRC");
    if (is_header) {
      if (length != 13) return error(name, "PNG header of " + std::to_string(length) + " bytes");
      h.width = static_cast<int>(std::min<std::uint32_t>(big_endian(body, 4), 1U << 30U));
      h.height = static_cast<int>(std::min<std::uint32_t>(big_endian(body, 8), 1U << 30U));
      h.bits = body[12];
      const int type = body[13];
      h.channels = type == 0 ? 1 : type == 2 || type == 3 ? 3 : 4;
      if (type == 3) h.bits = 8;
    }
    data = data || std::memcmp(body.data(), "IDAT", 4) == 0;
    if (std::memcmp(body.data(), "IEND", 4) == 0) break;
    at += length + 12;
  }
  if (!data) return error(name, "PNG without image data");
  return check_size(h, name);
}

rt::Result<Header> jpeg_header(Bytes b, const std::string& name) {
  std::size_t end = b.size();
  while (end > 2 && b[end - 1] == 0) --end;  // some cameras pad with zeros
  if (end < 4 || b[end - 2] != 0xff || b[end - 1] != 0xd9) {
    return error(name, "JPEG without its end marker: the file is torn");
  }
  std::size_t at = 2;
  while (at + 9 < end) {
    if (b[at] != 0xff) return error(name, "JPEG with a wrong marker");
    const std::uint8_t marker = b[at + 1];
    if (marker == 0xff) {
      ++at;
      continue;
    }
    const bool frame =
        marker >= 0xc0 && marker <= 0xcf && marker != 0xc4 && marker != 0xc8 && marker != 0xcc;
    if (frame) {
      Header h;
      h.bits = b[at + 4];
      h.height = b[at + 5] * 256 + b[at + 6];
      h.width = b[at + 7] * 256 + b[at + 8];
      h.channels = b[at + 9];
      return check_size(h, name);
    }
    at += 2U + b[at + 2] * 256U + b[at + 3];
  }
  return error(name, "JPEG without a frame header");
}

rt::Result<Header> header_of(Bytes b, const std::string& name) {
  static constexpr std::uint8_t kPng[8] = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};
  if (b.empty()) return error(name, "is empty");
  if (b.size() >= 8 && std::memcmp(b.data(), kPng, 8) == 0) return png_header(b, name);
  if (b.size() >= 4 && b[0] == 0xff && b[1] == 0xd8) return jpeg_header(b, name);
  return error(name, "is neither a PNG nor a JPEG image");
}

rt::Result<cv::Mat> decode(Bytes b, const Header& h, int flags, const std::string& name) {
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
  const auto h = header_of(b, name);
  if (!h) return rt::Error{h.error()};
  if (h.value().bits != 8 || h.value().channels == 4) {
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
  const auto h = header_of(b, name);
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
