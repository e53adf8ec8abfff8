// The proxy on the surface: where it is, where it was, and whether what it stands on is to be
// relied on.  Frame: W (= map).  SI.  Nothing here allocates, locks or throws.
#pragma once

#include "tasks/haptic/field.hpp"
#include "tasks/haptic/proxy.hpp"

namespace tasks {

class Contact {
 public:
  Contact() = default;
  Contact(ProxyStep method, const ProxyConfig& config) : config_(config), step_(method) {}

  [[nodiscard]] const ProxyState& proxy() const noexcept { return proxy_; }
  [[nodiscard]] ProxyState& proxy() noexcept { return proxy_; }
  [[nodiscard]] bool touches() const noexcept {
    return proxy_.phase == ProxyState::Phase::kContact;
  }
  [[nodiscard]] double tip_radius_m() const noexcept { return config_.tip_radius_m; }

  // Method force_shading: the ray cast that the proxy stands on from now on; null: none.
  void stand_on(const SurfacePoints* surface) noexcept { config_.surface = surface; }
  // A tick begins: what was the proxy's place becomes the place where it rested.
  void begin_tick() noexcept { rested_W_ = proxy_.p_WP(); }
  void step(const Field& field, const perception::Vec3& p_WH) noexcept {
    step_(field, p_WH, proxy_, config_);
  }
  void forget() noexcept { proxy_ = ProxyState{}; }
  // The next sweep begins at p_W, and may touch what it enters from seen-free space.
  void start_again_at(const perception::Vec3& p_W) noexcept {
    forget();
    proxy_.set_p(p_W);
    proxy_.phase = ProxyState::Phase::kUnknown;
  }

  // How far the surface went back from under the proxy in this tick, m.
  [[nodiscard]] double gone_back_m(const Field& field) const noexcept {
    return gone_back(field, rested_W_, config_.tip_radius_m);
  }
  // Less than a voxel of solid lies behind the surface that the hand touches or comes to: such a
  // wall is not reliable.
  [[nodiscard]] bool thin(const Field& field, const perception::Vec3& p_WH) const noexcept {
    const double voxel = field.voxel();
    if (touches()) return field.sample(proxy_.p_WP() - voxel * proxy_.normal_W()).value > 0;
    if (field.empty() || proxy_.phase != ProxyState::Phase::kFree) return false;
    const FieldSample here = field.sample(p_WH);
    const double slope = here.gradient.norm();
    if (!here.known || here.value > 0.5 * voxel || slope < 0.3) return false;
    return field.sample(p_WH - (voxel / slope) * here.gradient).value > 0;
  }

 private:
  ProxyConfig config_;
  ProxyStep step_ = nullptr;
  ProxyState proxy_;
  perception::Vec3 rested_W_ = perception::Vec3::Zero();  // where the proxy was last tick
};

}  // namespace tasks
