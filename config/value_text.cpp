#include "config/value_text.hpp"

#include <array>
#include <charconv>
#include <cmath>
#include <type_traits>

namespace config {

std::string number_text(double value) {
  if (std::isnan(value)) return "nan";
  if (std::isinf(value)) return value > 0 ? "inf" : "-inf";
  std::array<char, 40> buffer{};
  const auto end = std::to_chars(buffer.data(), buffer.data() + buffer.size(), value);
  std::string out(buffer.data(), end.ptr);
  // A TOML float needs a point or an exponent.
  if (out.find_first_of(".e") == std::string::npos) out += ".0";
  return out;
}

namespace {

// Inside a message or a table a whole number needs no ".0".
std::string short_number(double value) {
  std::string out = number_text(value);
  if (out.size() > 2 && out.ends_with(".0")) out.resize(out.size() - 2);
  return out;
}

bool unbounded(double v) {
  return std::isinf(v) || std::abs(v) == std::numeric_limits<double>::max();
}

}  // namespace

std::string range_text(double lo, double hi) {
  const bool low = !unbounded(lo), high = !unbounded(hi);
  if (!low && !high) return "any";
  return (low ? short_number(lo) : "") + ".." + (high ? short_number(hi) : "");
}

std::string quoted_text(const std::string& text) {
  static constexpr char kHex[] = "0123456789ABCDEF";
  std::string out = "\"";
  for (const char c : text) {
    const auto u = static_cast<unsigned char>(c);
    if (c == '"' || c == '\\') {
      out += '\\';
      out += c;
    } else if (c == '\n') {
      out += "\\n";
    } else if (c == '\t') {
      out += "\\t";
    } else if (u < 0x20 || u == 0x7f) {
      out += "\\u00";
      out += kHex[u >> 4U];
      out += kHex[u & 15U];
    } else {
      out += c;
    }
  }
  return out + "\"";
}

std::string key_text(const std::string& key) {
  const bool bare = !key.empty() && key.find_first_not_of(
                                        "abcdefghijklmnopqrstuvwxyz"
                                        "ABCDEFGHIJKLMNOPQRSTUVWXYZ"
                                        "0123456789_-") == std::string::npos;
  return bare ? key : quoted_text(key);
}

std::string value_text(const Section::Field& field) {
  return std::visit(
      [](const auto& v) -> std::string {
        using V = std::decay_t<decltype(v)>;
        if constexpr (std::is_same_v<V, Section::Number>) {
          return number_text(*v.value);
        } else if constexpr (std::is_same_v<V, Section::Integer>) {
          return std::to_string(*v.value);
        } else if constexpr (std::is_same_v<V, Section::Seed>) {
          // TOML integers have 63 bits; a larger seed is written as text.
          const bool fits = *v.value <= static_cast<std::uint64_t>(INT64_MAX);
          const std::string digits = std::to_string(*v.value);
          return fits ? digits : quoted_text(digits);
        } else if constexpr (std::is_same_v<V, Section::Flag>) {
          return *v.value ? "true" : "false";
        } else if constexpr (std::is_same_v<V, Section::Text>) {
          return quoted_text(*v.value);
        } else if constexpr (std::is_same_v<V, Section::Numbers>) {
          std::string out = "[";
          for (std::size_t i = 0; i < v.values.size(); ++i) {
            out += (i == 0 ? "" : ", ") + number_text(v.values[i]);
          }
          return out + "]";
        } else {
          return "";
        }
      },
      field.value);
}

std::string allowed_text(const Section::Field& field) {
  return std::visit(
      [](const auto& v) -> std::string {
        using V = std::decay_t<decltype(v)>;
        if constexpr (std::is_same_v<V, Section::Number>) {
          const std::string range = range_text(v.lo, v.hi);
          return range == "any" ? "any finite number" : range;
        } else if constexpr (std::is_same_v<V, Section::Integer>) {
          return "whole number " + range_text(v.lo, v.hi);
        } else if constexpr (std::is_same_v<V, Section::Seed>) {
          return "whole number 0..18446744073709551615 (above 2^63 - 1 as text)";
        } else if constexpr (std::is_same_v<V, Section::Flag>) {
          return "true or false";
        } else if constexpr (std::is_same_v<V, Section::Text>) {
          if (v.allowed.empty()) return "text";
          std::string out;
          for (const auto& a : v.allowed) out += (out.empty() ? "" : ", ") + quoted_text(a);
          return out;
        } else if constexpr (std::is_same_v<V, Section::Numbers>) {
          const std::string range = range_text(v.lo, v.hi);
          return "list of " + std::to_string(v.values.size()) + " numbers" +
                 (range == "any" ? "" : " " + range);
        } else if constexpr (std::is_same_v<V, Section::List>) {
          return "list of tables";
        } else {
          return "table";
        }
      },
      field.value);
}

}  // namespace config
