#include "tasks/fusion/fusion_outputs.hpp"

#include <algorithm>

#include "perception/tsdf/patch/patch_copy.hpp"

namespace tasks {

namespace {

constexpr int kMeshPatience = 10;  // messages' time that an answer may take

// Rows of each of `parts`: a multiple of 4, the height of a tile of the ray cast, so that the parts
// cast the same rays as one cast of the whole view.
int view_rows(int height, int parts) noexcept {
  const int n = std::max(1, parts);
  return ((height + n - 1) / n + 3) / 4 * 4;
}

}  // namespace

// ---------------------------------------------------------------- patch

PatchWriter::PatchWriter(rt::NonRealtime& nrt, const FusionConfig& config, const FusionSetup& setup)
    : config_(config), setup_(setup), centre_W_(setup.X_WC0 * Vec3(0, 0, 1)) {
  if (!(config.patch_smooth > 0)) return;
  perception::SmoothOptions smooth;
  smooth.radius = config.patch_smooth;
  smoother_.emplace(nrt, smooth);
}

void PatchWriter::write(const FusionScene& scene, const HapticState& hand,
                        FusionOut& out) noexcept {
  if (out.patch == nullptr) return;
  Stage stage(scene.stages, &FusionProfile::patch);
  const Vec3 centre =
      hand.p_WH + config_.window_lead_periods * rt::seconds(setup_.period) * hand.v_WH;
  // Before the haptic task ran, and for a hand that is not finite, the patch stays where it was.
  if (hand.seq > 0 && centre.allFinite()) {
    centre_W_ = centre;
    hand_known_ = true;
  }
  perception::SurfacePatch& p = *out.patch;
  const auto slots =
      scene.objects == nullptr ? std::span<const std::uint8_t>{} : scene.objects->slots();
  if (!perception::copy_patch(scene.map, centre_W_, config_.patch_nodes, p, slots)) return;
  if (smoother_ && hand_known_)
    out.work += static_cast<std::uint64_t>(smoother_->smooth(centre_W_, p).nodes);
  p.touched_moves = scene.tracking.touched_moves(hand, scene.camera.X_WC);
  p.seq = ++seq_;
  p.fused = scene.tick.start;
  p.exposure = scene.camera.fused;
  p.palette = setup_.palette;
  p.checksum = config_.patch_checksums ? perception::patch_checksum(p) : 0;
  out.work += p.cells();
  out.patch_written = true;
}

// ---------------------------------------------------------------- view

ViewWriter::ViewWriter(rt::NonRealtime& nrt, const FusionConfig& config,
                       const perception::Intrinsics& camera)
    : config_(config),
      camera_(camera),
      maps_(nrt, camera.width / std::max(1, config.view_step) + 1,
            camera.height / std::max(1, config.view_step) + 1),
      rows_(view_rows(camera.subsampled(std::max(1, config.view_step)).height,
                      config.view_period_frames / 2)) {}

bool ViewWriter::due(bool started, std::uint64_t period, const FusionOut& out) const noexcept {
  return out.view != nullptr && config_.view_period_frames > 0 && started &&
         (period - 1) % static_cast<std::uint64_t>(config_.view_period_frames) == 0;
}

void ViewWriter::show_mask(const CameraTracking& tracking, SceneView& v) const noexcept {
  const auto mask = tracking.mask();
  for (int y = 0; y < v.intrinsics.height; ++y) {
    const std::uint8_t* row = mask.row(std::min(y * config_.view_step, mask.height - 1));
    std::uint8_t* to = v.what.data() + static_cast<std::ptrdiff_t>(y) * v.intrinsics.width;
    for (int x = 0; x < v.intrinsics.width; ++x)
      to[x] = row[std::min(x * config_.view_step, mask.width - 1)];
  }
}

// Rows of the maps as pixels of the view, from `first_row` on.
void ViewWriter::shade(int first_row, SceneView& v) const noexcept {
  const auto colour = maps_.colour();
  const auto ids = maps_.labels();
  for (int y = 0; y < maps_.height(); ++y) {
    for (int x = 0; x < maps_.width(); ++x) {
      const auto i =
          static_cast<std::size_t>(first_row + y) * static_cast<std::size_t>(v.intrinsics.width) +
          static_cast<std::size_t>(x);
      const float* r = maps_.at(x, y);
      if (labels_) v.object[i] = ids.at(x, y);
      if (!maps_.hit(x, y)) {
        v.colour[i] = {24, 26, 30};
        v.points[i] = {};
        continue;
      }
      // Headlight: brightness by the angle between ray and surface.
      const Eigen::Vector3f p = maps_.vertex_C(x, y), n = maps_.normal_C(x, y);
      const float shade = 0.35F + 0.65F * std::clamp(-n.dot(p) / p.norm(), 0.0F, 1.0F);
      const perception::Rgb c = colour.at(x, y);
      const auto lit = [shade](std::uint8_t channel) {
        return static_cast<std::uint8_t>(static_cast<float>(channel) * shade);
      };
      v.colour[i] = {lit(c.r), lit(c.g), lit(c.b)};
      const Eigen::Vector3f q = (v.X_WV * p.cast<double>()).cast<float>();
      v.points[i] = {q.x(), q.y(), q.z(), r[3]};
    }
  }
}

// The eye, and what the camera's newest image says: later ones are of another pose.
void ViewWriter::begin(const FusionScene& scene, const std::optional<Pose>& X_WV, bool has_body,
                       SceneView& v) noexcept {
  v.X_WV = X_WV ? *X_WV : scene.camera.X_WC;
  v.intrinsics = camera_.subsampled(config_.view_step);
  v.exposure = scene.camera.fused;
  // The camera's own frame shows objects better than the map alone can.
  const FusionObjects* objects = scene.objects;
  const bool own = objects != nullptr && objects->drawn() && !X_WV;
  labels_ = !own && objects != nullptr && objects->count() > 0;
  const int width = v.intrinsics.width;
  std::uint8_t* to = v.object.data();
  for (int y = 0; y < v.intrinsics.height; ++y, to += width) {
    if (own)
      std::copy_n(objects->shown().row(y), width, to);
    else
      std::fill_n(to, width, std::uint8_t{0});
  }
  // The mask is of the camera's pixels: another eye has none.
  v.masked = !X_WV && (scene.tracking.masked() || has_body);
  if (v.masked) show_mask(scene.tracking, v);
}

// The next rows of the view.
perception::RaycastStats ViewWriter::cast(const FusionScene& scene, SceneView& v) noexcept {
  perception::RaycastOptions o;
  o.pixel_step = config_.view_step;
  o.min_weight = config_.view_min_weight;
  o.colour = true;
  o.crew = scene.stages.crew;
  o.labels = labels_;
  perception::Intrinsics part = camera_;
  const int done = row_ * config_.view_step;
  part.height = camera_.height - done;
  part.cy -= done;
  if (!labels_) part.height = std::min(part.height, rows_ * config_.view_step);
  const auto stats = perception::raycast(scene.map, part, v.X_WV, o, maps_);
  if (stats.rays == 0) return stats;
  shade(row_, v);
  row_ += maps_.height();
  return stats;
}

void ViewWriter::write(const FusionScene& scene, const std::optional<Pose>& X_WV, bool has_body,
                       FusionOut& out) noexcept {
  const bool begins = row_ == 0;
  if (out.view == nullptr || (begins && !due(scene.camera.started, scene.period, out))) return;
  Stage stage(scene.stages, &FusionProfile::view);
  SceneView& v = *out.view;
  if (begins) begin(scene, X_WV, has_body, v);
  const auto stats = cast(scene, v);
  out.work_view = static_cast<std::uint64_t>(stats.steps) + static_cast<std::uint64_t>(stats.rays);
  out.work += out.work_view;
  if (stats.rays > 0 && row_ < v.intrinsics.height) return;
  row_ = 0;
  if (stats.rays == 0) return;
  v.seq = ++seq_;
  v.fused = scene.tick.start;
  out.view_written = true;
}

// ---------------------------------------------------------------- cost map

void CostMapWriter::write(const FusionScene& scene, perception::GroundMap& ground,
                          FusionOut& out) noexcept {
  if (out.cost_map == nullptr) return;
  ++since_last_;
  // Something begins to move: planning is told at once.
  const bool appears = ground.moving() > 0 && !moves_;
  if (!appears && since_last_ < period_ && seq_ > 0) return;
  Stage stage(scene.stages, &FusionProfile::cost_map);
  ground.write(*out.cost_map, scene.tick.start);
  moves_ = out.cost_map->moving_count > 0;
  out.cost_map->seq = ++seq_;
  out.cost_map->fused = scene.tick.start;
  out.cost_map->exposure = scene.camera.fused;
  out.cost_map_written = true;
  since_last_ = 0;
}

// ---------------------------------------------------------------- mesh

MeshWriter::MeshWriter(rt::NonRealtime& nrt, const FusionConfig& config, perception::TsdfMap& map)
    : config_(config), sender_(nrt, map) {}

void MeshWriter::write(const FusionScene& scene, std::uint64_t taken, FusionOut& out) noexcept {
  if (out.mesh == nullptr || taken == kMeshUnwanted || !scene.camera.started) return;
  if ((scene.period - 1) % static_cast<std::uint64_t>(config_.mesh_period_frames) != 0) return;
  if (taken != seq_) {
    if (++waited_ < kMeshPatience) return;
    sender_.restart();
  }
  waited_ = 0;
  Stage stage(scene.stages, &FusionProfile::mesh);
  const bool any = sender_.next(config_.mesh_blocks, *out.mesh);
  out.work += kWorkOfBlock * static_cast<std::uint64_t>(sender_.cut_last());
  if (!any) {
    seq_ = taken;
    return;
  }
  out.mesh->seq = ++seq_;
  out.mesh->fused = scene.tick.start;
  out.mesh->exposure = scene.camera.fused;
  out.mesh_written = true;
}

}  // namespace tasks
