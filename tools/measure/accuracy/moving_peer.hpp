// Runs other projects' dense mappers on the frames of a moving sample, where they are installed
// (tools/measure/bench/peer/), to show what a moving thing does to them.
#pragma once

#include <string>
#include <vector>

#include "tools/measure/accuracy/moving_film.hpp"

namespace teletact {

struct MovingPeer {
  std::string name, absent;  // absent: why there are no figures
  int tracked = 0, frames = 0;
  double ate_mm = 0, worst_mm = 0;
  [[nodiscard]] std::string text() const;
};

// Open3D and OpenCV (tsdf) at 10 mm over a cube of 5.12 m, in turn. Throws std::runtime_error.
[[nodiscard]] std::vector<MovingPeer> run_moving_peers(const MovingFilm& film);

}  // namespace teletact
