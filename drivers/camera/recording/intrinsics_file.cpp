#include "drivers/camera/recording/intrinsics_file.hpp"

#include <cmath>
#include <vector>

#include "drivers/camera/recording/tum_files.hpp"

namespace drivers {

using perception::RgbdFrame;

rt::Result<DepthIntrinsics> read_intrinsics(const std::string& path) {
  DepthIntrinsics out;
  bool seen = false;
  auto ok = for_each_line(path, [&](int n, const Tokens& t) -> rt::Result<bool> {
    if (seen) return file_error(path, n, "a second line of numbers");
    if (t.size() != 7) {
      return file_error(path, n,
                        "wanted 7 numbers (fx fy cx cy width height units_per_metre), found " +
                            std::to_string(t.size()));
    }
    const char* names[7] = {"fx", "fy", "cx", "cy", "width", "height", "units_per_metre"};
    double v[7];
    for (std::size_t i = 0; i < 7; ++i) {
      auto number = parse_number(path, n, names[i], t[i]);
      if (!number) return rt::Error{number.error()};
      v[i] = number.value();
    }
    const auto range = [&](std::size_t i, double lo, double hi) {
      return v[i] >= lo && v[i] <= hi ? std::string()
                                      : std::string(names[i]) + " = " + t[i] + " is outside " +
                                            std::to_string(lo) + " ... " + std::to_string(hi);
    };
    for (const std::string& bad : {range(0, 1, 1e5), range(1, 1, 1e5), range(2, -1e5, 1e5),
                                   range(3, -1e5, 1e5), range(4, 1, RgbdFrame::kMaxWidth),
                                   range(5, 1, RgbdFrame::kMaxHeight), range(6, 1, 1e6)}) {
      if (!bad.empty()) return file_error(path, n, bad);
    }
    for (const std::size_t i : {std::size_t{4}, std::size_t{5}}) {
      if (v[i] != std::floor(v[i])) {
        return file_error(path, n, std::string(names[i]) + " = " + t[i] + " is not whole");
      }
    }
    out.k = {v[0], v[1], v[2], v[3], static_cast<int>(v[4]), static_cast<int>(v[5])};
    out.units_per_metre = v[6];
    seen = true;
    return true;
  });
  if (!ok) return rt::Error{ok.error()};
  if (!seen) return file_error(path, 0, "has no line of numbers");
  return out;
}

}  // namespace drivers
