// Operations on a message by its field list, for fault plans and age limits: age(), spoil(),
// datum().
#pragma once

#include <algorithm>
#include <array>
#include <concepts>
#include <limits>
#include <type_traits>

#include "tasks/contract/fields.hpp"

namespace tasks::edge {

inline constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
inline constexpr float kNanF = std::numeric_limits<float>::quiet_NaN();

// Makes every instant in the message that much older.
template <class M>
void age(M& m, rt::Nanos by) noexcept {
  rt::for_each_field(m, [by]<class T>(T& v, const auto& field) {
    if constexpr (std::same_as<T, rt::Time>) {
      if (field.is == rt::FieldIs::kInstant || field.is == rt::FieldIs::kDatum) v -= by;
    }
  });
}

// Instant of the oldest sensor datum in the message; zero: it holds none yet.
template <class M>
[[nodiscard]] rt::Time datum(const M& m) noexcept {
  static_assert(rt::has_field<M>(rt::FieldIs::kDatum));
  rt::Time taken{};
  rt::for_each_field(m, [&taken]<class T>(const T& v, const auto& field) {
    if constexpr (std::same_as<T, rt::Time>) {
      if (field.is == rt::FieldIs::kDatum) taken = v;
    }
  });
  return taken;
}

// Numbers that lie apart from the list.
inline void spoil_apart(SurfacePoints& m) noexcept {
  for (auto* v : {&m.x, &m.y, &m.z, &m.nx, &m.ny, &m.nz}) std::fill(v->begin(), v->end(), kNanF);
}
inline void spoil_apart(SceneView& m) noexcept { m.points.fill({kNanF, kNanF, kNanF, kNanF}); }
inline void spoil_apart(perception::MeshDelta& m) noexcept {
  for (auto& v : m.vertices) v.x = v.y = v.z = kNanF;
}
inline void spoil_apart(ObjectList& m) noexcept {
  for (auto& e : m.entries) {
    e.X_WO.matrix().setConstant(kNan);
    e.extent_m = e.centre_m = Vec3::Constant(kNan);
  }
}
inline void spoil_apart(Path& m) noexcept {
  for (auto& p : m.points) p.fill(kNan);
}

inline void spoil_value(double& v) noexcept { v = kNan; }
inline void spoil_value(float& v) noexcept { v = kNanF; }
inline void spoil_value(Vec3& v) noexcept { v = Vec3::Constant(kNan); }
inline void spoil_value(Pose& X) noexcept { X.matrix().setConstant(kNan); }
template <std::size_t N>
void spoil_value(std::array<double, N>& v) noexcept {
  v.fill(kNan);
}

// A message without floating-point numbers: check_faults() refuses the kind for its edge.
template <class M>
inline constexpr bool kHasNumbers = rt::has_field<M>(rt::FieldIs::kNumber) || requires(M& m) {
  spoil_apart(m);
};

// Its numbers are NaN.
template <class M>
void spoil(M& m) noexcept {
  rt::for_each_field(m, []<class T>(T& v, const auto& field) {
    if constexpr (requires { spoil_value(v); }) {
      if (field.is == rt::FieldIs::kNumber) spoil_value(v);
    }
  });
  if constexpr (requires { spoil_apart(m); }) spoil_apart(m);
}

}  // namespace tasks::edge
