#include "drivers/camera/passing_camera.hpp"

namespace drivers {

using perception::RgbdFrame;

namespace {

constexpr DepthRange kRange{0.4, 5.0};
constexpr DepthNoiseConfig kKinect{1.0, 0.3, 0.5, 0.02};
constexpr std::uint64_t kSeed = 1;
constexpr int kRounds = 200;  // of 4.2 s: longer than any input that is stored
constexpr double kFar_m = 1.3, kNear_m = 1.0;
constexpr double kSide_m = 1.3;  // out of view to either side, at both distances

WorldConfig somebody() {
  WorldConfig w;
  auto& body = w.cylinders.emplace_back();
  body.name = "body";
  body.position_m = {kFar_m, kSide_m, 0};
  body.radius_m = 0.24;
  body.height_m = 1.51;
  body.paint.colour = {60, 75, 110};
  auto& head = w.spheres.emplace_back();
  head.name = "head";
  head.position_m = {kFar_m, kSide_m, 1.63};
  head.radius_m = 0.12;
  head.paint.colour = {205, 160, 130};
  auto& walk = w.movers.emplace_back();
  walk.name = "walk";
  walk.shapes = "body, head";
  walk.kind = "walk";
  walk.speed_m_per_s = 1.5;
  const auto go = [&walk](double x_m, double y_m) {
    walk.waypoints.emplace_back().offset_m = {x_m - kFar_m, y_m - kSide_m, 0};
  };
  for (int i = 0; i < kRounds; ++i) {
    go(kFar_m, -kSide_m);
    go(kNear_m, -kSide_m);
    go(kNear_m, kSide_m);
    go(kFar_m, kSide_m);
  }
  return w;
}

}  // namespace

PassingCamera::PassingCamera(rt::NonRealtime& nrt, std::unique_ptr<Camera> camera,
                             const perception::Pose& X_BC, rt::Time from)
    : camera_(std::move(camera)),
      X_BC_(X_BC),
      from_(from),
      world_(nrt, somebody(), from),
      noise_(nrt, kKinect),
      scratch_(nrt, world_.shapes().size()),
      alone_(std::make_unique<RgbdFrame>()) {
  scratch_.shape.resize(RgbdFrame::kMaxPixels);
}

CameraStatus PassingCamera::poll(rt::Time now, RgbdFrame& out) noexcept {
  const CameraStatus status = camera_->poll(now, out);
  if (status == CameraStatus::kFrame && out.exposure >= from_) add_to(out);
  return status;
}

int PassingCamera::add_to(RgbdFrame& out) noexcept {
  scratch_.colour = out.has_colour;
  render(world_, out.intrinsics, X_BC_, kRange, noise_, kSeed, out.seq, scratch_, *alone_,
         out.exposure);
  const auto pixels = static_cast<std::size_t>(out.intrinsics.width) *
                      static_cast<std::size_t>(out.intrinsics.height);
  int shown = 0;
  for (std::size_t i = 0; i < pixels; ++i) {
    if (scratch_.shape[i] < 0) continue;
    // Before noise: where they drop out there is no reading of what is behind them either.
    const float z_mm = 1e3F / scratch_.inverse_m[i];
    if (out.depth_mm[i] != 0 && static_cast<float>(out.depth_mm[i]) <= z_mm) continue;
    out.depth_mm[i] = alone_->depth_mm[i];
    if (out.has_colour) out.colour[i] = alone_->colour[i];
    ++shown;
  }
  return shown;
}

}  // namespace drivers
