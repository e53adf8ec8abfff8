#include "tools/haptic/run_file.hpp"

#include <cmath>
#include <cstring>
#include <stdexcept>
#include <type_traits>
#include <utility>
#include <variant>

namespace teletact {

using perception::SurfacePatch;
using perception::Vec3;

namespace {

constexpr char kMagic[8] = {'t', 'e', 'l', 'e', 'h', 'a', 'p', 't'};
constexpr std::uint32_t kVersion = 1;
constexpr std::uint32_t kMostHeader = 1U << 16U;
constexpr std::uint32_t kMostRecord = 1U << 26U;
constexpr std::size_t kMostPoints = std::size_t{1} << 21U;

// ---- bytes

template <class T>
void put(std::string& out, const T& value) {
  static_assert(std::is_trivially_copyable_v<T>);
  char bytes[sizeof(T)];
  std::memcpy(bytes, &value, sizeof(T));
  out.append(bytes, sizeof(T));
}
void put(std::string& out, const Vec3& v) {
  for (int a = 0; a < 3; ++a) put(out, static_cast<double>(v[a]));
}
void put_text(std::string& out, const std::string& text) {
  put(out, static_cast<std::uint16_t>(text.size()));
  out += text;
}

class Cursor {
 public:
  explicit Cursor(const std::string& bytes) : bytes_(bytes) {}
  template <class T>
  bool get(T& value) {
    static_assert(std::is_trivially_copyable_v<T>);
    if (bytes_.size() - at_ < sizeof(T)) return false;
    std::memcpy(&value, bytes_.data() + at_, sizeof(T));
    at_ += sizeof(T);
    return true;
  }
  bool get(Vec3& v) {
    double x = 0, y = 0, z = 0;
    if (!get(x) || !get(y) || !get(z)) return false;
    v = Vec3(x, y, z);
    return true;
  }
  bool get_flag(bool& value) {
    std::uint8_t b = 0;
    if (!get(b) || b > 1) return false;
    value = b != 0;
    return true;
  }
  bool get_text(std::string& text) {
    std::uint16_t n = 0;
    if (!get(n) || bytes_.size() - at_ < n) return false;
    text.assign(bytes_, at_, n);
    at_ += n;
    return true;
  }
  bool copy(void* to, std::size_t n) {
    if (bytes_.size() - at_ < n) return false;
    std::memcpy(to, bytes_.data() + at_, n);
    at_ += n;
    return true;
  }
  [[nodiscard]] bool at_end() const { return at_ == bytes_.size(); }

 private:
  const std::string& bytes_;
  std::size_t at_ = 0;
};

// Runs of equal values: uint16 length, value.
template <class T>
void put_runs(std::string& out, const T* values, std::size_t n) {
  for (std::size_t i = 0; i < n;) {
    std::size_t k = i + 1;
    while (k < n && values[k] == values[i] && k - i < 0xffff) ++k;
    put(out, static_cast<std::uint16_t>(k - i));
    put(out, values[i]);
    i = k;
  }
}
template <class T>
bool get_runs(Cursor& in, T* values, std::size_t n) {
  for (std::size_t i = 0; i < n;) {
    std::uint16_t length = 0;
    T value{};
    if (!in.get(length) || !in.get(value) || length == 0 || length > n - i) return false;
    for (std::size_t k = 0; k < length; ++k) values[i + k] = value;
    i += length;
  }
  return true;
}

// ---- configuration: every key by name, the exact bytes of its value

enum class Type : std::uint8_t { kNumber = 1, kFlag = 2, kText = 3, kNumbers = 4, kInteger = 5 };

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

bool get_value(Cursor& in, config::Section::Field& field) {
  Type type{};
  if (!in.get(type)) return false;
  if (auto* number = std::get_if<config::Section::Number>(&field.value)) {
    return type == Type::kNumber && in.get(*number->value) && std::isfinite(*number->value);
  }
  if (auto* flag = std::get_if<config::Section::Flag>(&field.value)) {
    return type == Type::kFlag && in.get_flag(*flag->value);
  }
  if (auto* text = std::get_if<config::Section::Text>(&field.value)) {
    return type == Type::kText && in.get_text(*text->value);
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
    if (!in.get(v) || !std::isfinite(v)) return false;
  }
  return true;
}

// Empty, or what is wrong.
std::string get_config(Cursor& in, tasks::HapticConfig& config) {
  config::Section s;
  config.describe(s);
  std::uint16_t n = 0;
  if (!in.get(n) || n > 256) return "its list of keys is damaged";
  for (std::uint16_t i = 0; i < n; ++i) {
    std::string key;
    if (!in.get_text(key)) return "its list of keys is damaged";
    config::Section::Field* field = s.find(key);
    if (field == nullptr) return "a key of [haptic] that this version does not know";
    if (!get_value(in, *field)) return "the value of haptic." + key + " is damaged";
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
  for (double* v : {&d.mass_kg, &d.damping_N_s_per_m, &d.coulomb_N, &d.delay_s, &d.quantum_m,
                    &d.force_limit_N, &d.workspace_radius_m, &d.speed_limit_m_per_s}) {
    if (!in.get(*v) || !std::isfinite(*v) || *v < 0) return false;
  }
  return in.get_flag(d.renders_force);
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

void write_all(std::FILE* file, const std::string& bytes) {
  if (std::fwrite(bytes.data(), 1, bytes.size(), file) != bytes.size()) {
    throw std::runtime_error("haptic run: the disk took a part of it only");
  }
}

}  // namespace

HapticRunTick run_tick(const rt::Tick& tick, const tasks::HapticTask::In& in,
                       const tasks::HapticTask::Out& out) noexcept {
  HapticRunTick t;
  t.tick = tick;
  t.stylus = in.stylus;
  t.stylus_ok = in.stylus_ok;
  t.clutch = in.clutch;
  t.view_yaw_rad = in.view_yaw_rad;
  t.mode = in.mode.mode;
  t.mode_seq = in.mode.seq;
  t.f_D = out.force.f_H_D;
  t.f_raw_D = out.telemetry.f_raw_D;
  t.p_WP = out.state.p_WP;
  t.p_WH = out.state.p_WH;
  t.contacts = out.state.contacts;
  t.in_contact = out.telemetry.in_contact;
  return t;
}

void set_inputs(const HapticRunTick& t, tasks::HapticTask::In& in) noexcept {
  in.stylus = t.stylus;
  in.stylus_ok = t.stylus_ok;
  in.clutch = t.clutch;
  in.view_yaw_rad = t.view_yaw_rad;
  in.mode.seq = t.mode_seq;
  in.mode.mode = t.mode;
}

HapticRunWriter::HapticRunWriter(std::FILE* file, const HapticRunHeader& header) : file_(file) {
  std::string body;
  put(body, header.period_s);
  put(body, header.origin);
  put_device(body, header.device);
  put_config(body, header.config);
  std::string all(kMagic, sizeof kMagic);
  put(all, kVersion);
  put(all, static_cast<std::uint32_t>(body.size()));
  write_all(file_, all + body);
}

void HapticRunWriter::record(char tag) {
  std::string head(1, tag);
  put(head, static_cast<std::uint32_t>(bytes_.size()));
  write_all(file_, head);
  write_all(file_, bytes_);
  bytes_.clear();
}

void HapticRunWriter::window(const SurfacePatch& p) {
  put(bytes_, p.map_id);
  put(bytes_, p.seq);
  put(bytes_, rt::ns_of(p.fused));
  put(bytes_, rt::ns_of(p.exposure));
  put(bytes_, p.voxel_size);
  put(bytes_, p.metres_per_unit);
  put(bytes_, static_cast<std::int32_t>(p.nodes));
  for (const std::int32_t o : p.origin_node) put(bytes_, o);
  for (const auto& m : p.palette) {
    for (const float v : {m.stiffness_scale, m.friction_static, m.friction_dynamic,
                          m.texture_amplitude_m, m.texture_period_m}) {
      put(bytes_, v);
    }
  }
  const std::size_t n = p.cells();
  put_runs(bytes_, p.material.data(), n);
  put_runs(bytes_, p.free.data(), n / 64);
  for (std::size_t i = 0; i < n; ++i) {
    if (p.material[i] != 0) put(bytes_, p.distance[i]);
  }
  record('W');
}

void HapticRunWriter::surface(const tasks::SurfacePoints& s) {
  put(bytes_, s.seq);
  put(bytes_, static_cast<std::uint32_t>(s.count));
  for (const auto* v : {&s.x, &s.y, &s.z, &s.nx, &s.ny, &s.nz}) {
    bytes_.append(reinterpret_cast<const char*>(v->data()), s.count * sizeof(float));
  }
  record('S');
}

void HapticRunWriter::tick(const HapticRunTick& t) {
  put_tick(bytes_, t);
  record('T');
  ++ticks_;
}

void HapticRunWriter::finish() {
  put(bytes_, ticks_);
  record('E');
}

bool HapticRunReader::fetch(std::size_t n) {
  bytes_.resize(n);
  return std::fread(bytes_.data(), 1, n, file_) == n;
}

rt::Result<std::unique_ptr<HapticRunReader>> HapticRunReader::open(std::FILE* file,
                                                                   const std::string& name) {
  std::unique_ptr<HapticRunReader> r(new HapticRunReader(file, name));
  if (!r->fetch(16) || std::memcmp(r->bytes_.data(), kMagic, sizeof kMagic) != 0) {
    return r->error("not a haptic run");
  }
  std::uint32_t version = 0, size = 0;
  std::memcpy(&version, r->bytes_.data() + 8, 4);
  std::memcpy(&size, r->bytes_.data() + 12, 4);
  if (version != kVersion) {
    return r->error("a haptic run of version " + std::to_string(version) + "; this is version " +
                    std::to_string(kVersion));
  }
  if (size > kMostHeader || !r->fetch(size)) return r->error("its header is cut off");
  Cursor in(r->bytes_);
  auto& h = r->header_;
  if (!in.get(h.period_s) || !in.get(h.origin) || !get_device(in, h.device)) {
    return r->error("its header is damaged");
  }
  if (!(h.period_s >= 1e-5 && h.period_s <= 0.1) || !h.origin.allFinite()) {
    return r->error("a period of " + std::to_string(h.period_s) +
                    " s; allowed are 10 us to 100 ms");
  }
  const std::string wrong = get_config(in, h.config);
  if (!wrong.empty()) return r->error(wrong);
  if (!in.at_end()) return r->error("its header is damaged");
  return rt::Result<std::unique_ptr<HapticRunReader>>(std::move(r));
}

rt::Result<HapticRunReader::Kind> HapticRunReader::next(SurfacePatch& window,
                                                        tasks::SurfacePoints& surface,
                                                        HapticRunTick& tick) {
  char head[5];
  if (std::fread(head, 1, sizeof head, file_) != sizeof head) {
    return error("cut off after " + std::to_string(ticks_) + " ticks");
  }
  std::uint32_t size = 0;
  std::memcpy(&size, head + 1, 4);
  if (size > kMostRecord || !fetch(size)) {
    return error("cut off after " + std::to_string(ticks_) + " ticks");
  }
  Cursor in(bytes_);
  const auto damaged = [&](const char* what) {
    return error(std::string("a damaged ") + what + " after " + std::to_string(ticks_) + " ticks");
  };
  switch (head[0]) {
    case 'W':
      if (!get_window(in, window)) return damaged("window");
      return Kind::kWindow;
    case 'S':
      if (!get_surface(in, surface)) return damaged("ray cast");
      return Kind::kSurface;
    case 'T':
      if (!get_tick(in, tick)) return damaged("tick");
      ++ticks_;
      return Kind::kTick;
    case 'E': {
      std::uint64_t ticks = 0;
      if (!in.get(ticks) || !in.at_end() || ticks != ticks_) return damaged("end");
      return Kind::kEnd;
    }
    default:
      return damaged("record");
  }
}

}  // namespace teletact
