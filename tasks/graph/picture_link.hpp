// The edge `frame` at both ends of the link, and where frames are coded on demand
// (drivers/link/frame_asker.hpp) the edge `demand` and the report of the other end.
#pragma once

#include "drivers/link/endpoint.hpp"
#include "drivers/link/frame_asker.hpp"
#include "tasks/capture/capture_task.hpp"
#include "tasks/edges/edge_cells.hpp"

namespace tasks {

// Of the robot box. Without a codec that needs its previous frame: whenever the line is free the
// newest frame goes out. With one: each demand is answered by one frame and each frame is sent, so
// no frame is overwritten before it was sent. Everything given must outlive the endpoint's use.
void send_pictures(EdgeCells<rt::Box::kRobot>& cells, drivers::FrameAsker& asker,
                   const drivers::PictureConfig& pictures, drivers::LinkEndpoint& endpoint);

// Of the operator box: every frame that arrives is decoded, in order, by the link's thread.
// camera: of the frames.
void receive_pictures(rt::NonRealtime&, EdgeCells<rt::Box::kOperator>& cells,
                      const CaptureConfig& config, const perception::Intrinsics& camera,
                      drivers::LinkEndpoint& endpoint);

}  // namespace tasks
