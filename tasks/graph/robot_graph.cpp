#include "tasks/graph/robot_graph.hpp"

#include "tasks/edges/link_edges.hpp"
#include "tasks/graph/capture_node.hpp"
#include "tasks/graph/robot_io_node.hpp"
#include "tasks/graph/supervision_nodes.hpp"

namespace tasks {

RobotCells::RobotCells(rt::NonRealtime& nrt, const rt::FaultPlan& faults)
    : EdgeCells(nrt, faults, [](EdgeId) { return true; }), logs(std::make_unique<TaskLogs>(nrt)) {
  for (int i = 0; i < kTaskCount; ++i)
    health.push_back(std::make_unique<HealthCell>(nrt, std::vector<int>{1}));
}

struct RobotGraph::Nodes {
  RobotIoNode robot_io;
  CaptureNode capture;
  RobotSupervisionNode supervision;
};

RobotGraph::RobotGraph(rt::NonRealtime& nrt, const GraphConfig& config, const RobotSetup& setup)
    : config_(config), cells_(std::make_unique<RobotCells>(nrt, setup.faults)) {
  nodes_.reset(new Nodes{RobotIoNode(nrt, config_, setup, *cells_, link_),
                         CaptureNode(nrt, config_, setup, *cells_),
                         RobotSupervisionNode(nrt, config_, *cells_, link_, requests_, setup)});
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
  receive_edge<EdgeId::kGoal>(*cells_, endpoint);
  send_edge<EdgeId::kRobotState>(*cells_, endpoint);
  constexpr Wire wire = kEdge<EdgeId::kFrame>.row.wire;
  endpoint.add_outgoing(wire.code, std::chrono::milliseconds{wire.period_ms}, wire.bulk,
                        [this](std::span<std::uint8_t> out) -> std::size_t {
                          if (!cells_->fresh_for_link<EdgeId::kFrame>()) return 0;
                          const auto frame = cells_->read_by_link<EdgeId::kFrame>();
                          return frame ? drivers::write_wire(*frame, out) : 0;
                        });
}

}  // namespace tasks
