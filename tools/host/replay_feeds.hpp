// What comes into the tasks of a box from beside its own tasks, as the latch that comes next in a
// replay is to find it.
#pragma once

#include "rt/hash.hpp"
#include "tasks/graph/operator_graph.hpp"
#include "tasks/graph/robot_graph.hpp"
#include "tools/record/input_record.hpp"

namespace teletact {

// The shared words.
void set_words(tasks::LinkStatus& link, tasks::OperatorRequests& requests, const StatusInput& s);
// What the console asked of the scene, for fusion.
void set_scene(tasks::OperatorGraph& graph, const SceneInput& s, rt::Hash64& inputs);
// What the operator asked of planning; the velocity by hand, for prediction, under its number.
void set_act(tasks::OperatorGraph& graph, const TouchInput& in, rt::Hash64& inputs);
void set_drive(tasks::OperatorGraph& graph, const DriveInput& in, rt::Hash64& inputs);
// The link's demand for a frame, for capture, under the number that it had.
void set_demand(tasks::RobotGraph& graph, const CameraInput& in, rt::Hash64& inputs);

}  // namespace teletact
