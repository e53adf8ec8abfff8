#include "tasks/graph/operator_graph.hpp"

#include "rt/effect_count.hpp"
#include "tasks/edges/command_edges.hpp"
#include "tasks/edges/link_edges.hpp"
#include "tasks/graph/fusion_node.hpp"
#include "tasks/graph/haptic_node.hpp"
#include "tasks/graph/picture_link.hpp"
#include "tasks/graph/planning_node.hpp"
#include "tasks/graph/prediction_node.hpp"
#include "tasks/graph/supervision_nodes.hpp"

namespace tasks {

namespace {

// Optional edges: made where the scene asks for them.
auto asked_by(const GraphConfig& config) {
  return [&config](EdgeId id) {
    if (id == EdgeId::kSurface) return config.haptic.asks_for_ray_cast();
    if (id == EdgeId::kMesh) return config.fusion.mesh_blocks > 0;
    return true;
  };
}

}  // namespace

OperatorCells::OperatorCells(rt::NonRealtime& nrt, const GraphConfig& config,
                             const rt::FaultPlan& faults)
    : EdgeCells(nrt, faults, asked_by(config)), logs(std::make_unique<TaskLogs>(nrt)) {
  for (int i = 0; i < kTaskCount; ++i)
    health.push_back(std::make_unique<HealthCell>(nrt, std::vector<int>{1}));
}

struct OperatorGraph::Nodes {
  HapticNode haptic;
  FusionNode fusion;
  PlanningNode planning;
  PredictionNode prediction;
  SupervisionNode supervision;
};

OperatorGraph::OperatorGraph(rt::NonRealtime& nrt, const GraphConfig& config,
                             const OperatorSetup& setup, double haptic_period_s)
    : BoxGraph(config), camera_(setup.fusion.camera), decoded_(setup.decoded) {
  cells_ = std::make_unique<OperatorCells>(nrt, config_, setup.faults);
  nodes_.reset(new Nodes{HapticNode(nrt, config_, setup, *cells_, haptic_period_s),
                         FusionNode(nrt, config_, setup, *cells_, requests_),
                         PlanningNode(nrt, config_, setup, *cells_, requests_),
                         PredictionNode(nrt, config_, setup, *cells_, link_),
                         SupervisionNode(nrt, config_, *cells_, link_, requests_, setup)});
  if (cells_->has<EdgeId::kSurface>()) rt::effect_built(rt::Effect::kForceShading);
  if (cells_->has<EdgeId::kMesh>()) rt::effect_built(rt::Effect::kMesh);
  if (config_.fusion.objects.enabled) rt::effect_built(rt::Effect::kObjects);
}

OperatorGraph::~OperatorGraph() = default;

rt::TaskBody& OperatorGraph::body(TaskId id) {
  switch (id) {
    case TaskId::kHaptic:
      return nodes_->haptic;
    case TaskId::kFusion:
      return nodes_->fusion;
    case TaskId::kPlanning:
      return nodes_->planning;
    case TaskId::kPrediction:
      return nodes_->prediction;
    default:
      return nodes_->supervision;
  }
}

LatchedStatus OperatorGraph::latched(TaskId id) const noexcept {
  if (id == TaskId::kSupervision) return latched_status(nodes_->supervision.in());
  LatchedStatus s;
  if (id == TaskId::kPrediction) {
    s.round_trip_ns = nodes_->prediction.in().round_trip.count();
    s.uncertainty_ns = nodes_->prediction.in().round_trip_uncertainty.count();
    const auto& drive = nodes_->prediction.drive_latched();
    if (drive.any) s.drive = nodes_->prediction.drive(), s.drive_number = drive.number;
    s.drive_at = drive.at;
  }
  if (id == TaskId::kFusion) {
    s.mesh_taken = nodes_->fusion.in().mesh_taken;
    s.edit = nodes_->fusion.edit();
  }
  if (id == TaskId::kPlanning) s.act = nodes_->planning.act();
  if (id == TaskId::kPlanning)
    s.events_full = nodes_->planning.in().event_count == PlanningTask::kMaxEvents;
  return s;
}

bool OperatorGraph::edit(const SceneEdit& edit) noexcept {
  return cells_->push<EdgeId::kEdit>(edit);
}

bool OperatorGraph::act(const OperatorAct& act) noexcept { return cells_->push<EdgeId::kAct>(act); }

void OperatorGraph::drive(const DriveIntent& intent, rt::Time now) noexcept {
  cells_->begin_write<EdgeId::kDrive>() = intent;
  static_cast<void>(cells_->publish<EdgeId::kDrive>(now));
}

const FusionTask& OperatorGraph::fusion() const noexcept { return nodes_->fusion.task(); }
const HapticTask& OperatorGraph::haptic() const noexcept { return nodes_->haptic.task(); }

void OperatorGraph::bind_link(rt::NonRealtime& nrt, drivers::LinkEndpoint& endpoint) {
  const auto told = [this](const LinkSample& s) {
    cells_->link_samples.try_push(s);
    if (!s.picture) return;
    link_.picture_ns.store(rt::ns_of(s.made));
    link_.tell_spared(s.spared);
    if (decoded_) decoded_();
  };
  receive_pictures(nrt, *cells_, config_.capture, camera_, endpoint, told);
  bind_edges(*cells_, endpoint,
             [told, &endpoint]<class M>(const M& m, std::int64_t made_ns, std::size_t bytes) {
               if constexpr (std::same_as<M, drivers::RobotState>) {
                 told({endpoint.arrived(),
                       m.taken,
                       made_ns,
                       static_cast<std::uint32_t>(bytes + drivers::kHeaderSize),
                       false,
                       false,
                       {}});
               }
             });
  send_commands(*cells_, endpoint, [this] {
    return requests_.ramp_down.load(std::memory_order_relaxed) ||
           requests_.stop.load(std::memory_order_relaxed);
  });
  receive_command_reports(endpoint, [this](std::uint64_t n, drivers::CommandFault newest) {
    link_.tell_refused(n, newest);
  });
}

}  // namespace tasks
