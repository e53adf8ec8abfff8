#include "drivers/camera/depth_bias.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

namespace drivers {

void DepthBiasPoint::describe(config::Section& s) {
  s.number("at_mm", at_mm, 1, 65534, "reading");
  s.number("bias_mm", bias_mm, -1000, 1000, "how much it is too large there");
}

namespace {

double bias_at(const DepthBiasTable& table, double reading_mm) {
  const auto above = std::find_if(table.begin(), table.end(),
                                  [&](const DepthBiasPoint& p) { return p.at_mm >= reading_mm; });
  if (above == table.begin()) return table.front().bias_mm;
  if (above == table.end()) return table.back().bias_mm;
  const DepthBiasPoint& a = *(above - 1);
  const double f = (reading_mm - a.at_mm) / (above->at_mm - a.at_mm);
  return a.bias_mm + f * (above->bias_mm - a.bias_mm);
}

}  // namespace

DepthBias::DepthBias(rt::NonRealtime&, const DepthBiasTable& table)
    : corrected_(std::make_unique<std::array<std::uint16_t, 65536>>()) {
  for (std::size_t i = 1; i < table.size(); ++i) {
    if (table[i].at_mm > table[i - 1].at_mm) continue;
    throw std::invalid_argument(
        "camera.bias[" + std::to_string(i) + "].at_mm = " + std::to_string(table[i].at_mm) +
        ": must be above the one before, " + std::to_string(table[i - 1].at_mm));
  }
  for (int reading = 0; reading < 65536; ++reading) {
    const auto i = static_cast<std::size_t>(reading);
    const bool none = reading == 0 || reading == 65535;
    const double bias = table.empty() || none ? 0 : bias_at(table, reading);
    const auto depth = static_cast<int>(std::lround(reading - bias));
    (*corrected_)[i] = static_cast<std::uint16_t>(none ? reading : std::clamp(depth, 1, 65534));
  }
}

void DepthBias::apply(perception::RgbdFrame& frame) const noexcept {
  const std::size_t pixels = static_cast<std::size_t>(frame.intrinsics.width) *
                             static_cast<std::size_t>(frame.intrinsics.height);
  for (std::size_t i = 0; i < pixels; ++i) frame.depth_mm[i] = corrected(frame.depth_mm[i]);
}

}  // namespace drivers
