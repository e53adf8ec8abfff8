// Measures the cost of each variant of each task on this machine, on stored input.
//
// 1. The scene runs once on the virtual clock, everything at its best level. The inputs of each box
//    are recorded (input_record.hpp): link messages with the coded camera frames and robot states,
//    hand, motor states, raw frames.
// 2. Each box runs again from its recording (run_trial): once with everything at level 0, once for
//    each further level of one task, and once for each level of each static choice that the scene
//    allows. Only that task is measured then.
//
// In the last 40 % of the stored images a person walks before the camera (passing_camera.hpp),
// because moving things cost fusion more and may mislead tracking. The cost of these images is
// reported beside that of the earlier ones. The budget covers both, and the tracking of a variant
// is judged on all of them. A recording's images get the person too.
//
// Tracking is measured beside the cost: frames tracked and claimed, and the error of claimed poses
// where the truth is known (the twin of the base, a recording's own poses). Admission takes no
// variant that does not track
// (tasks/graph/calibration.hpp).
//
// So all variants get the same bytes from outside at the same instants. Messages between tasks of a
// box are computed again in each pass, by the same tasks at level 0 except the measured one. Only
// another voxel size changes them for other tasks, and those are not measured then.
//
// A task with policy abort runs to its end here. The recording, 33 MB a second at 512 x 424, lies
// in the folder for temporary files (TMPDIR) and is removed at the end.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "rt/memory/non_realtime.hpp"
#include "tasks/graph/calibration.hpp"
#include "tools/host/run_options.hpp"

namespace teletact {

// What the passes were fed.
struct CalibrationInput {
  std::uint64_t passes = 0;                         // of both boxes
  std::uint64_t operator_hash = 0, robot_hash = 0;  // of the bytes, the same in each pass
  // Images with the walking person that fusion took, and the largest moving share that it found in
  // one of them, best level.
  std::size_t moving_images = 0;
  double moving_share = 0;
};

// Runs `seconds` of simulated time. Throws std::runtime_error if a pass got other input than the
// first one, Stopped when
// asked to end.
// `only`: the rows of one box, whose other half runs elsewhere. A scene with nothing in [world] is
// measured in the shipped room.
[[nodiscard]] tasks::Calibration calibrate(rt::NonRealtime&, Scene&, double seconds, bool quiet,
                                           CalibrationInput* input = nullptr,
                                           std::optional<rt::Box> only = std::nullopt);

// `calibration` as the scene asks for it, of which only link_share is measured here, with the
// scene's own pictures and codecs.
[[nodiscard]] tasks::Calibration with_link(rt::NonRealtime&, Scene&, double seconds,
                                           const tasks::Calibration& calibration);

// This host, this program (its bytes), the scene's values in effect and its recording. Not where a
// device of the robot is: another interface, chain or current limit costs no task more.
[[nodiscard]] tasks::CalibrationOrigin calibration_origin(const Scene&);

// The calibration of this host: the named file, or ~/.cache/teletact/calibration-SCENE.toml if it
// was made on this host, by this program, for this configuration. Otherwise it is measured now and
// stored there, and one line says why. `text` says which it was. `only`: of this box alone, in
// calibration-SCENE-robot.toml or calibration-SCENE-operator.toml.
[[nodiscard]] tasks::Calibration host_calibration(rt::NonRealtime&, Scene&, const DemoOptions&,
                                                  std::string& text,
                                                  std::optional<rt::Box> only = std::nullopt);

// config/limits/reference_costs.toml: shipped, so that virtual runs are the same everywhere.
[[nodiscard]] tasks::Calibration reference_calibration();

}  // namespace teletact
