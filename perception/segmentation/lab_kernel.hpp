// From linear light to CIELAB, many pixels at once: the part of the conversion that is arithmetic.
#pragma once

namespace perception {

struct LabRow {
  const float *red, *green, *blue;  // linear, 0 to 1
  float *L, *a, *b;
  int count;
};

// sRGB primaries to XYZ over the white point (IEC 61966-2-1), rows divided by D65.
inline constexpr double kLabXyz[3][3] = {
    {0.4124564 / 0.95047, 0.3575761 / 0.95047, 0.1804375 / 0.95047},
    {0.2126729, 0.7151522, 0.0721750},
    {0.0193339 / 1.08883, 0.1191920 / 1.08883, 0.9503041 / 1.08883}};

// The curve of CIELAB at 0, 1 / kLabCurveSteps, ... 1, and one more; linear between them.
constexpr int kLabCurveSteps = 4096;

// On the chosen instruction set (perception/simd/isa.hpp); the same operations, so the same bytes,
// as
void convert_light(const float* curve, const LabRow& row) noexcept;
// the reference: one pixel after the other.
void convert_light_scalar(const float* curve, const LabRow& row) noexcept;

}  // namespace perception
