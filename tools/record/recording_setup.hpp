// Prepares a demo on a recording: where the device's workspace lies in it and what the hand does
// there, unless the scene says so (haptic.workspace_W_m; hand.segment).
//
//   look    its first images go through fusion as in the run. Each picture of the map is searched
//           for places (view_places.hpp) until the workspace can hold enough of them, for at most
//           150 images
//   place   haptic.workspace_W_m: the origin with the most places in reach. Places of all kinds
//           come before many of one kind, then the nearest. The origin must be in free space, as
//           the picture shows it
//   script  visits of 2.3 s from then to the end of the run, each at a place that is chosen when it
//           begins (touch_script.hpp)
//
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

// Changes the scene. Throws std::runtime_error with one line that says why the recording can not be
// touched.
[[nodiscard]] RecordingSetup set_up_recording(rt::NonRealtime& nrt, Scene& scene, double run_s);

// What the script's hand asks of the workspace that the scene states.
[[nodiscard]] struct Reach reach_of(const Scene& scene);

}  // namespace teletact
