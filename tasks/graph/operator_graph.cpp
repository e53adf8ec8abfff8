#include "tasks/graph/operator_graph.hpp"

#include "drivers/link/encoded_frame.hpp"
#include "drivers/link/frame_codec.hpp"
#include "drivers/link/wire.hpp"
#include "rt/effect_count.hpp"
#include "tasks/graph/operator_nodes.hpp"

namespace tasks {

OperatorCells::OperatorCells(rt::NonRealtime& nrt, const GraphConfig& config)
    : frame(nrt, {1}),
      robot_state(nrt, {1, 1, 1, 1, 1}),
      hand(nrt, {1, 1}),
      patch(nrt, {2}),
      surface(config.haptic.asks_for_ray_cast()
                  ? std::make_unique<rt::Latest<SurfacePoints>>(nrt, std::vector<int>{1})
                  : nullptr),
      view(nrt, {1}),
      mesh(config.fusion.mesh_blocks > 0
               ? std::make_unique<rt::Latest<perception::MeshDelta>>(nrt, std::vector<int>{1})
               : nullptr),
      cost_map(nrt, {1, 1}),
      camera_pose(nrt, {1, 1, 1}),
      objects(nrt, {1, 1}),
      path(nrt, {1, 1}),
      task(nrt, {1}),
      goal(nrt, {1, 1}),
      odometry_frame(nrt, {1, 1}),
      mode(nrt, {1, 1, 1, 1}),
      logs(std::make_unique<TaskLogs>(nrt)) {
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
    : config_(config),
      cells_(std::make_unique<OperatorCells>(nrt, config_)),
      frame_gate_(setup.faults, "frame"),
      state_gate_(setup.faults, "robot_state"),
      edit_gate_(setup.faults, "edit") {
  nodes_.reset(new Nodes{HapticNode(nrt, config_, setup, *cells_, haptic_period_s),
                         FusionNode(nrt, config_, setup, *cells_, requests_),
                         PlanningNode(nrt, config_, setup, *cells_),
                         PredictionNode(nrt, config_, setup, *cells_, link_),
                         SupervisionNode(nrt, config_, *cells_, link_, requests_, setup)});
  if (cells_->surface != nullptr) rt::effect_built(rt::Effect::kForceShading);
  if (cells_->mesh != nullptr) rt::effect_built(rt::Effect::kMesh);
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
  }
  if (id == TaskId::kFusion) {
    s.mesh_taken = nodes_->fusion.in().mesh_taken;
    s.edit = nodes_->fusion.edit();
  }
  if (id == TaskId::kPlanning)
    s.events_full = nodes_->planning.in().event_count == PlanningTask::kMaxEvents;
  return s;
}

bool OperatorGraph::edit(const SceneEdit& edit) noexcept {
  return push(edit_gate_, cells_->edit, edit);
}

const FusionTask& OperatorGraph::fusion() const noexcept { return nodes_->fusion.task(); }
const HapticTask& OperatorGraph::haptic() const noexcept { return nodes_->haptic.task(); }

void OperatorGraph::bind_link(rt::NonRealtime& nrt, drivers::LinkEndpoint& endpoint) {
  struct Decoder {
    Decoder(rt::NonRealtime& n, const drivers::ColourCodecConfig& colour) : scratch(n, colour) {}
    drivers::EncodedFrame encoded;
    drivers::FrameCodecScratch scratch;
  };
  auto decoder = std::make_shared<Decoder>(nrt, config_.capture.colour);
  endpoint.add_incoming(
      drivers::MessageId::kFrame,
      [this, decoder, &endpoint](std::span<const std::uint8_t> body, rt::Time) {
        if (drivers::read_wire(body, decoder->encoded) != drivers::FrameStatus::kOk) return false;
        auto& slot = cells_->frame.begin_write();
        const rt::Time exposure = endpoint.to_local(decoder->encoded.exposure.ns);
        const auto status = drivers::decode(decoder->encoded, exposure, decoder->scratch, slot);
        if (status != drivers::FrameStatus::kOk && status != drivers::FrameStatus::kNoColour)
          return false;
        publish(frame_gate_, cells_->frame, slot, endpoint.arrived(), endpoint.unsure());
        return true;
      });
  endpoint.add_incoming(drivers::MessageId::kRobotState,
                        [this, &endpoint](std::span<const std::uint8_t> body, rt::Time) {
                          drivers::RobotState m;
                          if (!drivers::decode(body, m)) return false;
                          m.taken = endpoint.to_local(rt::ns_of(m.taken));
                          auto& slot = cells_->robot_state.begin_write();
                          slot = m;
                          publish(state_gate_, cells_->robot_state, slot, endpoint.arrived(),
                                  endpoint.unsure());
                          return true;
                        });
  endpoint.add_outgoing(drivers::MessageId::kRobotGoal, std::chrono::milliseconds{50}, false,
                        [this](std::span<std::uint8_t> out) -> std::size_t {
                          const auto goal = cells_->goal.acquire_if_new(OperatorCells::kGoalLink);
                          return goal ? drivers::encode(*goal, out) : 0;
                        });
}

}  // namespace tasks
