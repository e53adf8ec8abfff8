// The edge `goal` at the robot's end of the link: through the gate (drivers/link/command_gate.hpp),
// and what it refused back to the operator's box.
#pragma once

#include <functional>

#include "drivers/link/command_gate.hpp"
#include "drivers/link/endpoint.hpp"
#include "tasks/edges/edge_cells.hpp"

namespace tasks {

// How many goals were refused since the robot's box started, and the newest fault. By the link's
// thread, each time that it changes.
using TellRefused = std::function<void(std::uint64_t refused, drivers::CommandFault newest)>;

// Robot box. Everything given must outlive the endpoint's use.
void receive_commands(EdgeCells<rt::Box::kRobot>& cells, drivers::CommandGate& gate,
                      drivers::LinkEndpoint& endpoint, TellRefused tell);
// Operator box. While `stopped` says so, whatever goes out lets the base stand and takes the
// engagement back; the first such message goes out at once, before the tasks have answered: the
// newest goal again, changed so.
void send_commands(EdgeCells<rt::Box::kOperator>& cells, drivers::LinkEndpoint& endpoint,
                   const std::function<bool()>& stopped);
// Operator box: what the robot's box says of them.
void receive_command_reports(drivers::LinkEndpoint& endpoint, TellRefused tell);

}  // namespace tasks
