// One run of the fusion task over a moving sample, and what it is judged by (docs/moving_judge.md).
#pragma once

#include <ostream>

#include "tools/measure/accuracy/moving_film.hpp"
#include "tools/measure/accuracy/moving_judge.hpp"

namespace teletact {

// plain: the same way without the mover. Odometry: none; the truth with an error inside the shares
// that [fusion] states; a lie (still while the camera moves, or the reverse of its motion).
enum class MovingVariant : std::uint8_t { kPlain, kAlone, kOdometry, kLying };
[[nodiscard]] const char* name_of(MovingVariant v);
// Is there such a run? A camera at rest can not be lied about in these ways.
[[nodiscard]] bool has_variant(const MovingSample& sample, MovingVariant v);

struct MovingSetting {
  double voxel_mm = 20;
  int level = 0;
  bool surfaces = true;  // judge the map too: ghosts, and what has come to rest
  bool watch = true;     // for what moves; without: what it saves
};

// `debug`: a line a frame, if there is a stream.
[[nodiscard]] MovingRun run_moving(rt::NonRealtime& nrt, const MovingSample& sample,
                                   const MovingFilm& film, MovingVariant variant,
                                   const MovingSetting& setting, std::ostream* debug = nullptr);

}  // namespace teletact
