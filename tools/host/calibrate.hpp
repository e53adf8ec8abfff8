// Measures what each variant of each task costs on this machine, on stored input: the scene runs once on the
// virtual clock, everything at its best level, and what comes into each box is recorded (input_record.hpp: link
// messages with the coded camera frames and robot states, hand, motor states, raw camera frames). Then each box
// runs again from its recording (run_trial), once with everything at level 0, once for each further level of one
// task and once for each level of each static choice that the scene allows; only that task is measured then.
//
// The last 40 % of the stored images have somebody in them who walks to and fro before the camera (passing_camera.hpp): what
// moves costs fusion more, and may carry the camera. Their cost is told beside that of the images before, the budget
// covers both, and how a variant tracks is judged on all of them. A recording's images get them as well.
//
// How fusion tracks is measured beside its cost: frames tracked and claimed, and how far a claimed pose is off where
// the truth is known (the twin of the base, a recording's own poses). Admission takes no variant that does not track
// (tasks/graph/calibration.hpp).
//
// So all variants see the same bytes from outside at the same instants. What tasks of a box hand to each other is made
// anew in each pass, by the same tasks at level 0, the measured one apart; only another voxel changes it for
// others, and those are not measured then.
//
// A task with policy abort runs to its end here. The recording, 33 MB a second at 512 x 424, lies in the folder for
// temporary files (TMPDIR) and is removed at the end.
#pragma once

#include <cstdint>
#include <string>

#include "rt/memory/non_realtime.hpp"
#include "tasks/graph/calibration.hpp"
#include "tools/host/run_demo.hpp"

namespace teletact {

// What the passes were fed.
struct CalibrationInput {
  std::uint64_t passes = 0;                         // of both boxes
  std::uint64_t operator_hash = 0, robot_hash = 0;  // of the bytes, the same in each pass
  // Images that fusion took from when somebody walks, and what it found to move in one of them, best level.
  std::size_t moving_images = 0;
  double moving_share = 0;
};

// `seconds` of simulated time. Throws std::runtime_error if a pass was not fed what the others were, Stopped when
// asked to end.
[[nodiscard]] tasks::Calibration calibrate(rt::NonRealtime&, Scene&, double seconds, bool quiet,
                                           CalibrationInput* input = nullptr);

// This host, this program (its bytes), the scene's values in effect and its recording.
[[nodiscard]] tasks::CalibrationOrigin calibration_origin(const Scene&);

// The calibration of this host: the file named, or ~/.cache/teletact/calibration-SCENE.toml if it was made here,
// by this program, for this configuration; else measured now and stored there, and one line says why.
// `text` says which it was.
[[nodiscard]] tasks::Calibration host_calibration(rt::NonRealtime&, Scene&, const DemoOptions&,
                                                  std::string& text);

// config/limits/reference_costs.toml: shipped, so that virtual runs are the same everywhere.
[[nodiscard]] tasks::Calibration reference_calibration();

}  // namespace teletact
