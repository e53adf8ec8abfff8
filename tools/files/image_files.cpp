#include "tools/files/image_files.hpp"

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <stdexcept>
#include <vector>

#include "drivers/camera/recording/image_header.hpp"

namespace teletact {
namespace {

using Bytes = std::span<const std::uint8_t>;

rt::Error error(const std::string& name, const std::string& what) {
  return rt::Error{name + ": " + what};
}

// What is written to stderr while it lives. Through OpenCV libpng and libjpeg have no other way to
// say that a file is damaged; libjpeg goes on with grey in place of what it could not read.
class DecoderWords {
 public:
  DecoderWords() : file_(memfd_create("decoder", MFD_CLOEXEC)), stderr_(-1) {
    std::fflush(stderr);
    if (file_ >= 0) stderr_ = fcntl(STDERR_FILENO, F_DUPFD_CLOEXEC, 3);
    if (stderr_ >= 0) dup2(file_, STDERR_FILENO);
  }
  ~DecoderWords() {
    restore();
    if (file_ >= 0) close(file_);
  }
  DecoderWords(const DecoderWords&) = delete;
  DecoderWords& operator=(const DecoderWords&) = delete;

  // Its first line.
  [[nodiscard]] std::string end() {
    restore();
    char text[200];
    const ssize_t n = file_ >= 0 ? pread(file_, text, sizeof text, 0) : 0;
    const std::string all(text, static_cast<std::size_t>(std::max<ssize_t>(n, 0)));
    return all.substr(0, all.find('\n'));
  }

 private:
  void restore() {
    if (stderr_ < 0) return;
    std::fflush(stderr);
    dup2(stderr_, STDERR_FILENO);
    close(stderr_);
    stderr_ = -1;
  }
  int file_, stderr_;
};

rt::Result<cv::Mat> decode(Bytes b, const drivers::ImageHeader& h, int flags,
                           const std::string& name) {
  cv::Mat image;
  DecoderWords words;
  try {
    const cv::Mat raw(1, static_cast<int>(b.size()), CV_8U, const_cast<std::uint8_t*>(b.data()));
    image = cv::imdecode(raw, flags);
  } catch (const cv::Exception& e) {
    return error(name, "can not be decoded: " + e.err);
  }
  const std::string said = words.end();
  const bool turns = (flags & cv::IMREAD_IGNORE_ORIENTATION) == 0;
  const bool as_stored = image.cols == h.width && image.rows == h.height,
             turned = turns && image.cols == h.height && image.rows == h.width;
  if (image.empty() || !(as_stored || turned)) {
    return error(name, "can not be decoded" + (said.empty() ? said : ": " + said));
  }
  // Other words, such as those about a colour profile, are no damage.
  for (const char* damage : {"Corrupt JPEG data", "Premature end of JPEG"})
    if (said.starts_with(damage)) return error(name, said);
  return image;
}

rt::Result<std::vector<std::uint8_t>> slurp(const std::string& path) {
  constexpr std::size_t kMost = std::size_t{1} << 28U, kPart = std::size_t{1} << 20U;
  std::ifstream file(path, std::ios::binary);
  if (!file) return error(path, std::string("can not be opened: ") + std::strerror(errno));
  std::error_code ignored;
  if (std::filesystem::is_directory(path, ignored)) return error(path, "is a folder");
  // In parts: what is no plain file does not tell its size.
  std::vector<std::uint8_t> bytes;
  while (file) {
    const std::size_t had = bytes.size();
    if (had > kMost) return error(path, "is larger than 256 MiB");
    bytes.resize(had + kPart);
    file.read(reinterpret_cast<char*>(bytes.data() + had), static_cast<std::streamsize>(kPart));
    bytes.resize(had + static_cast<std::size_t>(file.gcount()));
  }
  if (file.bad() || bytes.empty()) return error(path, "is empty or can not be read");
  return bytes;
}

}  // namespace

rt::Result<perception::Image<perception::Rgb>> decode_colour(Bytes b, const std::string& name,
                                                             Orientation orientation) {
  const auto h = drivers::image_header(b, name);
  if (!h) return rt::Error{h.error()};
  if (h.value().bits != 8) {
    return error(name, "has " + std::to_string(h.value().bits) + " bit x " +
                           std::to_string(h.value().channels) + " channels; must be 8 bit colour");
  }
  const int ignored = orientation == Orientation::kStored ? cv::IMREAD_IGNORE_ORIENTATION : 0;
  const auto m = decode(b, h.value(), cv::IMREAD_COLOR | ignored, name);
  if (!m) return rt::Error{m.error()};
  if (m.value().type() != CV_8UC3) return error(name, "can not be decoded as 8 bit colour");
  perception::Image<perception::Rgb> out(m.value().cols, m.value().rows);
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

rt::Result<perception::Image<perception::Rgb>> read_colour(const std::string& path,
                                                           Orientation orientation) {
  const auto bytes = slurp(path);
  if (!bytes) return rt::Error{bytes.error()};
  return decode_colour(bytes.value(), path, orientation);
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
