#include "tools/touch/tick_rerun.hpp"

#include <bit>
#include <cstdint>
#include <stdexcept>

#include "rt/clock/box_time.hpp"
#include "rt/memory/section.hpp"

namespace teletact {

using perception::SurfacePatch;
using perception::Vec3;

namespace {

drivers::DeviceProperties unbounded(drivers::DeviceProperties device) {
  device.damping_N_s_per_m = 1e12;
  return device;
}

bool same(const Vec3& a, const Vec3& b) {
  for (int i = 0; i < 3; ++i) {
    if (std::bit_cast<std::uint64_t>(a[i]) != std::bit_cast<std::uint64_t>(b[i])) return false;
  }
  return true;
}

}  // namespace

HapticRerun::HapticRerun(rt::NonRealtime& nrt, HapticRunReader& reader,
                         const tasks::HapticConfig& config, Caster caster)
    : reader_(reader),
      caster_(std::move(caster)),
      casting_(config.method == "force_shading"),
      task_(nrt, config, unbounded(reader.header().device), reader.header().period_s) {
  for (auto& w : windows_) w = std::make_unique<SurfacePatch>();
}

bool HapticRerun::next() {
  for (;;) {
    const std::size_t window = (window_at_ + 1) % kWindows, surface = (surface_at_ + 1) % kSurfaces;
    auto kind = reader_.next(*windows_[window], surfaces_[surface], tick_);
    if (!kind) throw std::runtime_error(kind.error());
    switch (kind.value()) {
      case HapticRunReader::Kind::kWindow:
        window_at_ = window;
        newest_ = windows_[window].get();
        if (casting_ && caster_ && caster_(*newest_, surfaces_[surface])) {
          surface_at_ = surface;
          fresh_surface_ = &surfaces_[surface];
        }
        break;
      case HapticRunReader::Kind::kSurface:
        surface_at_ = surface;
        fresh_surface_ = &surfaces_[surface];
        caster_ = nullptr;  // the run's own casts count
        break;
      case HapticRunReader::Kind::kEnd:
        return false;
      case HapticRunReader::Kind::kTick: {
        set_inputs(tick_, in_);
        in_.patch_newest = task_.wants_patch() ? newest_ : nullptr;
        in_.surface = casting_ ? fresh_surface_ : nullptr;
        fresh_surface_ = nullptr;
        const std::int64_t before = rt::thread_cpu_ns();
        {
          rt::Section section;
          (void)task_.step(tick_.tick, in_, out_);
        }
        cpu_us_ = 1e-3 * static_cast<double>(rt::thread_cpu_ns() - before);
        return true;
      }
    }
  }
}

bool HapticRerun::equal() const {
  return same(tick_.f_D, out_.force.f_H_D) && same(tick_.f_raw_D, out_.telemetry.f_raw_D) &&
         same(tick_.p_WP, out_.state.p_WP) && same(tick_.p_WH, out_.state.p_WH) &&
         tick_.contacts == out_.state.contacts && tick_.in_contact == out_.telemetry.in_contact;
}

bool first_touch(HapticRunReader& reader, Vec3& p_W, Vec3& normal_W) {
  auto window = std::make_unique<SurfacePatch>();
  tasks::SurfacePoints surface;
  HapticRunTick tick;
  for (;;) {
    auto kind = reader.next(*window, surface, tick);
    if (!kind) throw std::runtime_error(kind.error());
    if (kind.value() == HapticRunReader::Kind::kEnd) return false;
    if (kind.value() != HapticRunReader::Kind::kTick || !tick.in_contact) continue;
    const Vec3 way = tick.p_WP - tick.p_WH;
    if (!(way.norm() > 1e-6)) continue;
    p_W = tick.p_WP;
    normal_W = way.normalized();
    return true;
  }
}

}  // namespace teletact
