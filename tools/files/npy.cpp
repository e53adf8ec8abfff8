#include "tools/files/npy.hpp"

#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <optional>
#include <sstream>

namespace teletact {

namespace {

// As it can stand in a message: one line, not endless.
std::string shown(const std::string& text) {
  std::string out = "'";
  for (const char c : text.substr(0, 40)) out += c >= ' ' && c <= '~' ? c : '?';
  return out + (text.size() > 40 ? "...'" : "'");
}

static_assert(std::endian::native == std::endian::little, "NPY data is read as it lies in memory");

// The header is a Python dictionary literal with exactly the keys descr, fortran_order and shape.
class HeaderParser {
 public:
  explicit HeaderParser(const std::string& text) : text_(text) {}

  struct Header {
    std::string descr;
    bool fortran = false;
    std::vector<std::size_t> shape;
  };

  std::optional<Header> parse() {
    Header out;
    bool descr = false, order = false, shape = false;
    if (!take('{')) return std::nullopt;
    while (!take('}')) {
      const auto key = quoted();
      if (!key || !take(':')) return std::nullopt;
      if (*key == "descr" && !descr) {
        const auto value = quoted();
        if (!value) return std::nullopt;
        out.descr = *value;
        descr = true;
      } else if (*key == "fortran_order" && !order) {
        if (word("True")) {
          out.fortran = true;
        } else if (!word("False")) {
          return std::nullopt;
        }
        order = true;
      } else if (*key == "shape" && !shape) {
        if (!tuple(out.shape)) return std::nullopt;
        shape = true;
      } else {
        return std::nullopt;
      }
      if (!take(',')) {
        if (!take('}')) return std::nullopt;
        break;
      }
    }
    skip();
    if (at_ != text_.size() || !descr || !order || !shape) return std::nullopt;
    return out;
  }

 private:
  void skip() {
    while (at_ < text_.size() && (text_[at_] == ' ' || text_[at_] == '\n' || text_[at_] == '\t')) {
      ++at_;
    }
  }
  bool take(char c) {
    skip();
    if (at_ >= text_.size() || text_[at_] != c) return false;
    ++at_;
    return true;
  }
  bool word(const char* w) {
    skip();
    const std::size_t n = std::strlen(w);
    if (text_.compare(at_, n, w) != 0) return false;
    at_ += n;
    return true;
  }
  std::optional<std::string> quoted() {
    skip();
    if (at_ >= text_.size() || (text_[at_] != '\'' && text_[at_] != '"')) return std::nullopt;
    const char quote = text_[at_];
    const std::size_t end = text_.find(quote, at_ + 1);
    if (end == std::string::npos) return std::nullopt;
    std::string out = text_.substr(at_ + 1, end - at_ - 1);
    at_ = end + 1;
    return out;
  }
  bool tuple(std::vector<std::size_t>& out) {
    if (!take('(')) return false;
    while (!take(')')) {
      skip();
      std::size_t value = 0, digits = 0;
      while (at_ < text_.size() && text_[at_] >= '0' && text_[at_] <= '9') {
        if (++digits > 12) return false;
        value = value * 10 + static_cast<std::size_t>(text_[at_++] - '0');
      }
      if (digits == 0 || out.size() >= 8) return false;
      out.push_back(value);
      if (!take(',')) {
        if (!take(')')) return false;
        break;
      }
    }
    return true;
  }

  const std::string& text_;
  std::size_t at_ = 0;
};

rt::Error refused(const std::string& name, const std::string& what) {
  return rt::Error{name + ": " + what};
}

// A header, and where the data begin.
struct Place {
  HeaderParser::Header header;
  std::size_t data_at = 0;
};

rt::Result<Place> place_of(const std::string& bytes, const std::string& name) {
  if (bytes.size() < 10 || bytes.compare(0, 6, "\x93NUMPY") != 0)
    return refused(name, "not an NPY file (the magic bytes are missing)");
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(bytes[i]); };
  const unsigned major = byte(6);
  if (major < 1 || major > 3)
    return refused(name, "NPY format " + std::to_string(major) + "; allowed are 1, 2, 3");
  std::size_t start = 10;
  std::size_t length = byte(8) + 256U * byte(9);
  if (major >= 2) {
    if (bytes.size() < 12) return refused(name, "cut off inside the header");
    length += 65536U * byte(10) + 16777216U * static_cast<std::size_t>(byte(11));
    start = 12;
  }
  if (bytes.size() - start < length) return refused(name, "cut off inside the header");
  const std::string text = bytes.substr(start, length);
  const auto header = HeaderParser(text).parse();
  if (!header) return refused(name, "malformed NPY header");
  if (header->fortran) return refused(name, "Fortran order; allowed is C order (x, y, z)");
  return Place{*header, start + length};
}

template <class T>
rt::Result<std::vector<T>> values_of(const std::string& bytes, const std::string& name,
                                     const Place& place) {
  std::size_t count = 1;
  const std::size_t have = bytes.size() - place.data_at;
  for (const std::size_t n : place.header.shape) {
    if (n != 0 && count > std::numeric_limits<std::size_t>::max() / n / sizeof(T))
      return refused(name, "shape too large");
    count *= n;
  }
  if (have != sizeof(T) * count) {
    return refused(name, std::to_string(have) + " bytes of data where the shape needs " +
                             std::to_string(sizeof(T) * count));
  }
  std::vector<T> out(count);
  if (count > 0) std::memcpy(out.data(), bytes.data() + place.data_at, have);
  return out;
}

// NaN stays: of a field it is "unobserved".
rt::Result<std::vector<float>> narrowed(const std::vector<double>& values,
                                        const std::string& name) {
  std::vector<float> out;
  out.reserve(values.size());
  for (const double v : values) {
    if (std::isfinite(v) && std::abs(v) > double{std::numeric_limits<float>::max()})
      return refused(name, "a value is beyond float32's range");
    out.push_back(static_cast<float>(v));
  }
  return out;
}

rt::Result<std::string> whole(const std::string& path) {
  std::error_code ignored;
  if (std::filesystem::is_directory(path, ignored)) return rt::Error{path + ": is a folder"};
  std::ifstream file(path, std::ios::binary);
  if (!file) return rt::Error{path + ": cannot be opened"};
  std::ostringstream bytes;
  bytes << file.rdbuf();
  if (file.bad()) return rt::Error{path + ": cannot be read"};
  return bytes.str();
}

}  // namespace

rt::Result<NpyArray> parse_npy(const std::string& bytes, const std::string& name) {
  const auto place = place_of(bytes, name);
  if (!place) return rt::Error{place.error()};
  const std::string& kind = place.value().header.descr;
  if (kind != "<f4" && kind != "<f8") {
    return refused(name, "element type " + shown(kind) +
                             "; allowed are '<f4' and '<f8' (little-endian float32, float64)");
  }
  rt::Result<std::vector<float>> floats = rt::Error{""};
  if (kind == "<f4") {
    floats = values_of<float>(bytes, name, place.value());
  } else {
    const auto doubles = values_of<double>(bytes, name, place.value());
    if (!doubles) return rt::Error{doubles.error()};
    floats = narrowed(doubles.value(), name);
  }
  if (!floats) return rt::Error{floats.error()};
  return NpyArray{place.value().header.shape, std::move(floats.value())};
}

rt::Result<NpyArray> read_npy(const std::string& path) {
  const auto bytes = whole(path);
  if (!bytes) return rt::Error{bytes.error()};
  return parse_npy(bytes.value(), path);
}

rt::Result<NpyLabels> parse_npy_labels(const std::string& bytes, const std::string& name) {
  const auto place = place_of(bytes, name);
  if (!place) return rt::Error{place.error()};
  const std::string& kind = place.value().header.descr;
  if (kind != "|u1")
    return refused(name, "element type " + shown(kind) + "; allowed is '|u1' (uint8)");
  auto labels = values_of<std::uint8_t>(bytes, name, place.value());
  if (!labels) return rt::Error{labels.error()};
  return NpyLabels{place.value().header.shape, std::move(labels.value())};
}

rt::Result<NpyLabels> read_npy_labels(const std::string& path) {
  const auto bytes = whole(path);
  if (!bytes) return rt::Error{bytes.error()};
  return parse_npy_labels(bytes.value(), path);
}

}  // namespace teletact
