// The images of a moving sample with the truth of every pixel, and the same film without the mover.
//
//   moving   a pixel of the mover, a point of which was displaced by at least max(50 mm, 6 sigma of
//            a reading there) since it last rested (not moved for 20 frames), or since the first
//            frame
//   either   no reading; the mover before it is displaced so far; its lowest 30 mm; the third of a
//            door next to its hinge; the 20 frames after it has come to rest: neither counted for
//            nor against a mask
//   still    the place, and the mover at rest
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "tools/measure/accuracy/moving_sample.hpp"
#include "tools/record/fusion_sequence.hpp"

namespace teletact {

enum class PixelTruth : std::uint8_t { kStill = 0, kMoving = 1, kEither = 2 };
inline constexpr std::uint8_t kTruthMask = 3, kMoverBit = 4;  // of a byte of the truth

// What a point of the mover is to be called, whatever the image: the rules above.
class MoverTruth {
 public:
  MoverTruth(const drivers::World& world, const MovingSample& sample);
  [[nodiscard]] PixelTruth of(const perception::Vec3& p_W, double depth_m, int shape,
                              int frame) const;
  // Frames since it moved last, this one counted; 0: it moves. Before its motion: as after a long
  // rest.
  [[nodiscard]] int still_for(int frame) const;

 private:
  struct Posed {
    perception::Pose X_WS;
    int farthest;  // frame of the largest displacement up to this one
    double lowest_m;
  };
  [[nodiscard]] const Posed& at(int shape, int frame) const;
  const MovingSample& sample_;
  std::vector<int> slot_;     // of a shape, -1: does not move
  std::vector<Posed> posed_;  // frame by frame
  int movers_ = 0;
};

struct MovingFilm {
  FusionSequence with, plain;  // both with their true poses X_WC
  std::vector<std::vector<std::uint8_t>>
      truth;                  // of `with`: PixelTruth, and kMoverBit on the mover
  std::vector<double> share;  // of a frame
  double share_most = 0;
};

// `incidence`: camera.noise.incidence, beside moving_noise().
[[nodiscard]] MovingFilm film_moving(rt::NonRealtime& nrt, const MovingSample& sample, bool colour,
                                     double incidence = 0);

}  // namespace teletact
