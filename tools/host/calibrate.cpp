#include "tools/host/calibrate.hpp"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <optional>
#include <stdexcept>

#include "perception/geometry/pose.hpp"
#include "rt/quantile.hpp"
#include "tools/files/pose_file.hpp"
#include "tools/host/replay.hpp"
#include "tools/record/input_recorder.hpp"
#include "tools/record/recording_truth.hpp"

namespace teletact {

namespace {

void end_if_asked() {
  if (g_stop_requested.load())
    throw Stopped("stopped while the tasks were measured: no calibration was stored");
}

// By task; behind them the shares of fusion's workers.
using Jobs = std::array<std::vector<rt::JobRecord>, tasks::kTaskCount + 1>;
constexpr int kShares = tasks::kTaskCount;

// Of a job, by its place: did it take an image, and does somebody move in it?
enum class Image : std::uint8_t { kNone, kStill, kMoving };

void tell_stretches(const std::vector<rt::JobRecord>& jobs, const std::vector<Image>& images,
                    tasks::CalibrationRow& row) {
  if (images.size() != jobs.size()) return;  // another task's
  const auto of = [&](Image wanted, double& p50_us, double& p999_us) {
    std::vector<double> cpu_us;
    for (std::size_t i = jobs.size() / 10; i < jobs.size(); ++i) {
      if (images[i] == wanted) cpu_us.push_back(static_cast<double>(jobs[i].cpu_ns) * 1e-3);
    }
    if (cpu_us.empty()) return;
    std::sort(cpu_us.begin(), cpu_us.end());
    p50_us = rt::quantile_of_sorted(std::span(cpu_us), 0.5);
    p999_us = rt::quantile_of_sorted(std::span(cpu_us), 0.999);
  };
  of(Image::kStill, row.still_p50_us, row.still_p999_us);
  of(Image::kMoving, row.moving_p50_us, row.moving_p999_us);
}

tasks::CalibrationRow& add_row(tasks::Calibration& c, const std::vector<rt::JobRecord>& jobs,
                               int task, const std::string& choice, int level,
                               const std::vector<Image>& images = {}) {
  tasks::CalibrationRow row;
  row.name =
      task == kShares ? tasks::kWorkerRow : tasks::kTaskTable[static_cast<std::size_t>(task)].name;
  row.choice = choice;
  row.level = level;
  std::vector<double> cpu_us;
  std::uint64_t work_min = ~0ULL, work_max = 0;
  // The first jobs run on cold caches and before the first image: not what a budget is for.
  for (std::size_t i = jobs.size() / 10; i < jobs.size(); ++i) {
    cpu_us.push_back(static_cast<double>(jobs[i].cpu_ns) * 1e-3);
    work_min = std::min(work_min, jobs[i].work);
    work_max = std::max(work_max, jobs[i].work);
  }
  if (cpu_us.size() < 10)
    throw std::runtime_error(row.name + " ended " + std::to_string(cpu_us.size()) +
                             " jobs, at least 10 are needed: a longer --seconds");
  std::sort(cpu_us.begin(), cpu_us.end());
  const auto at = [&](double q) { return rt::quantile_of_sorted(std::span(cpu_us), q); };
  row.p50_us = at(0.5);
  row.p99_us = at(0.99);
  row.p999_us = at(0.999);
  row.work_min = static_cast<double>(work_min);
  row.work_max = static_cast<double>(work_max);
  tell_stretches(jobs, images, row);
  for (std::size_t i = 0; i < row.quantiles_us.size(); ++i) {
    row.quantiles_us[i] =
        at(static_cast<double>(i) / static_cast<double>(row.quantiles_us.size() - 1));
  }
  return c.rows.emplace_back(row);
}

// Where the camera of the stored run was: on the twin of the base, or as the recording's own poses
// say.
class CameraTruth {
 public:
  CameraTruth(const Scene& scene, const RobotHalf& robot) : rgbd_(scene.rgbd_dir) {
    if (!rgbd_.empty()) return;
    for (const TruthSample& t : robot.view.truth) {
      const double t_s = 1e-9 * static_cast<double>(kRobotClock.to_host(t.stamp));
      if (!poses_.empty() && t_s <= poses_.back().t_s) continue;
      perception::Pose X_WB = perception::Pose::Identity();
      X_WB.translation() = perception::Vec3(t.x_m, t.y_m, 0);
      X_WB.linear() = perception::rotation_about_z(t.yaw_rad);
      poses_.push_back({t_s, X_WB * scene.camera.true_X_BC()});
    }
  }
  [[nodiscard]] TrackingFigures judge(const std::vector<tasks::FusionSample>& samples) const {
    if (!rgbd_.empty()) return recording_figures(rgbd_, samples);
    return tracking_figures(samples, [this](rt::Time exposure) {
      return pose_at(poses_, 1e-9 * static_cast<double>(kOperatorClock.to_host(exposure)), kGap_s);
    });
  }

 private:
  static constexpr double kGap_s = 0.1;  // the base is watched less often than images are made
  std::string rgbd_;
  std::vector<StampedPose> poses_;
};

// A folder for the time of the measurement.
class ScratchFolder {
 public:
  ScratchFolder() {
    path_ = (std::filesystem::temp_directory_path() /
             ("teletact-calibrate-" + std::to_string(::getpid()) + "-XXXXXX"))
                .string();
    if (::mkdtemp(path_.data()) == nullptr)
      throw std::runtime_error(
          path_ +
          ": can not be created; the stored input goes there, so set TMPDIR to a writable folder");
  }
  ~ScratchFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  ScratchFolder(const ScratchFolder&) = delete;
  ScratchFolder& operator=(const ScratchFolder&) = delete;
  [[nodiscard]] const std::string& path() const { return path_; }

 private:
  std::string path_;
};

// The passes over the stored input.
class Passes {
 public:
  // `passer_from`: host time of the first exposure that may have somebody in it.
  Passes(rt::NonRealtime& nrt, Scene& scene, const std::string& folder, CameraTruth truth,
         std::int64_t passer_from_ns, bool quiet)
      : nrt_(nrt),
        scene_(scene),
        rgbd_(scene.rgbd_dir),
        truth_(std::move(truth)),
        passer_from_ns_(passer_from_ns),
        quiet_(quiet) {
    for (const auto box : {rt::Box::kOperator, rt::Box::kRobot}) {
      auto r = read_recording(recording_file(folder, box));
      if (!r) throw std::runtime_error(r.error());
      of(box) = std::move(r).value();
    }
  }

  // Everything at level 0, but `task` at `level`.
  Jobs run(rt::Box box, int task, int level, const std::string& what) {
    if (!quiet_) {
      std::printf("calibrate: %s\n", what.c_str());
      std::fflush(stdout);
    }
    Jobs jobs;
    Trial trial;
    trial.level = [&](tasks::TaskId id, int) { return static_cast<int>(id) == task ? level : 0; };
    trial.fusion_workers = workers();
    trial.took = [&](const rt::JobRecord& r) {
      end_if_asked();
      jobs[r.task].push_back(r);
    };
    trial.fused = [&](const std::vector<tasks::FusionSample>& samples) {
      tracking_ = truth_.judge(samples);
      look_for_movers(samples);
    };
    const auto result = run_trial(nrt_, scene_, of(box), trial);
    scene_.rgbd_dir = rgbd_;
    if (!result) throw std::runtime_error(result.error());
    std::string wrong = result.value().first_difference;
    auto& hash = box == rt::Box::kOperator ? input_.operator_hash : input_.robot_hash;
    if (hash != 0 && hash != result.value().inputs_hash)
      wrong = "its bytes differ from the first pass";
    hash = result.value().inputs_hash;
    if (!wrong.empty())
      throw std::runtime_error(what + ": the task did not get the stored input: " + wrong);
    ++input_.passes;
    return jobs;
  }
  [[nodiscard]] const CalibrationInput& input() const { return input_; }
  // Of the last pass of the operator's box: how fusion tracked, into its row.
  void tell_tracking(tasks::CalibrationRow& row) const {
    if (tracking_.frames == 0) return;
    const auto frames = static_cast<double>(tracking_.frames);
    row.tracked_share = static_cast<double>(tracking_.tracked) / frames;
    row.claimed_share = static_cast<double>(tracking_.claimed) / frames;
    row.off_mm = tracking_.off_mm;
  }
  // Of the jobs of the last pass of the operator's box.
  [[nodiscard]] const std::vector<Image>& images() const { return images_; }
  [[nodiscard]] int workers() const { return scene_.graph.pool.fusion_workers; }

 private:
  void look_for_movers(const std::vector<tasks::FusionSample>& samples) {
    const bool first = images_.empty();
    images_.clear();
    for (const auto& s : samples) {
      const bool moving = kOperatorClock.to_host(s.exposure) >= passer_from_ns_;
      images_.push_back(!s.consumed ? Image::kNone : moving ? Image::kMoving : Image::kStill);
      if (!first || images_.back() != Image::kMoving) continue;
      ++input_.moving_images;
      input_.moving_share = std::max(input_.moving_share, static_cast<double>(s.moving_share));
    }
  }
  Recording& of(rt::Box box) { return box == rt::Box::kOperator ? operator_ : robot_; }
  rt::NonRealtime& nrt_;
  Scene& scene_;
  std::string rgbd_;
  CameraTruth truth_;
  TrackingFigures tracking_;
  std::vector<Image> images_;
  std::int64_t passer_from_ns_;
  bool quiet_;
  Recording operator_, robot_;
  CalibrationInput input_;
};

int level_count(const tasks::TaskRow& row) {
  int n = 0;
  while (n < static_cast<int>(row.variants.size()) &&
         !row.variants[static_cast<std::size_t>(n)].name.empty())
    ++n;
  return n;
}

std::string pass_name(const tasks::TaskRow& row, const std::string& choice, int level) {
  return std::string(row.name) + " " +
         std::string(row.variants[static_cast<std::size_t>(level)].name) +
         (choice.empty() ? "" : ", " + choice);
}

constexpr int kFusion = static_cast<int>(tasks::TaskId::kFusion);

// All tasks without static choices, at `choice`, the best one; of `only` this box, or of both.
void measure_plain(tasks::Calibration& c, Passes& passes, const std::string& choice,
                   std::optional<rt::Box> only) {
  for (const auto box : {rt::Box::kOperator, rt::Box::kRobot}) {
    if (only && *only != box) continue;
    const bool of_op = box == rt::Box::kOperator;
    const Jobs base = passes.run(
        box, -1, 0,
        of_op ? "operator's box at level 0, " + choice : std::string("robot's box at level 0"));
    for (int task = 0; task < tasks::kTaskCount; ++task) {
      const auto& row = tasks::kTaskTable[static_cast<std::size_t>(task)];
      const auto i = static_cast<std::size_t>(task);
      if (row.box != box) continue;
      tasks::CalibrationRow& first = task == kFusion
                                         ? add_row(c, base[i], task, choice, 0, passes.images())
                                         : add_row(c, base[i], task, "", 0);
      if (task == kFusion) passes.tell_tracking(first);
      if (task == kFusion && passes.workers() > 0)
        add_row(c, base[kShares], kShares, choice, 0, passes.images());
      for (int level = 1; task != kFusion && level < level_count(row); ++level)
        add_row(c, passes.run(box, task, level, pass_name(row, {}, level))[i], task, {}, level);
    }
  }
}

// The file of a real robot says nothing of the place where it is, and in a world of nothing fusion
// can not track: the shipped room stands in for as long as is measured.
class SomethingToSee {
 public:
  SomethingToSee(Scene& scene, bool quiet) : scene_(scene) {
    const drivers::WorldConfig& w = scene.world;
    if (!scene.rgbd_dir.empty() || w.room.present() || !w.boxes.empty() || !w.planes.empty() ||
        !w.cylinders.empty() || !w.spheres.empty() || !w.capsules.empty())
      return;
    if (!quiet) std::printf("calibrate: nothing in [world], so the images are of default_room\n");
    given_ = scene.world;
    scene.world = load_scene(find_config("scenes", "default_room"), {})->world;
  }
  ~SomethingToSee() {
    if (given_) scene_.world = std::move(*given_);
  }
  SomethingToSee(const SomethingToSee&) = delete;
  SomethingToSee& operator=(const SomethingToSee&) = delete;

 private:
  Scene& scene_;
  std::optional<drivers::WorldConfig> given_;
};

constexpr double kStillShare = 0.6;  // of the images: somebody is in the others

// What its rows were measured with beside the scene's images.
void note_asked(tasks::Calibration& c, const Scene& scene) {
  c.ray_cast = scene.graph.haptic.asks_for_ray_cast();
  c.pictures = scene.graph.capture.pictures.dialect();
}

double share_of(std::int64_t cpu_ns, const VirtualRun& run) {
  return 1e-9 * static_cast<double>(cpu_ns) / run.seconds;
}

// Of threads that are no tasks. Not with a recording: it ends, and then its last image is held, so
// that the link would seem to take less.
void note_ordinary(tasks::Calibration& c, const VirtualRun& run) {
  c.link_share = share_of(run.link_cpu_ns, run);
  c.camera_twin_share = share_of(run.robot.camera_twin_cpu_ns, run);
}

void tell_not_tracking(const tasks::Calibration& c) {
  for (const auto& row : c.rows) {
    const std::string why = c.does_not_track(row);
    if (!why.empty())
      std::printf("calibrate: fusion %s, level %d will not be admitted: %s\n", row.choice.c_str(),
                  row.level, why.c_str());
  }
}

}  // namespace

tasks::Calibration calibrate(rt::NonRealtime& nrt, Scene& scene, double seconds, bool quiet,
                             CalibrationInput* input, std::optional<rt::Box> only) {
  tasks::Calibration c;
  static_cast<tasks::CalibrationOrigin&>(c) = calibration_origin(scene);
  const SomethingToSee world(scene, quiet);
  note_asked(c, scene);
  std::vector<tasks::VoxelOption> options;
  for (const auto& option : tasks::voxel_options(choice_limits(scene))) {
    if (option.ruled_out.empty())
      options.push_back(option);
    else if (!quiet)
      std::printf("calibrate: not %s: %s\n", option.name.c_str(), option.ruled_out.c_str());
  }
  if (options.empty()) throw std::runtime_error("no voxel size fits this scene");
  const double voxel_m = scene.graph.fusion.tsdf.voxel_size_m;
  const ScratchFolder folder;
  DemoOptions o;
  o.seconds = seconds;
  o.virtual_clock = o.quiet = o.record = true;
  o.report = folder.path();
  o.force_choice = options.front().name;
  o.black_box_s = 0;
  o.cores = 8;  // never a reason to refuse
  // A recording's last image is held: what moves there is no test of tracking.
  o.passer_from_s =
      kStillShare *
      (scene.rgbd_dir.empty() ? seconds : std::min(seconds, recording_seconds(scene.rgbd_dir)));
  if (!quiet) {
    std::printf("calibrate: storing %.0f s of input ...\n", seconds);
    std::fflush(stdout);
  }
  // Admission and costs of the stored run are the declared ones: it is the same on every machine.
  const VirtualRun stored = run_virtual(nrt, scene, o, tasks::Calibration{});
  end_if_asked();
  if (scene.rgbd_dir.empty()) note_ordinary(c, stored);
  Passes passes(nrt, scene, folder.path() + "/raw", CameraTruth(scene, stored.robot),
                kOperatorClock.to_host(rt::time_from_ns(stored.op.epoch_ns)) +
                    rt::nanos_from_seconds(o.passer_from_s).count(),
                quiet);
  const auto& fusion = tasks::kTaskTable[static_cast<std::size_t>(kFusion)];
  for (const auto& option : options) {
    scene.graph.fusion.tsdf.voxel_size_m = option.voxel_m;
    const bool best = &option == &options.front();
    if (best) measure_plain(c, passes, option.name, only);
    if (only && *only != fusion.box) break;
    for (int level = best ? 1 : 0; level < level_count(fusion); ++level) {
      const Jobs jobs =
          passes.run(fusion.box, kFusion, level, pass_name(fusion, option.name, level));
      passes.tell_tracking(add_row(c, jobs[static_cast<std::size_t>(kFusion)], kFusion, option.name,
                                   level, passes.images()));
      if (passes.workers() > 0)
        add_row(c, jobs[kShares], kShares, option.name, level, passes.images());
    }
  }
  scene.graph.fusion.tsdf.voxel_size_m = voxel_m;
  if (!quiet) tell_not_tracking(c);
  if (input != nullptr) *input = passes.input();
  return c;
}

tasks::Calibration with_link(rt::NonRealtime& nrt, Scene& scene, double seconds,
                             const tasks::Calibration& calibration) {
  tasks::Calibration c = as_asked(calibration, scene);
  DemoOptions o;
  o.seconds = seconds;
  o.virtual_clock = o.quiet = true;
  o.black_box_s = 0;
  o.cores = 8;  // never a reason to refuse
  const double voxel_m = scene.graph.fusion.tsdf.voxel_size_m;
  const VirtualRun run = run_virtual(nrt, scene, o, tasks::Calibration{});
  scene.graph.fusion.tsdf.voxel_size_m = voxel_m;
  end_if_asked();
  c.link_share = share_of(run.link_cpu_ns, run);
  return c;
}

}  // namespace teletact
