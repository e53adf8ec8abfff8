#include "tasks/graph/robot_graph.hpp"

#include "drivers/link/wire.hpp"
#include "tasks/graph/operator_nodes.hpp"
#include "tasks/graph/robot_nodes.hpp"

namespace tasks {

RobotCells::RobotCells(rt::NonRealtime& nrt)
    : goal(nrt, {1, 1}),
      encoded(nrt, {1}),
      state(nrt, {1, 1}),
      mode(nrt, {1, 1}),
      logs(std::make_unique<TaskLogs>(nrt)) {
  for (int i = 0; i < kTaskCount; ++i)
    health.push_back(std::make_unique<HealthCell>(nrt, std::vector<int>{1}));
}

struct RobotGraph::Nodes {
  RobotIoNode robot_io;
  CaptureNode capture;
  RobotSupervisionNode supervision;
  EdgeGate goal_gate;
};

RobotGraph::RobotGraph(rt::NonRealtime& nrt, const GraphConfig& config, const RobotSetup& setup)
    : config_(config), cells_(std::make_unique<RobotCells>(nrt)) {
  nodes_.reset(new Nodes{RobotIoNode(nrt, config_, setup, *cells_, link_),
                         CaptureNode(nrt, config_, setup, *cells_),
                         RobotSupervisionNode(nrt, config_, *cells_, link_, requests_, setup),
                         EdgeGate(setup.faults, "goal")});
}

RobotGraph::~RobotGraph() = default;

rt::TaskBody& RobotGraph::body(TaskId id) {
  switch (id) {
    case TaskId::kRobotIo:
      return nodes_->robot_io;
    case TaskId::kCapture:
      return nodes_->capture;
    default:
      return nodes_->supervision;
  }
}

LatchedStatus RobotGraph::latched(TaskId id) const noexcept {
  if (id == TaskId::kRobotSupervision) return latched_status(nodes_->supervision.in());
  LatchedStatus s;
  if (id == TaskId::kRobotIo) {
    s.last_heard_ns = rt::ns_of(nodes_->robot_io.in().link_heard_at);
    s.closed = nodes_->robot_io.in().link_closed;
  }
  return s;
}

void RobotGraph::bind_link(rt::NonRealtime&, drivers::LinkEndpoint& endpoint) {
  endpoint.add_incoming(drivers::MessageId::kRobotGoal,
                        [this, &endpoint](std::span<const std::uint8_t> body, rt::Time) {
                          drivers::RobotGoal m;
                          if (!drivers::decode(body, m)) return false;
                          m.made = endpoint.to_local(rt::ns_of(m.made));
                          m.valid_until = endpoint.to_local(rt::ns_of(m.valid_until));
                          auto& slot = cells_->goal.begin_write();
                          slot = m;
                          publish(nodes_->goal_gate, cells_->goal, slot, endpoint.arrived(),
                                  endpoint.unsure());
                          return true;
                        });
  endpoint.add_outgoing(drivers::MessageId::kRobotState, std::chrono::milliseconds{10}, false,
                        [this](std::span<std::uint8_t> out) -> std::size_t {
                          const auto state = cells_->state.acquire_if_new(RobotCells::kStateLink);
                          if (!state) return 0;
                          return drivers::encode(*state, out);
                        });
  endpoint.add_outgoing(drivers::MessageId::kFrame, std::chrono::milliseconds{30}, true,
                        [this](std::span<std::uint8_t> out) -> std::size_t {
                          if (!cells_->encoded.fresh(RobotCells::kEncodedLink)) return 0;
                          const auto frame =
                              cells_->encoded.acquire_if_new(RobotCells::kEncodedLink);
                          if (!frame) return 0;
                          return drivers::write_wire(*frame, out);
                        });
}

}  // namespace tasks
