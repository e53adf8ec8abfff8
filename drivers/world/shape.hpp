// One solid of the simulated world. Frame S: the shape's own; X_WS places it in the world, before
// any motion begins (World::X_WS_at has it at an instant).
//
//   kPlane     half-space z_S <= 0 is solid; z_S axis = outward normal
//   kBox       |x| <= half.x, |y| <= half.y, |z| <= half.z
//   kCylinder  axis = z_S (always vertical in W), radius half.x = half.y, |z| <= half.z
//   kSphere    radius half.x
//   kCapsule   all within half.x of the segment |z_S| <= half.z; turned any way
#pragma once

#include <cstdint>
#include <string>

#include "perception/geometry/pose.hpp"
#include "perception/geometry/rgbd_frame.hpp"

namespace drivers {

// Colour as a function of the point in S: a cubic lattice whose cells are coloured by parity
// (checker) or by hash (noise). The darkest cell is (1 - contrast) times the base colour.
struct Paint {
  enum class Texture : std::uint8_t { kPlain, kChecker, kNoise };
  perception::Rgb colour{160, 160, 160};
  Texture texture = Texture::kNoise;
  double cell_m = 0.05;
  double contrast = 0.35;
};

struct Shape {
  enum class Kind : std::uint8_t { kPlane, kBox, kCylinder, kSphere, kCapsule };
  Kind kind = Kind::kBox;
  std::string name;
  perception::Pose X_WS = perception::Pose::Identity();
  perception::Vec3 half = perception::Vec3::Zero();  // m, by kind
  bool ground = false;                               // the robot drives on it: never a collision
  Paint paint;
  // Derived by World. The lattice is shifted so that no flat face lies on a cell border, where
  // rounding would make the colour flicker.
  perception::Vec3 lattice_offset_m = perception::Vec3::Zero();
  double bound_radius_m = 0;  // of the sphere round X_WS's origin; planes: inf
  std::uint32_t paint_seed = 0;
  int mover = -1;  // index of its mover; -1: it never moves
};

// Lattice coordinate of p_m. The bias keeps it positive, so truncation is floor (and vectorises);
// beyond +-2^20 cells it stays at the last one.
[[nodiscard]] inline std::uint32_t lattice_index(double p_m, double offset_m,
                                                 double inverse_cell) noexcept {
  const double x = (p_m + offset_m) * inverse_cell + 1048576.0;
  const double low = x > 0.0 ? x : 0.0;
  return static_cast<std::uint32_t>(static_cast<std::int32_t>(low < 2097152.0 ? low : 2097152.0));
}

// Depth of the pattern in paint_level()'s unit.
[[nodiscard]] inline std::uint32_t pattern_depth(const Paint& paint) noexcept {
  return static_cast<std::uint32_t>(paint.contrast * 256.0 + 0.5);
}

// Brightness of the lattice cell, 256 = the base colour. Integer arithmetic only, so a picture is
// the same on every machine.
[[nodiscard]] inline std::uint32_t paint_level(std::uint32_t ix, std::uint32_t iy, std::uint32_t iz,
                                               Paint::Texture texture, std::uint32_t depth,
                                               std::uint32_t seed) noexcept {
  if (texture == Paint::Texture::kPlain) return 256U;
  if (texture == Paint::Texture::kChecker) return 256U - depth * ((ix + iy + iz) & 1U);
  std::uint32_t h = ix * 0x9e3779b1U ^ iy * 0x85ebca77U ^ iz * 0xc2b2ae3dU ^ seed;
  h = (h ^ (h >> 15U)) * 0x2c1b3c6dU;
  h ^= h >> 12U;
  return 256U - ((depth * (h & 0xffU)) >> 8U);
}

}  // namespace drivers
