// Bodies of the wire by their field lists, and the list of messages that the schema hash covers.
// wire.hpp declares encode() and decode() of the messages that the link itself or a rule of its own
// handles. The message of any other edge has them from here, as soon as kSchema names it.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <concepts>
#include <cstring>
#include <span>
#include <string_view>
#include <tuple>

#include "drivers/link/wire.hpp"

namespace drivers {

template <class M>
struct SchemaRow {
  std::string_view name;
};
// In the order of the schema hash: a new message goes last.
inline constexpr std::tuple kSchema{SchemaRow<RobotState>{"robot_state"},
                                    SchemaRow<RobotGoal>{"robot_goal"},
                                    SchemaRow<CommandReport>{"command_report"}};
template <class M>
concept InSchema = std::apply(
    []<class... Of>(const SchemaRow<Of>&...) { return (std::same_as<M, Of> || ...); }, kSchema);

namespace wire {

// Appends fields in order; `ok` turns false when the room is used up.
struct Writer {
  std::span<std::uint8_t> out;
  std::size_t at = 0;
  bool ok = true;
  template <class T>
  void put(T v) noexcept {
    if (at + sizeof v > out.size()) {
      ok = false;
      return;
    }
    std::array<std::uint8_t, sizeof v> b;
    std::memcpy(b.data(), &v, sizeof v);
    if constexpr (std::endian::native == std::endian::big) std::reverse(b.begin(), b.end());
    std::memcpy(out.data() + at, b.data(), sizeof v);
    at += sizeof v;
  }
  void field(rt::Time t) noexcept { put(rt::ns_of(t)); }
  template <class T>
  void field(T v) noexcept {
    put(v);
  }
  [[nodiscard]] std::size_t size() const noexcept { return ok ? at : 0; }
};

struct Reader {
  std::span<const std::uint8_t> in;
  std::size_t at = 0;
  bool ok = true;
  template <class T>
  void get(T& v) noexcept {
    if (at + sizeof v > in.size()) {
      ok = false;
      return;
    }
    std::array<std::uint8_t, sizeof v> b;
    std::memcpy(b.data(), in.data() + at, sizeof v);
    if constexpr (std::endian::native == std::endian::big) std::reverse(b.begin(), b.end());
    std::memcpy(&v, b.data(), sizeof v);
    at += sizeof v;
  }
  // A number of the physical world: finite and below anything a robot can mean.
  void field(double& v, const auto&) noexcept {
    get(v);
    if (!std::isfinite(v) || std::abs(v) > 1e6) ok = false;
  }
  void field(std::int64_t& ns, const auto&) noexcept {
    get(ns);
    if (!plausible_instant(ns)) ok = false;
  }
  void field(rt::Time& t, const auto& list_row) noexcept {
    std::int64_t ns = 0;
    field(ns, list_row);
    t = rt::time_from_ns(ns);
  }
  template <std::unsigned_integral T>
  void field(T& v, const auto& list_row) noexcept {
    get(v);
    if (list_row.most != 0 && v > list_row.most) ok = false;
  }
  [[nodiscard]] bool done() const noexcept { return ok && at == in.size(); }
};

template <class M>
std::size_t put_all(const M& m, std::span<std::uint8_t> out) noexcept {
  Writer w{out};
  rt::for_each_field(m, [&](const auto& v, const auto&) { w.field(v); });
  return w.size();
}

template <class M>
[[nodiscard]] bool get_all(std::span<const std::uint8_t> in, M& m) noexcept {
  Reader r{in};
  rt::for_each_field(m, [&](auto& v, const auto& list_row) { r.field(v, list_row); });
  return r.done();
}

}  // namespace wire

template <InSchema M>
std::size_t encode(const M& m, std::span<std::uint8_t> out) noexcept {
  return wire::put_all(m, out);
}
template <InSchema M>
[[nodiscard]] bool decode(std::span<const std::uint8_t> in, M& m) noexcept {
  return wire::get_all(in, m);
}

}  // namespace drivers
