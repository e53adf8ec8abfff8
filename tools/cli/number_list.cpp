#include "tools/cli/number_list.hpp"

#include <cmath>
#include <cstdlib>
#include <stdexcept>

namespace teletact {

std::vector<double> number_list(const std::string& key, const std::string& text, std::size_t least,
                                std::size_t most) {
  std::vector<double> values;
  const char* at = text.c_str();
  for (;;) {
    char* end = nullptr;
    const double v = std::strtod(at, &end);
    if (end == at || !std::isfinite(v)) break;
    values.push_back(v);
    at = end;
    if (*at != ',') break;
    ++at;
  }
  if (values.size() < least || values.size() > most || *at != '\0') {
    throw std::runtime_error(key + " '" + text + "': must be " + std::to_string(least) +
                             (most > least ? " to " + std::to_string(most) : std::string()) +
                             " numbers with commas between");
  }
  return values;
}

drivers::TumOptions::Pinhole parse_pinhole(const std::string& text) {
  const auto v = number_list("--intrinsics", text, 4, 5);
  if (!(v[0] >= 1 && v[0] <= 1e5 && v[1] >= 1 && v[1] <= 1e5 && std::abs(v[2]) <= 1e5 &&
        std::abs(v[3]) <= 1e5)) {
    throw std::runtime_error("--intrinsics " + text +
                             ": fx and fy must be 1 to 100000 px, cx and cy within 100000 px");
  }
  if (v.size() == 5 && !(v[4] >= 1 && v[4] <= 1e6)) {
    throw std::runtime_error("--intrinsics " + text +
                             ": depth must have 1 to 1000000 units a metre");
  }
  return {v[0], v[1], v[2], v[3], v.size() == 5 ? v[4] : 0};
}

}  // namespace teletact
