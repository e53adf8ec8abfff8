#include "drivers/camera/recording/image_header.hpp"

#include <algorithm>
#include <array>
#include <cstring>

namespace drivers {
namespace {

using Bytes = std::span<const std::uint8_t>;

rt::Error error(const std::string& name, const std::string& what) {
  return rt::Error{name + ": " + what};
}

std::uint32_t big_endian(Bytes b, std::size_t at) {
  return std::uint32_t{b[at]} << 24U | std::uint32_t{b[at + 1]} << 16U |
         std::uint32_t{b[at + 2]} << 8U | b[at + 3];
}

rt::Result<ImageHeader> check_size(ImageHeader h, const std::string& name) {
  if (h.width < 1 || h.height < 1 || h.width > kMaxImageSide || h.height > kMaxImageSide) {
    return error(name, "is " + std::to_string(h.width) + " x " + std::to_string(h.height) +
                           "; each side must be 1 to " + std::to_string(kMaxImageSide));
  }
  return h;
}

rt::Result<ImageHeader> png_header(Bytes b, const std::string& name) {
  ImageHeader h;
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
    if (png_crc(body) != big_endian(b, at + 8 + length))
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

rt::Result<ImageHeader> jpeg_header(Bytes b, const std::string& name) {
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
      ImageHeader h;
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

}  // namespace

std::uint32_t png_crc(std::span<const std::uint8_t> b) {
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

rt::Result<ImageHeader> image_header(Bytes b, const std::string& name) {
  static constexpr std::uint8_t kPng[8] = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};
  if (b.empty()) return error(name, "is empty");
  if (b.size() >= 8 && std::memcmp(b.data(), kPng, 8) == 0) return png_header(b, name);
  if (b.size() >= 4 && b[0] == 0xff && b[1] == 0xd8) return jpeg_header(b, name);
  return error(name, "is neither a PNG nor a JPEG image");
}

}  // namespace drivers
