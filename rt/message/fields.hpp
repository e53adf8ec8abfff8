// One field list a message: what a run's hash, ageing, a fault plan and the wire need to know of it
// is said once.
//
//     template <>
//     struct rt::Fields<Mode> {
//       static constexpr auto kList = fields(value(&Mode::seq), datum(&Mode::stamp), number(&Mode::speed));
//     };
//     static_assert(rt::lists_every_field<Mode>());
//
// The order of the list is the order on the wire and in a hash. A field that is added to a struct
// and not to its list does not compile. What a list can not say (arrays of which a part is in use)
// is `kApart`: the number of such fields.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string_view>
#include <type_traits>
#include <utility>

namespace rt {

enum class FieldIs : std::uint8_t {
  kValue,    // a counter, a flag, a code; or a number that no fault plan spoils
  kNumber,   // of the physical world: a fault plan's `nan` spoils it
  kInstant,  // of the writer's clock: it ages, and is converted where it crosses boxes
  kDatum,    // an instant: when the oldest sensor datum in the message was taken
  kOnTheWay  // set by the channel, not by the writer; excluded from hashes
};

template <class M, class T>
struct Field {
  T M::*at;
  FieldIs is;
  std::string_view name;  // on the wire; empty: never there
  std::uint64_t most;     // largest code that the wire admits; 0: any
};

// Specialised beside each message.
template <class M>
struct Fields;

template <class M, class T>
constexpr Field<M, T> value(T M::*at, std::string_view name = {}, std::uint64_t most = 0) noexcept {
  return {at, FieldIs::kValue, name, most};
}
template <class M, class T>
constexpr Field<M, T> number(T M::*at, std::string_view name = {}) noexcept {
  return {at, FieldIs::kNumber, name, 0};
}
template <class M, class T>
constexpr Field<M, T> instant(T M::*at, std::string_view name = {}) noexcept {
  return {at, FieldIs::kInstant, name, 0};
}
template <class M, class T>
constexpr Field<M, T> datum(T M::*at, std::string_view name = {}) noexcept {
  return {at, FieldIs::kDatum, name, 0};
}
template <class M, class T>
constexpr Field<M, T> on_the_way(T M::*at) noexcept {
  return {at, FieldIs::kOnTheWay, {}, 0};
}

// A list hands its fields to what it is called with. No std::tuple: those of all messages took GCC
// 1.5 s a file.
template <class... F>
constexpr auto fields(F... field) noexcept {
  return [field...](auto&& use) { return use(field...); };
}

// f(value, field) for each field of the list, in order.
template <class M, class F>
constexpr void for_each_field(M& m, F&& f) noexcept {
  Fields<std::remove_const_t<M>>::kList(
      [&](const auto&... field) { (f(m.*field.at, field), ...); });
}

template <class M>
[[nodiscard]] consteval bool has_field(FieldIs is) {
  return Fields<M>::kList([is](const auto&... field) { return ((field.is == is) || ...); });
}

namespace detail {
struct AnyField {
  template <class T>
  constexpr operator T() const noexcept;
};
template <class M, std::size_t... I>
[[nodiscard]] consteval bool takes(std::index_sequence<I...>) {
  return requires { M{(static_cast<void>(I), AnyField{})...}; };
}
template <class M, std::size_t N = 1>
[[nodiscard]] consteval std::size_t member_count() {
  if constexpr (takes<M>(std::make_index_sequence<N + 1>{}))
    return member_count<M, N + 1>();
  else
    return N;
}
template <class M>
[[nodiscard]] consteval std::size_t apart_of() {
  if constexpr (requires { Fields<M>::kApart; })
    return Fields<M>::kApart;
  else
    return 0;
}
}  // namespace detail

// True if the field list plus `kApart` covers every member of the plain struct M.
template <class M>
[[nodiscard]] consteval bool lists_every_field() {
  return detail::member_count<M>() == Fields<M>::kList([](const auto&... field) {
                                        return sizeof...(field);
                                      }) + detail::apart_of<M>();
}

}  // namespace rt
