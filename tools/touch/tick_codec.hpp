// Encodes and decodes the parts of a haptic run (tick_file.hpp): machine byte order, no padding.
// Decoding checks everything.
#pragma once

#include <cstdint>
#include <cstring>
#include <string>
#include <type_traits>

#include "tools/touch/tick_file.hpp"

namespace teletact::haptic_run {

template <class T>
void put(std::string& out, const T& value) {
  static_assert(std::is_trivially_copyable_v<T>);
  char bytes[sizeof(T)];
  std::memcpy(bytes, &value, sizeof(T));
  out.append(bytes, sizeof(T));
}
inline void put(std::string& out, const perception::Vec3& v) {
  for (int a = 0; a < 3; ++a) put(out, static_cast<double>(v[a]));
}
inline void put_text(std::string& out, const std::string& text) {
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
  bool get(perception::Vec3& v) {
    double x = 0, y = 0, z = 0;
    if (!get(x) || !get(y) || !get(z)) return false;
    v = perception::Vec3(x, y, z);
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

// Every key by name, the exact bytes of its value. get_config: empty, or what is wrong.
void put_config(std::string& out, const tasks::HapticConfig& config);
[[nodiscard]] std::string get_config(Cursor& in, tasks::HapticConfig& config);

// False: damaged. A window, a surface and a tick end where the bytes do.
void put_device(std::string& out, const drivers::DeviceProperties& d);
[[nodiscard]] bool get_device(Cursor& in, drivers::DeviceProperties& d);
void put_window(std::string& out, const perception::SurfacePatch& p);
[[nodiscard]] bool get_window(Cursor& in, perception::SurfacePatch& p);
void put_surface(std::string& out, const tasks::SurfacePoints& s);
[[nodiscard]] bool get_surface(Cursor& in, tasks::SurfacePoints& s);
void put_tick(std::string& out, const HapticRunTick& t);
[[nodiscard]] bool get_tick(Cursor& in, HapticRunTick& t);

}  // namespace teletact::haptic_run
