// Before a demo on a recording: where the device's workspace lies in it, and what the hand does there, as far as the scene
// does not say (haptic.workspace_W_m; hand.segment).
//
//   look    its first images go through fusion as they will in the run; every picture of the map is searched for places
//           (view_places.hpp) until the workspace can hold enough of them, for 150 images at most
//   place   haptic.workspace_W_m: the origin with the most places in reach, of all kinds before many of one, the nearest
//           first; in the free, as the picture shows it
//   script  visits of 2.3 s from then to the end of the run, each at a place that is chosen when it begins
//           (touch_script.hpp)
// Set-up: allocates, reads files. Same recording and scene, same result.
#pragma once

#include <array>
#include <string>

#include "rt/memory/non_realtime.hpp"
#include "tools/scene/scene.hpp"
#include "tools/touch/view_places.hpp"

namespace teletact {

struct RecordingSetup {
  int images = 0, claimed = 0;                  // looked at; of them placed by tracking
  double readings = 0;                          // share of their pixels with a reading
  std::array<int, TouchPlace::kKinds> kinds{};  // places in reach
  bool placed = false, scripted = false;        // by this, not by the scene
  double start_s = 0;                           // of the script
  [[nodiscard]] std::string text() const;       // one line
};

// Changes the scene. Throws std::runtime_error with one line: the recording can not be touched, and why.
[[nodiscard]] RecordingSetup set_up_recording(rt::NonRealtime& nrt, Scene& scene, double run_s);

// What the script's hand asks of the workspace that the scene states.
[[nodiscard]] struct Reach reach_of(const Scene& scene);

}  // namespace teletact
