// A place in which one thing moves, drawn from a seed (teletact accuracy moving).
//
//   place     one of three rooms, furnished differently, with drawn furniture; what stands in the
//             way of the mover or of the camera is left out. The static rest of the image
//             constrains every direction in every frame: the point-to-plane information of its
//             pixels with their true normals (perception/icp/degeneracy.hpp) passes at three times
//             the tracker's limit, or all is drawn anew
//   mover     a box, a ball, a person (cylinder with a head), a door on a post, a drawer of a
//             cabinet, an arm of two or three links; 0.5 to 3 m from the camera to its face
//   share     valid pixels of the mover / valid pixels, the largest of the run; half of the samples
//             .02 to .30, half .30 to .60. The mover's size is found by bisection on the rendered
//             truth; at most 2 m
//   motion    2 to 100 mm or 0.5 to 5 degrees a frame, from frame 60 on or from the first; then it
//             goes out of view, comes to rest for 45 frames and more, or goes back and forth to the
//             end
//   camera    at rest, carried by hand (at most 0.25 m/s and 15 deg/s), or driving slowly
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "drivers/camera/depth_noise.hpp"
#include "drivers/world/world.hpp"
#include "perception/geometry/camera_model.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/random.hpp"

namespace teletact {

enum class MoverKind : std::uint8_t { kBox, kBall, kPerson, kDoor, kDrawer, kArm };
enum class Carry : std::uint8_t { kAtRest, kByHand, kDriving };
enum class MoverEnd : std::uint8_t { kGoesOut, kComesToRest, kBackAndForth };
inline constexpr int kMoverKinds = 6;
[[nodiscard]] const char* name_of(MoverKind kind);
[[nodiscard]] const char* name_of(Carry carry);
[[nodiscard]] const char* name_of(MoverEnd end);

// How the camera goes: sines about a pose, and a slow drive.
struct CameraWay {
  perception::Vec3 eye_W = perception::Vec3::Zero();
  double yaw_rad = 0, pitch_rad = 0;
  std::array<double, 6> amplitude{}, period_s{1, 1, 1, 1, 1, 1},
      phase_rad{};           // x y z yaw pitch roll
  double speed_m_per_s = 0;  // along the heading; the yaw's sine steers
  [[nodiscard]] perception::Pose X_WC(double t_s) const;
};

struct MovingSample {
  static constexpr double kFrame_s = 0.033333333;
  // Of the world's motions; frame i is exposed at kBegin + i kFrame_s.
  static constexpr rt::Time kBegin = rt::Time{} + rt::Nanos{1'000'000'000};
  [[nodiscard]] static rt::Time time_of(int frame) {
    return kBegin + rt::Nanos{static_cast<std::int64_t>(frame) * 33'333'333LL};
  }

  int index = 0;
  std::uint64_t seed = 1;
  std::string room;
  MoverKind kind = MoverKind::kBox;
  Carry carry = Carry::kAtRest;
  MoverEnd end = MoverEnd::kBackAndForth;
  bool from_rest = true;
  double share = 0;       // of the undisturbed truth, largest of the run
  double distance_m = 0;  // camera to the mover's face, where it was placed
  double size_m = 0;
  double step = 0;  // mm or degrees a frame
  int frames = 0;
  int first_moving =
      0;  // frame that shows it displaced first; it rests before, if there is a before
  int last_moving = 0;                // last frame in which it is elsewhere than in the one before
  drivers::WorldConfig world, plain;  // plain: the same without the mover
  std::vector<std::string> movers;    // names of the shapes that move
  CameraWay way;
  bool half_images = false;  // 256 x 212: a quarter of the work
  [[nodiscard]] perception::Intrinsics camera() const;
  // Of a door: a point of its axis, and its width. Else the width is 0.
  perception::Vec3 hinge_W = perception::Vec3::Zero();
  double door_width_m = 0;

  [[nodiscard]] bool low() const { return share <= 0.30; }
  [[nodiscard]] std::string text() const;  // a line
};

// The depth image of these samples is a Kinect v2's, 512 x 424 with f 365 or half of it.
[[nodiscard]] drivers::DepthNoiseConfig moving_noise();
inline constexpr double kMovingNear_m = 0.4, kMovingFar_m = 5.0;

// Sample `index` of a seed: kinds and halves of the share take turns. Throws std::runtime_error if
// none could be drawn (that is a fault of the drawing).
[[nodiscard]] MovingSample draw_moving_sample(rt::NonRealtime& nrt, std::uint64_t seed, int index);

// One of the three rooms with drawn furniture.
[[nodiscard]] drivers::WorldConfig draw_room(rt::Random& rng, std::string& name);

// Share of the mover's pixels among those with a reading, without noise, every `pixel_step`-th
// pixel, in a frame.
[[nodiscard]] double mover_share(const drivers::World& world, const MovingSample& sample, int frame,
                                 int pixel_step);
// Does what stands still in this frame constrain all six directions, by three times the tracker's
// limit?
[[nodiscard]] bool rest_constrains(const drivers::World& world, const MovingSample& sample,
                                   int frame);

}  // namespace teletact
