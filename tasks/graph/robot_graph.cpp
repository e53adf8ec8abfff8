#include "tasks/graph/robot_graph.hpp"

#include "tasks/edges/command_edges.hpp"
#include "tasks/edges/link_edges.hpp"
#include "tasks/graph/capture_node.hpp"
#include "tasks/graph/picture_link.hpp"
#include "tasks/graph/robot_io_node.hpp"
#include "tasks/graph/supervision_nodes.hpp"

namespace tasks {

RobotCells::RobotCells(rt::NonRealtime& nrt, const rt::FaultPlan& faults, bool on_demand)
    : EdgeCells(nrt, faults, [=](EdgeId id) { return id != EdgeId::kDemand || on_demand; }),
      logs(std::make_unique<TaskLogs>(nrt)) {
  for (int i = 0; i < kTaskCount; ++i)
    health.push_back(std::make_unique<HealthCell>(nrt, std::vector<int>{1}));
}

struct RobotGraph::Nodes {
  RobotIoNode robot_io;
  CaptureNode capture;
  RobotSupervisionNode supervision;
};

RobotGraph::RobotGraph(rt::NonRealtime& nrt, const GraphConfig& config, const RobotSetup& setup)
    : BoxGraph(config) {
  cells_ = std::make_unique<RobotCells>(nrt, setup.faults, config_.capture.pictures.on_demand());
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

const LatchedDemand& RobotGraph::latched_demand() const noexcept {
  return nodes_->capture.latched();
}
const CaptureTask& RobotGraph::capture() const noexcept { return nodes_->capture.task(); }

void RobotGraph::bind_link(rt::NonRealtime&, drivers::LinkEndpoint& endpoint) {
  receive_commands(*cells_, gate_, endpoint, [this](std::uint64_t n, drivers::CommandFault newest) {
    link_.tell_refused(n, newest);
  });
  bind_edges(*cells_, endpoint);
  send_pictures(*cells_, asker_, config_.capture.pictures, endpoint,
                [this](drivers::Spared spared) { link_.tell_spared(spared); });
}

}  // namespace tasks
