#include "tools/desk/desk_views.hpp"

#include <turbojpeg.h>

#include <algorithm>
#include <bit>
#include <cstring>
#include <stdexcept>

#include "perception/geometry/pose.hpp"
#include "tools/console/view_bytes.hpp"

namespace teletact {

namespace {

void floats(ByteWriter& w, const std::array<float, 3>& v) {
  for (const float x : v) w.f32(x);
}
void planar(ByteWriter& w, const perception::Pose2& X) {
  for (const double x : {X.x, X.y, X.yaw}) w.f32(static_cast<float>(x));
}
// Position, quaternion w x y z.
std::array<double, 7> seven(const perception::Pose& X) {
  const Eigen::Quaterniond q(X.linear());
  const auto& p = X.translation();
  return {p.x(), p.y(), p.z(), q.w(), q.x(), q.y(), q.z()};
}

}  // namespace

std::vector<std::uint8_t> pose_body(const PoseView& v) {
  std::vector<std::uint8_t> out;
  out.reserve(kPoseViewBytes);
  ByteWriter w(out);
  floats(w, v.hand);
  floats(w, v.proxy);
  floats(w, v.force_N);
  floats(w, v.normal);
  w.u32(v.flags);
  w.f32(v.reach_m);
  planar(w, v.robot);
  for (const double x : {v.v_B.vx, v.v_B.vy, v.v_B.wz}) w.f32(static_cast<float>(x));
  planar(w, v.predicted);
  for (const double x : v.wheel_rad) w.f32(static_cast<float>(x));
  w.f32(static_cast<float>(v.error_m));
  for (const double x : seven(v.X_WC)) w.f32(static_cast<float>(x));
  planar(w, v.goal);
  for (const std::uint8_t x : {v.mode, v.robot_mode, v.phase, v.tracking}) w.u8(x);
  w.u32(v.path_seq);
  return out;
}

std::vector<std::uint8_t> cost_map_body(const perception::CostMap& map) {
  const auto cells = static_cast<std::size_t>(map.width) * static_cast<std::size_t>(map.height);
  std::vector<std::uint8_t> out;
  out.reserve(64 + cells);
  ByteWriter w(out);
  w.u16(static_cast<std::uint16_t>(map.width));
  w.u16(static_cast<std::uint16_t>(map.height));
  w.f32(static_cast<float>(map.resolution));
  for (const double x : seven(map.X_WM)) w.f64(x);
  w.bytes(std::span(map.cost).first(cells));
  return out;
}

std::vector<std::uint8_t> moving_body(const perception::CostMap& map) {
  const auto n =
      static_cast<std::size_t>(std::clamp(map.moving_count, 0, perception::CostMap::kMaxMoving));
  std::vector<std::uint8_t> out;
  ByteWriter w(out);
  w.u16(static_cast<std::uint16_t>(n));
  for (std::size_t i = 0; i < n && map.width > 0; ++i) {
    const int cell = map.moving[i].cell;
    const perception::Vec3 p_M((cell % map.width + 0.5) * map.resolution,
                               (cell / map.width + 0.5) * map.resolution, 0);
    const perception::Vec3 p_W = map.X_WM * p_M;
    w.f32(static_cast<float>(p_W.x()));
    w.f32(static_cast<float>(p_W.y()));
  }
  return out;
}

std::vector<std::uint8_t> selection_body(const Proposal& p) {
  std::vector<std::uint8_t> out;
  out.reserve(8 + (p.mask.size() + 7) / 8);
  ByteWriter w(out);
  w.u16(static_cast<std::uint16_t>(p.width));
  w.u16(static_cast<std::uint16_t>(p.height));
  w.u32(p.number);
  for (std::size_t i = 0; i < p.mask.size(); i += 8) {
    unsigned byte = 0;
    for (std::size_t bit = 0; bit < 8 && i + bit < p.mask.size(); ++bit)
      byte |= (p.mask[i + bit] != 0 ? 1U : 0U) << bit;
    w.u8(static_cast<std::uint8_t>(byte));
  }
  return out;
}

PictureMaker::PictureMaker() : jpeg_(tjInitCompress()) {
  if (jpeg_ == nullptr) throw std::runtime_error("libturbojpeg does not start");
}
PictureMaker::~PictureMaker() { tjDestroy(jpeg_); }

perception::Pose carried(const perception::Pose& X_WC, const perception::Pose2& base_W,
                         const perception::Twist2& v_B, double s) {
  // The same motion of the world's points from wherever on the way it is begun.
  const perception::Pose2 step =
      perception::compose(perception::integrate(base_W, v_B, s), perception::inverse(base_W));
  perception::Pose moved = perception::Pose::Identity();
  moved.linear() = perception::rotation_about_z(step.yaw);
  moved.translation() << step.x, step.y, 0;
  return moved * X_WC;
}

std::vector<std::uint8_t> PictureMaker::body(const perception::RgbdFrame& f,
                                             const perception::Pose& X_WC) {
  constexpr int kQuality = 75;
  const auto& k = f.intrinsics;
  const auto n = static_cast<std::size_t>(k.width) * static_cast<std::size_t>(k.height);
  unsigned char* jpeg = nullptr;
  unsigned long size = 0;
  if (f.has_colour &&
      tjCompress2(jpeg_, reinterpret_cast<const unsigned char*>(f.colour.data()), k.width, 0,
                  k.height, TJPF_RGB, &jpeg, &size, TJSAMP_420, kQuality, TJFLAG_FASTDCT) != 0)
    size = 0;
  std::vector<std::uint8_t> out;
  out.reserve(92 + 2 * n + size);
  ByteWriter w(out);
  w.u16(static_cast<std::uint16_t>(k.width));
  w.u16(static_cast<std::uint16_t>(k.height));
  for (const double x : {k.fx, k.fy, k.cx, k.cy}) w.f32(static_cast<float>(x));
  for (const double x : seven(X_WC)) w.f64(x);
  w.u32(static_cast<std::uint32_t>(2 * n));
  w.u32(static_cast<std::uint32_t>(size));
  w.u8(size > 0 ? 1 : 0);
  for (int i = 0; i < 3; ++i) w.u8(0);
  static_assert(std::endian::native == std::endian::little, "depth goes out as it lies in memory");
  w.bytes({reinterpret_cast<const std::uint8_t*>(f.depth_mm.data()), 2 * n});
  if (size > 0) w.bytes({jpeg, size});
  tjFree(jpeg);
  return out;
}

}  // namespace teletact
