// What others read of the fusion task: patch, ray cast, cost map, view, mesh.
#include <algorithm>

#include "perception/tsdf/patch/patch_copy.hpp"
#include "tasks/fusion/fusion_parts.hpp"
#include "tasks/fusion/fusion_task.hpp"

namespace tasks {

namespace {

using perception::PixelOf;
using perception::SurfacePatch;

constexpr int kMeshPatience = 10;  // messages' time that an answer may take

}  // namespace

void FusionTask::write_patch(const rt::Tick& tick, const HapticState& hand, Out& out) noexcept {
  if (out.patch == nullptr) return;
  Stage stage(profiling_, *crew_, profile_.patch);
  const Vec3 centre =
      hand.p_WH + config_.window_lead_periods * rt::seconds(setup_.period) * hand.v_WH;
  // Before the haptic task ran, and for a hand that is not finite, the window stays where it was.
  if (hand.seq > 0 && centre.allFinite()) {
    window_centre_W_ = centre;
    hand_known_ = true;
  }
  SurfacePatch& p = *out.patch;
  const std::span<const std::uint8_t> slots =
      objects_ == nullptr ? std::span<const std::uint8_t>{} : slot_of_label_;
  if (!perception::copy_patch(map_, window_centre_W_, config_.patch_nodes, p, slots)) return;
  if (smoother_ != nullptr && hand_known_)
    out.work += static_cast<std::uint64_t>(smoother_->smooth(window_centre_W_, p).nodes);
  p.touched_moves = touched_moves(hand);
  p.seq = ++patch_seq_;
  p.fused = tick.start;
  p.exposure = fused_exposure_;
  p.palette = setup_.palette;
  p.checksum = config_.patch_checksums ? perception::patch_checksum(p) : 0;
  out.work += p.cells();
  out.patch_written = true;
}

// Does what the hand touches move, by the newest image? What moves is masked: it carves and is not fused, so the field
// alone would say so late or never. Half of the readings about the proxy; one far in front of it hides the place and says
// nothing of it.
bool FusionTask::touched_moves(const HapticState& hand) const noexcept {
  constexpr double kAbout_vox = 2, kHides_m = 0.25;
  if (!masked_ || hand.contacts == 0 || !hand.p_WP.allFinite()) return false;
  const Vec3 p_C = X_WC_.inverse() * hand.p_WP;
  if (p_C.z() < config_.tracker.preprocess.depth_min_m) return false;
  const auto& k = setup_.camera;
  const double reach = kAbout_vox * config_.tsdf.voxel_size_m / p_C.z();
  const double u = k.fx * p_C.x() / p_C.z() + k.cx, v = k.fy * p_C.y() / p_C.z() + k.cy;
  const int u0 = std::max(0, static_cast<int>(std::floor(std::max(u - k.fx * reach, 0.0)))),
            v0 = std::max(0, static_cast<int>(std::floor(std::max(v - k.fy * reach, 0.0)))),
            u1 = static_cast<int>(std::min(u + k.fx * reach, k.width - 1.0)),
            v1 = static_cast<int>(std::min(v + k.fy * reach, k.height - 1.0));
  const auto depth_m = tracker_.pyramid().full_depth();
  const auto mask = pixel_mask();
  const double nearest_m = std::max(p_C.z() - kHides_m, 1e-3);
  int readings = 0, moving = 0;
  for (int y = v0; y <= v1; ++y) {
    for (int x = u0; x <= u1; ++x) {
      const auto of = static_cast<PixelOf>(mask.at(x, y));
      if (of == PixelOf::kBody || !(static_cast<double>(depth_m.at(x, y)) > nearest_m)) continue;
      ++readings;
      moving += of == PixelOf::kMoving ? 1 : 0;
    }
  }
  return readings > 0 && 2 * moving >= readings;
}

// Some rows more every period, so that a job's cost has a bound; the slot is the same until it is whole. A camera that is lost
// casts from where it was claimed last.
void FusionTask::write_surface(const rt::Tick& tick, Out& out) noexcept {
  if (out.camera_written && out.camera.claimed) surface_->stand_at(out.camera.X_WC);
  if (out.surface == nullptr || !surface_->stands()) return;
  Stage stage(profiling_, *crew_, profile_.surface);
  const double reach_m = config_.tracker.preprocess.depth_max_m + config_.tsdf.truncation_m;
  if (surface_->begins()) out.surface->exposure = fused_exposure_;  // of the oldest rows
  const auto stats = surface_->cast(map_, reach_m, *crew_, *out.surface);
  out.work += static_cast<std::uint64_t>(stats.steps) + static_cast<std::uint64_t>(stats.rays);
  if (stats.rays == 0 || !surface_->begins()) return;
  out.surface->fused = tick.start;
  out.surface_written = true;
}

void FusionTask::write_cost_map(const rt::Tick& tick, Out& out) noexcept {
  if (out.cost_map == nullptr) return;
  ++periods_since_map_;
  // Something begins to move: planning is told at once.
  const bool appears = ground_.moving() > 0 && !map_moves_;
  const bool due =
      appears || periods_since_map_ >= static_cast<std::uint64_t>(config_.cost_map_period);
  if (!due && map_seq_ > 0) return;
  Stage stage(profiling_, *crew_, profile_.cost_map);
  ground_.write(*out.cost_map, tick.start);
  map_moves_ = out.cost_map->moving_count > 0;
  out.cost_map->seq = ++map_seq_;
  out.cost_map->fused = tick.start;
  out.cost_map->exposure = fused_exposure_;
  out.cost_map_written = true;
  periods_since_map_ = 0;
}

bool FusionTask::view_due(const Out& out) const noexcept {
  return out.view != nullptr && config_.view_period_frames > 0 && started_ &&
         (periods_ - 1) % static_cast<std::uint64_t>(config_.view_period_frames) == 0;
}

// The mask is of the camera's pixels: another eye has none.
void FusionTask::show_mask(bool own_eye, SceneView& v) const noexcept {
  v.masked = own_eye && (masked_ || body_ != nullptr);
  if (!v.masked) return;
  const auto mask = pixel_mask();
  for (int y = 0; y < v.intrinsics.height; ++y) {
    const std::uint8_t* row = mask.row(std::min(y * config_.view_step, mask.height - 1));
    std::uint8_t* to = v.what.data() + static_cast<std::ptrdiff_t>(y) * v.intrinsics.width;
    for (int x = 0; x < v.intrinsics.width; ++x)
      to[x] = row[std::min(x * config_.view_step, mask.width - 1)];
  }
}

void FusionTask::write_view(const rt::Tick& tick, const std::optional<Pose>& X_WV,
                            Out& out) noexcept {
  if (!view_due(out)) return;
  Stage stage(profiling_, *crew_, profile_.view);
  perception::RaycastOptions o;
  o.pixel_step = config_.view_step;
  o.min_weight = config_.view_min_weight;
  o.colour = true;
  o.crew = crew_;
  const Pose X = X_WV ? *X_WV : X_WC_;
  // The camera's own frame shows objects better than the map alone can.
  const bool own = objects_drawn_ && !X_WV;
  o.labels = !own && objects_ != nullptr && objects_->count() > 0;
  const auto stats = perception::raycast(map_, setup_.camera, X, o, view_maps_);
  if (stats.rays == 0) return;
  SceneView& v = *out.view;
  v.X_WV = X;
  v.intrinsics = view_maps_.intrinsics;
  const auto colour = view_maps_.colour();
  const perception::ImageView<const std::uint8_t> shown =
      own ? objects_shown_.view() : view_maps_.labels();
  for (int y = 0; y < view_maps_.height(); ++y) {
    for (int x = 0; x < view_maps_.width(); ++x) {
      const auto i = static_cast<std::size_t>(y) * static_cast<std::size_t>(v.intrinsics.width) +
                     static_cast<std::size_t>(x);
      const float* r = view_maps_.at(x, y);
      v.object[i] = own || o.labels ? shown.at(x, y) : std::uint8_t{0};
      if (!view_maps_.hit(x, y)) {
        v.colour[i] = {24, 26, 30};
        v.points[i] = {};
        continue;
      }
      // Headlight: brightness by the angle between ray and surface.
      const Eigen::Vector3f p = view_maps_.vertex_C(x, y), n = view_maps_.normal_C(x, y);
      const float shade = 0.35F + 0.65F * std::clamp(-n.dot(p) / p.norm(), 0.0F, 1.0F);
      const perception::Rgb c = colour.at(x, y);
      const auto lit = [shade](std::uint8_t channel) {
        return static_cast<std::uint8_t>(static_cast<float>(channel) * shade);
      };
      v.colour[i] = {lit(c.r), lit(c.g), lit(c.b)};
      const Eigen::Vector3f q = (X * p.cast<double>()).cast<float>();
      v.points[i] = {q.x(), q.y(), q.z(), r[3]};
    }
  }
  show_mask(!X_WV, v);
  v.seq = ++view_seq_;
  v.fused = tick.start;
  v.exposure = fused_exposure_;
  out.work_view = static_cast<std::uint64_t>(stats.steps) + static_cast<std::uint64_t>(stats.rays);
  out.work += out.work_view;
  out.view_written = true;
}

// The next deltas go when the last ones were taken, so none is lost; a receiver that says nothing for long, or
// has begun anew, gets all of the mesh again.
void FusionTask::write_mesh(const rt::Tick& tick, std::uint64_t taken, Out& out) noexcept {
  if (mesh_ == nullptr || out.mesh == nullptr || !started_) return;
  if ((periods_ - 1) % static_cast<std::uint64_t>(config_.mesh_period_frames) != 0) return;
  if (taken != mesh_seq_) {
    if (++mesh_waited_ < kMeshPatience) return;
    mesh_->restart();
  }
  mesh_waited_ = 0;
  Stage stage(profiling_, *crew_, profile_.mesh);
  const bool any = mesh_->next(config_.mesh_blocks, *out.mesh);
  out.work += kWorkOfBlock * static_cast<std::uint64_t>(mesh_->cut_last());
  if (!any) {
    mesh_seq_ = taken;
    return;
  }
  out.mesh->seq = ++mesh_seq_;
  out.mesh->fused = tick.start;
  out.mesh->exposure = fused_exposure_;
  out.mesh_written = true;
}

}  // namespace tasks
