// RGB-D sequences held in memory, for benches of fusion: a recording, or a synthetic room with its
// truth.
#pragma once

#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "drivers/camera/depth_noise.hpp"
#include "drivers/camera/tum_reader.hpp"
#include "drivers/world/world.hpp"
#include "perception/geometry/rgbd_frame.hpp"
#include "rt/memory/non_realtime.hpp"

namespace teletact {

class FusionSequence {
 public:
  std::string name;
  perception::Intrinsics intrinsics{};
  bool has_colour = false;
  // Of each frame; none where nothing tells. Empty: of no frame.
  std::vector<std::optional<perception::Pose>> truth_WC;

  [[nodiscard]] int size() const { return static_cast<int>(exposure_.size()); }
  [[nodiscard]] std::size_t bytes() const noexcept;  // of the images
  void append(const perception::RgbdFrame& frame);
  void frame(int i, perception::RgbdFrame& out) const;
  [[nodiscard]] std::uint16_t depth_mm(int i, int u, int v) const noexcept {
    return depth_mm_[static_cast<std::size_t>((i * intrinsics.height + v) * intrinsics.width + u)];
  }
  // Null: not known.
  [[nodiscard]] const perception::Pose* truth(int i) const noexcept {
    const auto at = static_cast<std::size_t>(i);
    return at < truth_WC.size() && truth_WC[at] ? &*truth_WC[at] : nullptr;
  }
  [[nodiscard]] rt::Time exposure(int i) const noexcept {
    return exposure_[static_cast<std::size_t>(i)];
  }
  [[nodiscard]] std::vector<perception::Pose> known_truth() const;

 private:
  std::vector<rt::Time> exposure_;
  std::vector<std::uint16_t> depth_mm_;
  std::vector<perception::Rgb> colour_;
};

struct RecordingOptions {
  int frames = 150;  // at most
  int at_least = 2;
  std::optional<drivers::TumOptions::Pinhole> pinhole = std::nullopt;
};
// The first frames of a recording (drivers/camera/tum_reader.hpp), 640 x 480 brought to 512 x 424.
// Its poses, if it has some, tell the truth at the stamps of the frames (pose_file.hpp). Says on
// `progress` how many frames there are and what was assumed. Throws std::runtime_error.
[[nodiscard]] FusionSequence recorded_sequence(std::ostream& progress, const std::string& folder,
                                               const RecordingOptions& options);

// A camera's pose X_WC in its usual axes, when its body (x forward, z up) is turned by yaw (to the
// left), pitch (down) and roll, in this order.
[[nodiscard]] perception::Pose looking(const perception::Vec3& eye_W, double yaw_rad,
                                       double pitch_rad, double roll_rad = 0);
[[nodiscard]] perception::Pose carried_pose(double t_s);

// A place, a camera in it and the way it is carried.
struct SyntheticRoom {
  std::string name = "synthetic";
  drivers::WorldConfig world;
  drivers::DepthNoiseConfig noise;
  double range_min_m = 0.4, range_max_m = 5.0;
  perception::Pose (*path)(double t_s) = carried_pose;
  int stride = 1;  // frames of 1/30 s from one image to the next
  perception::Intrinsics camera{365, 365, 255.5, 211.5, 512, 424};
};
// 5 x 4 m as a Kinect v2 sees it, carried by hand: 0.25 m/s and 15 deg/s at most.
[[nodiscard]] SyntheticRoom furnished_room();
// Appends frames first .. first + count - 1 of the room; a sequence may go on in a room that has
// changed.
void film(rt::NonRealtime& nrt, const SyntheticRoom& room, int first, int count,
          FusionSequence& out);
[[nodiscard]] FusionSequence synthetic_sequence(rt::NonRealtime& nrt, const SyntheticRoom& room,
                                                int frames);

}  // namespace teletact
