// RGB-D sequences held in memory, for benches of fusion: a recording, or a synthetic room with its truth.
#pragma once

#include <string>
#include <vector>

#include "drivers/camera/depth_noise.hpp"
#include "drivers/world/world.hpp"
#include "perception/geometry/rgbd_frame.hpp"
#include "rt/memory/non_realtime.hpp"

namespace teletact {

class FusionSequence {
 public:
  std::string name;
  perception::Intrinsics intrinsics{};
  bool has_colour = false;
  std::vector<perception::Pose> truth_WC;  // empty: none

  [[nodiscard]] int size() const { return static_cast<int>(exposure_.size()); }
  void append(const perception::RgbdFrame& frame);
  void frame(int i, perception::RgbdFrame& out) const;

 private:
  std::vector<rt::Time> exposure_;
  std::vector<std::uint16_t> depth_mm_;
  std::vector<perception::Rgb> colour_;
};

// The first `frames` frames of a TUM folder, 640 x 480 brought to 512 x 424. Poses of its groundtruth.txt,
// if it has one, are the truth. Throws std::runtime_error.
[[nodiscard]] FusionSequence recorded_sequence(const std::string& folder, int frames);

// A furnished room of 5 x 4 m as a Kinect v2 sees it, carried by hand: 0.25 m/s and 15 deg/s at most.
struct SyntheticRoom {
  drivers::WorldConfig world;
  drivers::DepthNoiseConfig noise;
  double range_min_m = 0.4, range_max_m = 5.0;
};
[[nodiscard]] SyntheticRoom furnished_room();
[[nodiscard]] perception::Pose carried_pose(double t_s);
[[nodiscard]] FusionSequence synthetic_sequence(rt::NonRealtime& nrt, const SyntheticRoom& room,
                                                int frames);

}  // namespace teletact
