#include "rt/store/store_files.hpp"

#include <charconv>
#include <cstdio>

namespace rt {

namespace {

constexpr std::string_view kWhole = "whole-", kPart = "part-", kHalf = ".tmp";
constexpr std::size_t kDigits = 8;

bool take_word(std::string_view& text, std::string_view word) {
  if (text.substr(0, word.size()) != word) return false;
  text.remove_prefix(word.size());
  return true;
}

bool take_number(std::string_view& text, std::uint32_t& v) {
  if (text.size() < kDigits) return false;
  const char* end = text.data() + kDigits;
  const auto [at, error] = std::from_chars(text.data(), end, v);
  if (error != std::errc{} || at != end) return false;
  text.remove_prefix(kDigits);
  return true;
}

}  // namespace

std::string StoreFile::name() const {
  char text[40];
  if (whole)
    std::snprintf(text, sizeof text, "whole-%08u", first);
  else
    std::snprintf(text, sizeof text, "part-%08u-%08u", first, last);
  return text;
}

std::optional<StoreFile> store_file_of(std::string_view name) {
  StoreFile f;
  if (take_word(name, kWhole)) {
    f.whole = true;
    if (!take_number(name, f.first) || !name.empty()) return std::nullopt;
    f.last = f.first;
    return f;
  }
  if (!take_word(name, kPart) || !take_number(name, f.first) || !take_word(name, "-") ||
      !take_number(name, f.last) || !name.empty() || f.first > f.last)
    return std::nullopt;
  return f;
}

bool is_store_file(std::string_view name) {
  if (name.size() > kHalf.size() && name.substr(name.size() - kHalf.size()) == kHalf)
    name.remove_suffix(kHalf.size());
  return name == "header" || name == "end" || store_file_of(name).has_value();
}

}  // namespace rt
