#include "tools/measure/bench/link/link_depth.hpp"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <memory>

#include "drivers/camera/synthetic_camera.hpp"
#include "drivers/link/frame_codec.hpp"
#include "drivers/link/wire.hpp"
#include "drivers/world/world.hpp"
#include "tools/measure/bench/codec/codec_film.hpp"
#include "tools/record/input_record.hpp"

namespace teletact {

namespace {

using perception::RgbdFrame;

// The lens on the true base, between what the console saw of the twin each 20 ms.
class TruthPose final : public drivers::PoseSource {
 public:
  TruthPose(const std::vector<TruthSample>& truth, const perception::Pose& X_BC)
      : truth_(truth), X_BC_(X_BC) {}
  [[nodiscard]] perception::Pose X_WC_at(rt::Time t) noexcept override {
    const auto after =
        std::lower_bound(truth_.begin(), truth_.end(), t,
                         [](const TruthSample& s, rt::Time at) { return s.stamp < at; });
    const TruthSample& b = after == truth_.end() ? truth_.back() : *after;
    const TruthSample& a = after == truth_.begin() ? b : *(after - 1);
    const double span = rt::seconds(b.stamp - a.stamp);
    const double f = span > 0 ? std::clamp(rt::seconds(t - a.stamp) / span, 0.0, 1.0) : 0;
    const double yaw = a.yaw_rad + f * std::remainder(b.yaw_rad - a.yaw_rad, 2 * M_PI);
    perception::Pose X_WB = perception::Pose::Identity();
    X_WB.linear() = Eigen::AngleAxisd(yaw, perception::Vec3::UnitZ()).toRotationMatrix();
    X_WB.translation() =
        perception::Vec3(a.x_m + f * (b.x_m - a.x_m), a.y_m + f * (b.y_m - a.y_m), 0);
    return X_WB * X_BC_;
  }

 private:
  const std::vector<TruthSample>& truth_;
  perception::Pose X_BC_;
};

// Sums of squared errors, each over the sensor's own sigma there.
struct Sums {
  double decoded = 0, sensor = 0;
  std::uint64_t pixels = 0;

  void add(const RgbdFrame& out, const RgbdFrame& in, const RgbdFrame& truth) {
    const auto& k = truth.intrinsics;
    std::vector<std::uint8_t> inner(static_cast<std::size_t>(k.width * k.height));
    mark_inner(truth.depth_mm.data(), k.width, k.height, inner.data());
    for (std::size_t n = 0; n < inner.size(); ++n) {
      const double t = truth.depth_mm[n], x = in.depth_mm[n], y = out.depth_mm[n];
      if (inner[n] == 0 || t <= 0 || x <= 0 || y <= 0) continue;
      const double sigma = 1e3 * drivers::kinect_v2_sigma_m(1e-3 * t);
      decoded += (y - t) * (y - t) / (sigma * sigma);
      sensor += (x - t) * (x - t) / (sigma * sigma);
      ++pixels;
    }
  }
};

LinkDepth not_measured(std::string why) {
  LinkDepth out;
  out.over_sensor = std::numeric_limits<double>::quiet_NaN();
  out.problem = std::move(why);
  return out;
}

}  // namespace

LinkDepth link_depth(const Scene& scene, const RobotHalf& robot, const LinkDepthOptions& options) {
  if (robot.view.truth.empty()) return not_measured("the robot's box has left no truth");
  const auto recording = read_recording(options.recording);
  if (!recording) return not_measured(recording.error());
  rt::Startup startup;
  auto& nrt = startup.token();
  const drivers::World world(nrt, scene.world, rt::Time{});
  TruthPose pose(robot.view.truth, scene.camera.true_X_BC());
  auto clean = scene.camera;
  clean.noise = {};
  const rt::Time t0 = rt::Time{} + rt::Nanos{robot.epoch_ns};
  drivers::SyntheticCamera sensor(nrt, scene.camera, world, pose, t0),
      truth(nrt, clean, world, pose, t0);
  const auto& capture = scene.graph.capture;
  drivers::FrameCodecScratch codec(nrt, capture.colour, capture.pictures, scene.camera.intrinsics(),
                                   drivers::CodecEnd::kDecodes);
  auto encoded = std::make_unique<drivers::EncodedFrame>();
  auto out = std::make_unique<RgbdFrame>(), in = std::make_unique<RgbdFrame>(),
       true_frame = std::make_unique<RgbdFrame>();
  std::ifstream file(options.recording, std::ios::binary);
  std::vector<std::uint8_t> bytes;
  LinkDepth result;
  Sums sums;
  std::int64_t first_ns = 0;
  for (const MessageAt& m : recording.value().messages) {
    bytes.resize(m.head.size);
    file.seekg(static_cast<std::streamoff>(m.offset));
    if (!file.read(reinterpret_cast<char*>(bytes.data()),
                   static_cast<std::streamsize>(bytes.size())))
      return not_measured("the recording is torn");
    drivers::Header header;
    if (drivers::read_header(bytes, header) != drivers::WireStatus::kOk ||
        header.id != drivers::MessageId::kFrame || m.head.taken == 0)
      continue;
    const auto body = std::span<const std::uint8_t>(bytes).subspan(drivers::kHeaderSize);
    if (drivers::read_wire(body, *encoded) != drivers::FrameStatus::kOk) continue;
    const rt::Time exposure = rt::Time{} + rt::Nanos{encoded->exposure.ns};
    if (drivers::decode(*encoded, exposure, codec, *out) != drivers::FrameStatus::kOk) continue;
    if (result.decoded++ == 0) first_ns = encoded->exposure.ns;
    if (1e-9 * static_cast<double>(encoded->exposure.ns - first_ns) < options.from_s ||
        result.decoded % options.each != 0)
      continue;
    if (sensor.mid_exposure(encoded->seq) != exposure)
      return not_measured("a picture's number and its exposure do not fit");
    sensor.expose(encoded->seq, *in);
    truth.expose(encoded->seq, *true_frame);
    sums.add(*out, *in, *true_frame);
    ++result.judged;
  }
  if (sums.pixels == 0 || sums.sensor <= 0) return not_measured("no picture could be judged");
  result.over_sensor = std::sqrt(sums.decoded / sums.sensor);
  return result;
}

}  // namespace teletact
