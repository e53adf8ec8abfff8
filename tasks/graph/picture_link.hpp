// The edge `frame` at both ends of the link, and where frames are coded on demand
// (drivers/link/frame_asker.hpp) the edge `demand` and the report of the other end.
#pragma once

#include <functional>

#include "drivers/link/endpoint.hpp"
#include "drivers/link/frame_asker.hpp"
#include "tasks/capture/capture_task.hpp"
#include "tasks/edges/edge_cells.hpp"
#include "tasks/graph/samples.hpp"

namespace tasks {

// Of the robot box. Without a codec that needs its previous frame: whenever the line is free the
// newest frame goes out. With one: each demand is answered by one frame and each frame is sent, so
// no frame is overwritten before it was sent. Everything given must outlive the endpoint's use.
// `told`, by the link's thread: what is spared, whenever a frame is asked for.
void send_pictures(EdgeCells<rt::Box::kRobot>& cells, drivers::FrameAsker& asker,
                   const drivers::PictureConfig& pictures, drivers::LinkEndpoint& endpoint,
                   const std::function<void(drivers::Spared)>& told = {});

// Of the operator box: every frame that arrives is decoded, in order, by the link's thread.
// camera: of the frames. `told`, by the link's thread: of each one that was decoded.
void receive_pictures(rt::NonRealtime&, EdgeCells<rt::Box::kOperator>& cells,
                      const CaptureConfig& config, const perception::Intrinsics& camera,
                      drivers::LinkEndpoint& endpoint,
                      const std::function<void(const LinkSample&)>& told = {});

}  // namespace tasks
