#include "tools/files/npy.hpp"

#include <bit>
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

struct Elements {
  const char* descr;
  const char* words;
};
constexpr Elements kFloats{"<f4", "little-endian float32"}, kBytes{"|u1", "uint8"};

template <class T>
struct Parsed {
  std::vector<std::size_t> shape;
  std::vector<T> values;
};

template <class T>
rt::Result<Parsed<T>> parse(const std::string& bytes, const std::string& name,
                            const Elements& wanted) {
  constexpr std::size_t kSize = sizeof(T);
  const auto fail = [&](const std::string& what) { return rt::Error{name + ": " + what}; };
  if (bytes.size() < 10 || bytes.compare(0, 6, "\x93NUMPY") != 0) {
    return fail("not an NPY file (the magic bytes are missing)");
  }
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(bytes[i]); };
  const unsigned major = byte(6);
  if (major < 1 || major > 3) {
    return fail("NPY format " + std::to_string(major) + "; allowed are 1, 2, 3");
  }
  std::size_t start = 10;
  std::size_t length = byte(8) + 256U * byte(9);
  if (major >= 2) {
    if (bytes.size() < 12) return fail("cut off inside the header");
    length += 65536U * byte(10) + 16777216U * static_cast<std::size_t>(byte(11));
    start = 12;
  }
  if (bytes.size() - start < length) return fail("cut off inside the header");
  const std::string text = bytes.substr(start, length);
  const auto header = HeaderParser(text).parse();
  if (!header) return fail("malformed NPY header");
  if (header->descr != wanted.descr) {
    return fail("element type " + shown(header->descr) + "; allowed is '" + wanted.descr + "' (" +
                wanted.words + ")");
  }
  if (header->fortran) return fail("Fortran order; allowed is C order (x, y, z)");
  std::size_t count = 1;
  const std::size_t have = bytes.size() - start - length;
  for (const std::size_t n : header->shape) {
    if (n != 0 && count > std::numeric_limits<std::size_t>::max() / n / kSize) {
      return fail("shape too large");
    }
    count *= n;
  }
  if (have != kSize * count) {
    std::ostringstream what;
    what << have << " bytes of data where the shape needs " << kSize * count;
    return fail(what.str());
  }
  Parsed<T> out;
  out.shape = header->shape;
  out.values.resize(count);
  if (count > 0) std::memcpy(out.values.data(), bytes.data() + start + length, kSize * count);
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
  auto parsed = parse<float>(bytes, name, kFloats);
  if (!parsed) return rt::Error{parsed.error()};
  return NpyArray{std::move(parsed.value().shape), std::move(parsed.value().values)};
}

rt::Result<NpyArray> read_npy(const std::string& path) {
  const auto bytes = whole(path);
  if (!bytes) return rt::Error{bytes.error()};
  return parse_npy(bytes.value(), path);
}

rt::Result<NpyLabels> parse_npy_labels(const std::string& bytes, const std::string& name) {
  auto parsed = parse<std::uint8_t>(bytes, name, kBytes);
  if (!parsed) return rt::Error{parsed.error()};
  return NpyLabels{std::move(parsed.value().shape), std::move(parsed.value().values)};
}

rt::Result<NpyLabels> read_npy_labels(const std::string& path) {
  const auto bytes = whole(path);
  if (!bytes) return rt::Error{bytes.error()};
  return parse_npy_labels(bytes.value(), path);
}

}  // namespace teletact
