#include "tools/touch/tick_codec.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <variant>

namespace teletact::haptic_run {

using perception::SurfacePatch;
using perception::Vec3;

namespace {

constexpr std::size_t kMostPoints = std::size_t{1} << 21U;

enum class Type : std::uint8_t { kNumber = 1, kFlag = 2, kText = 3, kNumbers = 4, kInteger = 5 };

// Where teletact touch, which has no device, goes beyond what a scene may say.
struct Range {
  const char* key;
  double lo, hi;
};
constexpr Range kOfTouch[] = {{"stiffness_N_per_m", 1, 1e5},
                              {"force_limit_N", 0.01, 1000},
                              {"tip_radius_m", 0, 0.8},
                              {"workspace_W_m", -2e6, 2e6}};

// Empty, or why v can not be the value of `key`.
std::string out_of_range(const std::string& key, double v, double lo, double hi) {
  for (const Range& r : kOfTouch) {
    if (key == r.key) lo = r.lo, hi = r.hi;
  }
  if (v >= lo && v <= hi) return {};
  std::ostringstream text;
  text << "haptic." << key << " = " << v << ": allowed are " << lo << " to " << hi;
  return text.str();
}

// False: damaged. What is whole and out of range is told by `wrong`.
bool get_value(Cursor& in, config::Section::Field& field, std::string& wrong) {
  Type type{};
  if (!in.get(type)) return false;
  if (auto* number = std::get_if<config::Section::Number>(&field.value)) {
    if (type != Type::kNumber || !in.get(*number->value)) return false;
    wrong = out_of_range(field.key, *number->value, number->lo, number->hi);
    return true;
  }
  if (auto* flag = std::get_if<config::Section::Flag>(&field.value)) {
    return type == Type::kFlag && in.get_flag(*flag->value);
  }
  if (auto* text = std::get_if<config::Section::Text>(&field.value)) {
    if (type != Type::kText || !in.get_text(*text->value)) return false;
    const auto& allowed = text->allowed;
    return allowed.empty() ||
           std::find(allowed.begin(), allowed.end(), *text->value) != allowed.end();
  }
  if (auto* integer = std::get_if<config::Section::Integer>(&field.value)) {
    std::int32_t v = 0;
    if (type != Type::kInteger || !in.get(v) || v < integer->lo || v > integer->hi) return false;
    *integer->value = v;
    return true;
  }
  auto* numbers = std::get_if<config::Section::Numbers>(&field.value);
  std::uint16_t n = 0;
  if (numbers == nullptr || type != Type::kNumbers || !in.get(n) || n != numbers->values.size()) {
    return false;
  }
  for (double& v : numbers->values) {
    if (!in.get(v)) return false;
    if (wrong.empty()) wrong = out_of_range(field.key, v, numbers->lo, numbers->hi);
  }
  return true;
}

}  // namespace

void put_config(std::string& out, const tasks::HapticConfig& config) {
  tasks::HapticConfig copy = config;
  config::Section s;
  copy.describe(s);
  put(out, static_cast<std::uint16_t>(s.fields().size()));
  for (const auto& field : s.fields()) {
    put_text(out, field->key);
    if (const auto* number = std::get_if<config::Section::Number>(&field->value)) {
      put(out, Type::kNumber);
      put(out, *number->value);
    } else if (const auto* flag = std::get_if<config::Section::Flag>(&field->value)) {
      put(out, Type::kFlag);
      put(out, static_cast<std::uint8_t>(*flag->value ? 1 : 0));
    } else if (const auto* text = std::get_if<config::Section::Text>(&field->value)) {
      put(out, Type::kText);
      put_text(out, *text->value);
    } else if (const auto* integer = std::get_if<config::Section::Integer>(&field->value)) {
      put(out, Type::kInteger);
      put(out, static_cast<std::int32_t>(*integer->value));
    } else if (const auto* numbers = std::get_if<config::Section::Numbers>(&field->value)) {
      put(out, Type::kNumbers);
      put(out, static_cast<std::uint16_t>(numbers->values.size()));
      for (const double v : numbers->values) put(out, v);
    } else {
      throw std::logic_error("run file: a key of [haptic] has a type that is not recorded");
    }
  }
}

std::string get_config(Cursor& in, tasks::HapticConfig& config) {
  config::Section s;
  config.describe(s);
  std::uint16_t n = 0;
  if (!in.get(n) || n > 256) return "its list of keys is damaged";
  for (std::uint16_t i = 0; i < n; ++i) {
    std::string key;
    if (!in.get_text(key)) return "its list of keys is damaged";
    config::Section::Field* field = s.find(key);
    if (field == nullptr)
      return "it has the key haptic." + key + ", which this version does not know";
    std::string wrong;
    if (!get_value(in, *field, wrong)) return "the value of haptic." + key + " is damaged";
    if (!wrong.empty()) return wrong;
  }
  return {};
}

void put_device(std::string& out, const drivers::DeviceProperties& d) {
  for (const double v : {d.mass_kg, d.damping_N_s_per_m, d.coulomb_N, d.delay_s, d.quantum_m,
                         d.force_limit_N, d.workspace_radius_m, d.speed_limit_m_per_s}) {
    put(out, v);
  }
  put(out, static_cast<std::uint8_t>(d.renders_force ? 1 : 0));
}

bool get_device(Cursor& in, drivers::DeviceProperties& d) {
  constexpr double kMost = 1e12;  // teletact touch says so of the damping
  for (double* v : {&d.mass_kg, &d.damping_N_s_per_m, &d.coulomb_N, &d.delay_s, &d.quantum_m,
                    &d.force_limit_N, &d.workspace_radius_m, &d.speed_limit_m_per_s}) {
    if (!in.get(*v) || !(*v >= 0 && *v <= kMost)) return false;
  }
  if (d.delay_s > 1) return false;  // more than a loop that anybody closes
  return in.get_flag(d.renders_force);
}

void put_window(std::string& out, const SurfacePatch& p) {
  put(out, p.map_id);
  put(out, p.seq);
  put(out, rt::ns_of(p.fused));
  put(out, rt::ns_of(p.exposure));
  put(out, p.voxel_size);
  put(out, p.metres_per_unit);
  put(out, static_cast<std::int32_t>(p.nodes));
  for (const std::int32_t o : p.origin_node) put(out, o);
  for (const auto& m : p.palette) {
    for (const float v : {m.stiffness_scale, m.friction_static, m.friction_dynamic,
                          m.texture_amplitude_m, m.texture_period_m}) {
      put(out, v);
    }
  }
  const std::size_t n = p.cells();
  put_runs(out, p.material.data(), n);
  put_runs(out, p.free.data(), n / 64);
  for (std::size_t i = 0; i < n; ++i) {
    if (p.material[i] != 0) put(out, p.distance[i]);
  }
}

bool get_window(Cursor& in, SurfacePatch& p) {
  std::int64_t fused = 0, exposure = 0;
  if (!in.get(p.map_id) || !in.get(p.seq) || !in.get(fused) || !in.get(exposure) ||
      !in.get(p.voxel_size) || !in.get(p.metres_per_unit) || !in.get(p.nodes)) {
    return false;
  }
  for (std::int32_t& o : p.origin_node) {
    if (!in.get(o) || o < -(1 << 28) || o > (1 << 28)) return false;
  }
  if (p.nodes < 8 || p.nodes > SurfacePatch::kMaxNodes || p.nodes % 4 != 0) return false;
  if (!(p.voxel_size >= 1e-4 && p.voxel_size <= 1) ||
      !(p.metres_per_unit > 0 && p.metres_per_unit < 1)) {
    return false;
  }
  p.fused = rt::time_from_ns(fused);
  p.exposure = rt::time_from_ns(exposure);
  for (auto& m : p.palette) {
    float values[5];
    if (!in.copy(values, sizeof values)) return false;
    for (const float v : values) {
      if (!std::isfinite(v)) return false;
    }
    m = {values[0], values[1], values[2], values[3], values[4]};
  }
  const std::size_t n = p.cells();
  if (!get_runs(in, p.material.data(), n) || !get_runs(in, p.free.data(), n / 64)) return false;
  for (std::size_t i = 0; i < n; ++i) {
    p.distance[i] = 0;
    if (p.material[i] != 0 && !in.get(p.distance[i])) return false;
  }
  p.checksum = 0;
  return in.at_end();
}

void put_surface(std::string& out, const tasks::SurfacePoints& s) {
  put(out, s.seq);
  put(out, static_cast<std::uint32_t>(s.count));
  for (const auto* v : {&s.x, &s.y, &s.z, &s.nx, &s.ny, &s.nz}) {
    out.append(reinterpret_cast<const char*>(v->data()), s.count * sizeof(float));
  }
}

bool get_surface(Cursor& in, tasks::SurfacePoints& s) {
  std::uint32_t n = 0;
  if (!in.get(s.seq) || !in.get(n) || n > kMostPoints) return false;
  s.resize(n);
  for (auto* v : {&s.x, &s.y, &s.z, &s.nx, &s.ny, &s.nz}) {
    if (!in.copy(v->data(), n * sizeof(float))) return false;
    for (std::size_t i = 0; i < n; ++i) {
      if (!std::isfinite((*v)[i])) return false;
    }
  }
  return in.at_end();
}

void put_tick(std::string& out, const HapticRunTick& t) {
  put(out, t.tick.k);
  put(out, rt::ns_of(t.tick.release));
  put(out, rt::ns_of(t.tick.start));
  put(out, t.tick.period.count());
  put(out, t.stylus.seq);
  put(out, rt::ns_of(t.stylus.taken));
  put(out, t.stylus.p_DH);
  for (const bool flag : {t.stylus_ok, t.stylus.button, t.stylus.repeated, t.clutch,
                          t.view_yaw_rad.has_value(), t.in_contact}) {
    put(out, static_cast<std::uint8_t>(flag ? 1 : 0));
  }
  put(out, t.stylus.state);
  put(out, t.mode);
  put(out, t.mode_seq);
  put(out, t.view_yaw_rad.value_or(0));
  for (const Vec3* v : {&t.f_D, &t.f_raw_D, &t.p_WP, &t.p_WH}) put(out, *v);
  put(out, t.contacts);
}

bool get_tick(Cursor& in, HapticRunTick& t) {
  std::int64_t release = 0, start = 0, period = 0, taken = 0;
  bool view = false;
  std::uint8_t state = 0, mode = 0;
  double yaw = 0;
  // The hand may be anything, also not a number: that is a thing to replay.
  if (!in.get(t.tick.k) || !in.get(release) || !in.get(start) || !in.get(period) ||
      !in.get(t.stylus.seq) || !in.get(taken) || !in.get(t.stylus.p_DH) ||
      !in.get_flag(t.stylus_ok) || !in.get_flag(t.stylus.button) ||
      !in.get_flag(t.stylus.repeated) || !in.get_flag(t.clutch) || !in.get_flag(view) ||
      !in.get_flag(t.in_contact) || !in.get(state) || !in.get(mode) || !in.get(t.mode_seq) ||
      !in.get(yaw)) {
    return false;
  }
  for (Vec3* v : {&t.f_D, &t.f_raw_D, &t.p_WP, &t.p_WH}) {
    if (!in.get(*v)) return false;
  }
  if (!in.get(t.contacts) || !in.at_end() || state > 3 || mode > 4 || !std::isfinite(yaw) ||
      period <= 0 || period > 1'000'000'000) {
    return false;
  }
  t.tick.release = rt::time_from_ns(release);
  t.tick.start = rt::time_from_ns(start);
  t.tick.period = rt::Nanos{period};
  t.stylus.taken = rt::time_from_ns(taken);
  t.stylus.state = static_cast<drivers::DeviceState>(state);
  t.mode = static_cast<tasks::Mode>(mode);
  t.view_yaw_rad = view ? std::optional<double>(yaw) : std::nullopt;
  return true;
}

}  // namespace teletact::haptic_run
