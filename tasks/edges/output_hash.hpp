// Hash of a committed message, for run.log_hash and for a replay: every field that it carries, as
// it left the edge's gate. Called only where outputs are hashed (virtual clock, recording); out of
// line, so that the nodes do not contain it. Floating-point numbers count by their bits.
//
// Left out: what lies in a slot beyond the message (cells past the size of a grid, points past the
// end of a path), since a slot keeps what an older message left there.
#pragma once

#include <array>
#include <concepts>
#include <type_traits>

#include "drivers/link/encoded_frame.hpp"
#include "drivers/youbot/motor_bus.hpp"
#include "rt/hash.hpp"
#include "tasks/contract/fields.hpp"

namespace tasks {

namespace weigh {

template <class T>
requires std::integral<T> || std::is_enum_v<T>
void one(rt::Hash64& h, T v) noexcept { h.word(static_cast<std::uint64_t>(v)); }
template <std::floating_point T>
void one(rt::Hash64& h, T v) noexcept {
  h.value(v);
}
inline void one(rt::Hash64& h, rt::Time t) noexcept { one(h, rt::ns_of(t)); }
void one(rt::Hash64& h, const Vec3& v) noexcept;
void one(rt::Hash64& h, const Pose& X) noexcept;
void one(rt::Hash64& h, const perception::Intrinsics& k) noexcept;
void one(rt::Hash64& h, const perception::Material& m) noexcept;
template <class T, std::size_t N>
void one(rt::Hash64& h, const std::array<T, N>& values) noexcept {
  for (const T& v : values) one(h, v);
}

// What a field list names apart, as far as it is part of the message.
void apart(rt::Hash64& h, const Path& m) noexcept;
void apart(rt::Hash64& h, const SurfacePoints& m) noexcept;  // without the padding
void apart(rt::Hash64& h, const SceneView& m) noexcept;
void apart(rt::Hash64& h, const ObjectList& m) noexcept;
void apart(rt::Hash64& h, const perception::MeshDelta& m) noexcept;
void apart(rt::Hash64& h, const perception::CostMap& m) noexcept;
// By its checksum; the field itself where the writer made none.
void apart(rt::Hash64& h, const perception::SurfacePatch& m) noexcept;

}  // namespace weigh

// By its field list. Without what is set on the way: the gap flag says how full the ring was.
template <class M>
[[gnu::noinline]] void hash_output(rt::Hash64& h, const M& m) noexcept {
  rt::for_each_field(m, [&h](const auto& v, const auto& field) {
    if (field.is != rt::FieldIs::kOnTheWay) weigh::one(h, v);
  });
  if constexpr (requires { rt::Fields<M>::kApart; }) weigh::apart(h, m);
}
void hash_output(rt::Hash64& h, const Vec3& v) noexcept;  // a force
void hash_output(rt::Hash64& h, const drivers::MotorSetpoints& m) noexcept;
void hash_output(rt::Hash64& h, const drivers::EncodedFrame& m) noexcept;

}  // namespace tasks
