#include "tools/offline/fuse.hpp"

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <stdexcept>

#include "drivers/camera/depth_bias.hpp"
#include "drivers/camera/tum_reader.hpp"
#include "perception/map_file/map_file.hpp"
#include "perception/simd/isa.hpp"
#include "rt/quantile.hpp"
#include "tasks/fusion/fusion_task.hpp"
#include "tools/cli/number_list.hpp"
#include "tools/cli/options.hpp"
#include "tools/files/mesh_file.hpp"
#include "tools/files/metrics_json.hpp"
#include "tools/files/pose_file.hpp"
#include "tools/files/take.hpp"
#include "tools/files/whole_file.hpp"
#include "tools/record/fusion_feed.hpp"

namespace teletact {
namespace {

// Odometry at t, between two lines at most 0.2 s apart, with the velocity there; empty where the
// file says nothing.
std::optional<tasks::OdometryPrior> odometry_at(const std::vector<StampedPose>& lines, double t_s,
                                                rt::Time taken) {
  auto after = std::lower_bound(lines.begin(), lines.end(), t_s,
                                [](const StampedPose& l, double t) { return l.t_s < t; });
  if (after == lines.end()) return std::nullopt;
  if (after == lines.begin()) {
    if (after->t_s != t_s || lines.size() < 2) return std::nullopt;
    ++after;
  }
  const auto before = after - 1;
  const double span = after->t_s - before->t_s, f = (t_s - before->t_s) / span;
  if (span > 0.2) return std::nullopt;
  const perception::Pose step = before->X.inverse() * after->X;
  const Eigen::AngleAxisd turn(step.linear());
  tasks::OdometryPrior prior;
  prior.taken = taken;
  prior.X_OB = before->X;
  prior.X_OB.translate(f * step.translation())
      .rotate(Eigen::AngleAxisd(f * turn.angle(), turn.axis()));
  prior.v_OB_B = step.translation() / span;
  prior.w_OB_B = turn.angle() / span * turn.axis();
  return prior;
}

std::string pose_line(const std::string& stamp, const tasks::CameraPose& camera) {
  const perception::Vec3 p = camera.X_WC.translation();
  const Eigen::Quaterniond q(camera.X_WC.linear());
  const double sign = q.w() < 0 ? -1 : 1;
  char numbers[256];
  std::snprintf(numbers, sizeof numbers, " %.6f %.6f %.6f %.9f %.9f %.9f %.9f\n", p.x(), p.y(),
                p.z(), sign * q.x(), sign * q.y(), sign * q.z(), sign * q.w());
  std::string line = stamp + numbers;
  if (camera.claimed) return line;
  const bool lost = camera.tracking == tasks::CameraPose::Tracking::kLost;
  return std::string(lost ? "# lost " : "# degenerate ") + line;
}

struct FuseTally {
  int frames = 0, tracked = 0, claimed = 0, empty = 0;
  int first_claim = -1;
  std::int64_t blocks_refused = 0;
  std::vector<double> cpu_ms;
};

void note_frame(const tasks::FusionTask& task, const tasks::FusionTask::Out& out,
                FuseTally& tally) {
  if (out.camera_written && out.camera.claimed && tally.first_claim < 0)
    tally.first_claim = tally.frames;
  ++tally.frames;
  tally.tracked +=
      out.camera_written && out.camera.tracking != tasks::CameraPose::Tracking::kLost ? 1 : 0;
  tally.claimed += out.camera_written && out.camera.claimed ? 1 : 0;
  tally.empty += out.camera_written ? 0 : 1;
  tally.blocks_refused += out.integration.blocks_refused;
  const auto& p = task.last_profile();
  tally.cpu_ms.push_back(1e-6 * static_cast<double>(p.prepare + p.track + p.integrate + p.raycast +
                                                    p.ground + p.cost_map + p.patch));
}

// Odometry of another day would be as good as none.
void check_meets(const std::vector<StampedPose>& odometry, const drivers::TumSequence& sequence,
                 const FuseOptions& o) {
  for (int i = 0; i < sequence.size(); ++i) {
    if (odometry_at(odometry, sequence.stamp_s(i), rt::Time{})) return;
  }
  throw std::runtime_error(o.odometry + ": its stamps, " + std::to_string(odometry.front().t_s) +
                           " to " + std::to_string(odometry.back().t_s) + " s, meet no frame of " +
                           o.rgbd + ": " + std::to_string(sequence.stamp_s(0)) + " to " +
                           std::to_string(sequence.stamp_s(sequence.size() - 1)) + " s");
}

// Runs the task over the sequence; returns the text of the pose file.
std::string fuse(const drivers::TumSequence& sequence, const std::vector<StampedPose>& odometry,
                 const drivers::DepthBias& bias, const char* world, tasks::FusionTask& task,
                 FuseTally& tally) {
  FusionFeed feed(task);
  std::string poses = "# camera to world; world = " + std::string(world) +
                      ". A data line is a claim.\n# timestamp tx ty tz qx qy qz qw\n";
  for (int i = 0; i < sequence.size(); ++i) {
    take(sequence.read(i, feed.frame()));
    bias.apply(feed.frame());
    if (!odometry.empty())
      feed.in.odometry = odometry_at(odometry, sequence.stamp_s(i), feed.frame().exposure);
    const auto& out = feed.step();
    note_frame(task, out, tally);
    poses += out.camera_written ? pose_line(sequence.stamp_text(i), out.camera)
                                : "# no image " + sequence.stamp_text(i) + "\n";
  }
  return poses;
}

drivers::TumSequence open_sequence(const FuseOptions& o) {
  drivers::TumOptions tum;
  tum.register_colour = true;
  if (!o.intrinsics.empty()) tum.pinhole = parse_pinhole(o.intrinsics);
  auto sequence = take(drivers::TumSequence::open(o.rgbd, tum));
  if (sequence.intrinsics().width == 640 && sequence.intrinsics().height == 480 && !o.full_size) {
    tum.to_512x424 = true;
    sequence = take(drivers::TumSequence::open(o.rgbd, tum));
  }
  for (const std::string& line : sequence.assumed())
    std::fprintf(stderr, "teletact fuse: %s\n", line.c_str());
  return sequence;
}

// Of the map with what it has put away: a mesh reads only what is in the pool.
perception::Mesh mesh_of(rt::NonRealtime& nrt, const perception::TsdfMap& map,
                         const std::string& bytes, const perception::MeshOptions& options) {
  if (map.far_chunk_count() == 0) return perception::extract_mesh(nrt, map, options);
  perception::TsdfConfig config = map.config();
  config.max_blocks = map.block_count() + map.far_block_count();
  config.max_chunks = map.chunk_count() + map.far_chunk_count();
  config.far_store_kib = 0;
  perception::TsdfMap whole(nrt, config);
  perception::Keyframes keyframes(nrt, {});
  take(perception::restore_map(nrt, take(perception::parse_map(nrt, bytes, "map")), whole,
                               keyframes));
  return perception::extract_mesh(nrt, whole, options);
}

// All of the outputs or none of them.
void write_fused(rt::NonRealtime& nrt, const FuseOptions& o, const tasks::FusionTask& task,
                 const std::string& poses, const FuseTally& tally, std::size_t& vertices) {
  const perception::TsdfMap& map = task.map();
  const bool encoded = !o.save_map.empty() || map.far_chunk_count() > 0;
  const std::string bytes =
      encoded ? perception::encode_map(nrt, map, task.keyframes()) : std::string();
  const perception::Mesh mesh = mesh_of(nrt, map, bytes, {.min_weight = o.mesh_weight});
  vertices = mesh.vertices_W.size();
  try {
    if (!o.ply.empty()) take(write_ply(nrt, o.ply, mesh));
    write_whole_file(o.poses, poses);
    if (!o.save_map.empty()) write_whole_file(o.save_map, bytes);
    Metrics metrics("fuse");
    metrics.add("fusion.frames", tally.frames, "1");
    metrics.add("fusion.frames_tracked", tally.tracked, "1");
    metrics.add("fusion.frames_claimed", tally.claimed, "1");
    metrics.add("fusion.first_claim", tally.first_claim, "1");
    metrics.add("fusion.cpu_p50_ms", rt::quantile_or_nan(tally.cpu_ms, 0.5), "ms");
    metrics.add("fusion.cpu_p95_ms", rt::quantile_or_nan(tally.cpu_ms, 0.95), "ms");
    metrics.add("fusion.blocks", map.block_count(), "1");
    metrics.add("fusion.blocks_far", map.far_block_count(), "1");
    metrics.add("fusion.blocks_refused", static_cast<double>(tally.blocks_refused), "1");
    metrics.add("fusion.vertices", static_cast<double>(vertices), "1");
    if (!o.json.empty()) metrics.write(o.json);
  } catch (...) {
    std::error_code ignored;
    for (const std::string& path : {o.ply, o.poses, o.save_map})
      if (!path.empty()) std::filesystem::remove(path, ignored);
    throw;
  }
}

void describe_bias(config::Section& root, drivers::DepthBiasTable& bias) {
  root.section("camera", "that took the images")
      .list(
          "bias", [&bias](config::Section& item) { bias.emplace_back().describe(item); },
          "a point of the depth bias table; readings rise");
}

// The file first, then --set, then the options. --bias goes before a table of the file.
tasks::FusionConfig config_of(const FuseOptions& o, drivers::DepthBiasTable& bias) {
  tasks::FusionConfig config;
  config::Section root;
  config.describe(root.section("fusion", "the fusion task"));
  describe_bias(root, bias);
  if (!o.config_file.empty()) take(config::load_file(o.config_file, root));
  if (!o.bias.empty()) {
    bias.clear();
    config::Section camera;
    describe_bias(camera, bias);
    take(config::load_file(o.bias, camera));
    if (bias.empty()) throw std::runtime_error(o.bias + ": has no [[camera.bias]]");
  }
  for (const std::string& assignment : o.overrides) take(config::load_override(assignment, root));
  for (std::size_t i = 0; i < kFuseKnobs.size(); ++i) {
    if (o.knobs[i].empty()) continue;
    const auto ok =
        config::load_override(std::string("fusion.") + kFuseKnobs[i].key + "=" + o.knobs[i], root);
    if (!ok) throw std::runtime_error(std::string(kFuseKnobs[i].option) + ": " + ok.error());
  }
  if (o.voxel_m) config.tsdf.voxel_size_m = *o.voxel_m;
  for (std::size_t i = 0; i < config.levels.size(); ++i) {
    const auto& n = config.levels[i].iterations;
    if (std::all_of(n.begin(), n.end(), [](int k) { return k == 0; })) {
      throw std::runtime_error("fusion.level_" + std::to_string(i) +
                               ".iterations_fine, _middle and _coarse are 0: at least one must be "
                               "1 or more");
    }
  }
  if (config.tsdf.max_blocks == perception::TsdfConfig{}.max_blocks) {
    // The surface of the same place takes more blocks as voxels get finer.
    const double finer = std::max(1.0, 0.01 / config.tsdf.voxel_size_m);
    config.tsdf.max_blocks = static_cast<int>(config.tsdf.max_blocks * finer * finer);
  }
  // The tracker's own counts bound what a level may ask for.
  for (std::size_t i = 0; i < config.tracker.iterations.size(); ++i) {
    config.tracker.iterations[i] =
        std::max(config.tracker.iterations[i], config.levels[0].iterations[i]);
  }
  return config;
}

}  // namespace

void list_fuse_knobs() {
  tasks::FusionConfig config;
  config::Section root;
  config.describe(root.section("fusion"));
  drivers::DepthBiasTable bias;
  describe_bias(root, bias);
  std::fputs(config::reference_table(root).c_str(), stdout);
}

int fuse_recording(const FuseOptions& o) {
  if (!perception::simd::choose(o.isa)) {
    throw std::runtime_error("--isa " + o.isa +
                             ": must be auto, scalar, sse4, avx2 or avx512, and this machine's");
  }
  rt::Startup startup;
  drivers::DepthBiasTable table;
  const tasks::FusionConfig config = config_of(o, table);
  const std::string stored = o.map.empty() ? config.map : o.map;
  const drivers::DepthBias bias(startup.token(), table);
  check_outputs(
      {{"--poses", o.poses}, {"--ply", o.ply}, {"--save-map", o.save_map}, {"--json", o.json}},
      {o.odometry, stored, o.config_file, o.bias});
  const drivers::TumSequence sequence = open_sequence(o);
  std::vector<StampedPose> odometry;
  if (!o.odometry.empty()) {
    odometry = take(read_poses(o.odometry));
    check_meets(odometry, sequence, o);
  }

  tasks::FusionSetup setup;
  setup.camera = sequence.intrinsics();
  tasks::FusionTask task(startup.token(), config, setup);
  if (!stored.empty())
    take(task.load_map(startup.token(), take(perception::read_map_file(startup.token(), stored))));
  task.profile(true);
  FuseTally tally;
  const std::string poses = fuse(sequence, odometry, bias,
                                 stored.empty() ? "first camera" : "that of the map", task, tally);
  if (tally.tracked == 0) {
    std::fprintf(stderr,
                 "teletact fuse: %s: none of its %d frames was tracked; nothing is written\n",
                 o.rgbd.c_str(), tally.frames);
    return 1;
  }
  std::size_t vertices = 0;
  write_fused(startup.token(), o, task, poses, tally, vertices);
  std::printf("%d frames, %d tracked, %d claimed; %.1f ms CPU a frame (p50); %zu vertices\n",
              tally.frames, tally.tracked, tally.claimed, rt::quantile_or_nan(tally.cpu_ms, 0.5),
              vertices);
  if (!stored.empty() && tally.first_claim >= 0)
    std::printf("found in the map at frame %d\n", tally.first_claim);
  if (tally.blocks_refused > 0) {
    std::fprintf(stderr,
                 "teletact fuse: the map is full, %lld blocks were refused: use larger voxels\n",
                 static_cast<long long>(tally.blocks_refused));
  }
  // The first frame of a new map is its origin, claimed whatever it shows.
  const int given = stored.empty() ? 1 : 0;
  if (tally.frames > given && tally.claimed <= given) {
    std::fprintf(stderr,
                 "teletact fuse: %s: of %d frames none%s was claimed; what is written is no map of "
                 "it. Other voxels or levels may track it: --voxel, --pixel-step\n",
                 o.rgbd.c_str(), tally.frames, given > 0 ? " after the first" : "");
    return 1;
  }
  return 0;
}

}  // namespace teletact
