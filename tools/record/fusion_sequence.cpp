#include "tools/record/fusion_sequence.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>
#include <stdexcept>

#include "drivers/camera/render.hpp"
#include "drivers/camera/tum_reader.hpp"
#include "tools/files/pose_file.hpp"

namespace teletact {

using perception::Pose;
using perception::RgbdFrame;
using perception::Vec3;

void FusionSequence::append(const RgbdFrame& f) {
  const auto pixels =
      static_cast<std::size_t>(f.intrinsics.width) * static_cast<std::size_t>(f.intrinsics.height);
  exposure_.push_back(f.exposure);
  depth_mm_.insert(depth_mm_.end(), f.depth_mm.begin(),
                   f.depth_mm.begin() + static_cast<std::ptrdiff_t>(pixels));
  intrinsics = f.intrinsics;
  has_colour = f.has_colour;
  if (has_colour) {
    colour_.insert(colour_.end(), f.colour.begin(),
                   f.colour.begin() + static_cast<std::ptrdiff_t>(pixels));
  }
}

std::size_t FusionSequence::bytes() const noexcept {
  return depth_mm_.capacity() * sizeof(std::uint16_t) +
         colour_.capacity() * sizeof(perception::Rgb);
}

void FusionSequence::frame(int i, RgbdFrame& out) const {
  const auto pixels =
      static_cast<std::size_t>(intrinsics.width) * static_cast<std::size_t>(intrinsics.height);
  const auto at = static_cast<std::size_t>(i);
  out.exposure = exposure_[at];
  out.seq = at;
  out.intrinsics = intrinsics;
  out.has_colour = has_colour;
  std::copy_n(depth_mm_.data() + at * pixels, pixels, out.depth_mm.data());
  if (has_colour) std::copy_n(colour_.data() + at * pixels, pixels, out.colour.data());
}

std::vector<Pose> FusionSequence::known_truth() const {
  std::vector<Pose> known;
  for (const auto& X_WC : truth_WC)
    if (X_WC) known.push_back(*X_WC);
  return known;
}

FusionSequence recorded_sequence(std::ostream& progress, const std::string& folder,
                                 const RecordingOptions& o) {
  drivers::TumOptions options;
  options.register_colour = true;
  options.pinhole = o.pinhole;
  auto opened = drivers::TumSequence::open(folder, options);
  if (!opened) throw std::runtime_error(opened.error());
  if (opened.value().intrinsics().width == 640 && opened.value().intrinsics().height == 480) {
    options.to_512x424 = true;
    opened = drivers::TumSequence::open(folder, options);
    if (!opened) throw std::runtime_error(opened.error());
  }
  const auto& sequence = opened.value();
  const auto truth = read_truth(folder);
  if (!truth) throw std::runtime_error(truth.error());
  if (sequence.size() < o.at_least) {
    throw std::runtime_error(folder + ": " + std::to_string(sequence.size()) +
                             " frames; at least " + std::to_string(o.at_least) + " are needed");
  }
  FusionSequence out;
  out.name = "recording";
  auto frame = std::make_unique<RgbdFrame>();
  const int frames = std::min(sequence.size(), o.frames);
  for (int i = 0; i < frames; ++i) {
    const auto read = sequence.read(i, *frame);
    if (!read) throw std::runtime_error(read.error());
    out.append(*frame);
    out.truth_WC.push_back(pose_at(truth.value(), sequence.stamp_s(i)));
  }
  for (const std::string& line : sequence.assumed()) progress << line << "\n";
  progress << folder << ": " << frames << " of " << sequence.size() << " frames, true poses of "
           << out.known_truth().size() << "\n";
  return out;
}

SyntheticRoom furnished_room() {
  SyntheticRoom room;
  auto& w = room.world;
  w.room.x_m = {-1.0, 4.0};
  w.room.y_m = {-2.0, 2.0};
  w.room.height_m = 2.5;
  const auto box = [&](const char* name, std::array<double, 3> size, std::array<double, 3> at,
                       double yaw_deg, std::array<double, 3> colour) {
    auto& b = w.boxes.emplace_back();
    b.name = name, b.size_m = size, b.position_m = at, b.yaw_deg = yaw_deg;
    b.paint.colour = colour;
  };
  box("table", {0.7, 1.3, 0.72}, {3.2, 0.95, 0.36}, 0, {140, 95, 60});
  box("cupboard", {0.45, 0.9, 1.8}, {3.7, -0.6, 0.9}, 0, {120, 120, 130});
  box("crate", {0.5, 0.4, 0.35}, {3.05, -1.25, 0.175}, 30, {90, 150, 80});
  box("crate_top", {0.3, 0.3, 0.25}, {3.05, -1.22, 0.475}, -20, {190, 170, 60});
  box("bench", {0.4, 1.2, 0.45}, {1.9, 1.6, 0.225}, 90, {150, 90, 70});
  box("book", {0.22, 0.16, 0.04}, {3.1, 0.7, 0.74}, 15, {60, 70, 150});
  box("monitor", {0.06, 0.5, 0.32}, {3.35, 1.05, 0.88}, 10, {40, 40, 45});
  auto& bin = w.cylinders.emplace_back();
  bin.name = "bin", bin.position_m = {2.65, -0.3, 0.0}, bin.radius_m = 0.17, bin.height_m = 0.4;
  auto& ball = w.spheres.emplace_back();
  ball.name = "ball", ball.position_m = {2.2, 0.3, 0.15}, ball.radius_m = 0.15;
  room.noise = {1.0, 0.3, 0.3, 0.1};
  return room;
}

Pose looking(const Vec3& eye_W, double yaw_rad, double pitch_rad, double roll_rad) {
  Pose X = Pose::Identity();
  Eigen::Matrix3d axes;  // camera x right, y down, z forward, in a body that looks along +x
  axes.col(0) = -Vec3::UnitY();
  axes.col(1) = -Vec3::UnitZ();
  axes.col(2) = Vec3::UnitX();
  X.linear() =
      (Eigen::AngleAxisd(yaw_rad, Vec3::UnitZ()) * Eigen::AngleAxisd(pitch_rad, Vec3::UnitY()) *
       Eigen::AngleAxisd(roll_rad, Vec3::UnitX()))
          .toRotationMatrix() *
      axes;
  X.translation() = eye_W;
  return X;
}

Pose carried_pose(double t) {
  constexpr double kTurn = 2 * std::numbers::pi;
  // Swings of unequal periods: no instant at rest, no pose twice.
  const Vec3 eye(0.15 + 0.20 * std::sin(kTurn * t / 7.0), 0.25 * std::sin(kTurn * t / 9.0),
                 1.25 + 0.08 * std::sin(kTurn * t / 4.0));
  const double yaw = 0.35 * std::sin(kTurn * t / 11.0);
  const double pitch = 0.35 + 0.08 * std::sin(kTurn * t / 6.0);  // down
  return looking(eye, yaw, pitch, 0.05 * std::sin(kTurn * t / 5.0));
}

void film(rt::NonRealtime& nrt, const SyntheticRoom& room, int first, int count,
          FusionSequence& out) {
  const drivers::World world(nrt, room.world);
  const drivers::DepthNoise noise(nrt, room.noise);
  drivers::RenderScratch scratch(nrt, world.shapes().size());
  out.name = room.name;
  auto frame = std::make_unique<RgbdFrame>();
  for (int i = first; i < first + count; ++i) {
    const int at = i * room.stride;
    const Pose X_WC = room.path(at / 30.0);
    drivers::render(world, room.camera, X_WC, {room.range_min_m, room.range_max_m}, noise, 1,
                    static_cast<std::uint64_t>(i), scratch, *frame);
    frame->exposure = rt::Time{} + rt::Nanos{1'000'000'000LL + at * 33'333'333LL};
    out.append(*frame);
    out.truth_WC.emplace_back(X_WC);
  }
}

FusionSequence synthetic_sequence(rt::NonRealtime& nrt, const SyntheticRoom& room, int frames) {
  FusionSequence out;
  film(nrt, room, 0, frames, out);
  return out;
}

}  // namespace teletact
