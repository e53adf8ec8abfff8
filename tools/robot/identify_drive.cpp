#include "tools/robot/identify_drive.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <numbers>
#include <optional>
#include <stdexcept>

#include "drivers/camera/tum_reader.hpp"
#include "tools/cli/options.hpp"
#include "tools/files/metrics_json.hpp"
#include "tools/files/pose_file.hpp"
#include "tools/files/take.hpp"
#include "tools/files/today.hpp"
#include "tools/files/whole_file.hpp"
#include "tools/robot/floor_seen.hpp"
#include "tools/robot/robot_drive.hpp"
#include "tools/robot/robot_files.hpp"

namespace teletact {
namespace {

constexpr double kRadPerDeg = std::numbers::pi / 180;
// Half the base's diagonal and a hand's breadth.
constexpr double kAbout_m = 0.40;

// Of the images near a claimed pose, one in fifteen.
void see_floor(const IdentifyRobotOptions& o, const RobotModel& stated, RobotDrive& drive) {
  constexpr int kEvery = 15;
  drivers::TumOptions tum;
  tum.skip_colour = true;
  const auto sequence = take(drivers::TumSequence::open(o.rgbd, tum));
  const auto frame = std::make_unique<perception::RgbdFrame>();
  for (int i = 0; i < sequence.size(); i += kEvery) {
    take(sequence.read(i, *frame));
    if (const auto f = floor_seen(*frame, stated.X_BC, static_cast<std::uint64_t>(i)))
      drive.floor.push_back(*f);
  }
}

RobotDrive recorded(const IdentifyRobotOptions& o, const RobotModel& stated) {
  RobotDrive drive;
  drive.wheels = take(read_wheels(o.wheels, o.ticks_per_turn, stated.base.gear_ratio));
  for (const StampedPose& p : take(read_poses(o.poses))) drive.cameras.push_back({p.t_s, p.X});
  if (!o.rgbd.empty()) see_floor(o, stated, drive);
  return drive;
}

void say_room(const DriveScript& script) {
  const auto r = script.room();
  std::printf(
      "drive      %.0f s at %.2f m/s and %.0f deg/s; free floor: %.1f m ahead, %.1f m behind, %.1f "
      "m to each side of where it starts\n",
      script.seconds(), DriveScript::kSpeed_m_per_s, DriveScript::kTurn_rad_per_s / kRadPerDeg,
      r.x_most_m + kAbout_m, kAbout_m - r.x_least_m, std::max(r.y_most_m, -r.y_least_m) + kAbout_m);
}

struct Row {
  const char *name, *metric;
  double stated, found, sigma;
  bool constrained;
  const char* unit;
};

std::vector<Row> rows_of(const RobotFit& fit, const RobotModel& stated) {
  static constexpr const char* kWheel[] = {"front left", "front right", "back left", "back right"};
  static constexpr const char* kMetric[] = {"wheel.front_left", "wheel.front_right",
                                            "wheel.back_left", "wheel.back_right"};
  std::vector<Row> rows;
  for (std::size_t i = 0; i < drivers::kWheels; ++i) {
    rows.push_back({kWheel[i], kMetric[i], stated.base.wheel_scale[i],
                    fit.found.base.wheel_scale[i], fit.wheel_sigma[i], fit.wheel_constrained[i],
                    "1"});
  }
  const auto add = [&](const char* name, const char* metric, RobotParameter p, double from,
                       double to, double unit, const char* named) {
    rows.push_back({name, metric, from, to, fit.of(p).sigma / unit, fit.of(p).constrained, named});
  };
  add("lever", "lever", RobotParameter::kLever, stated.base.lever_scale, fit.found.base.lever_scale,
      1, "1");
  add("slide", "slide", RobotParameter::kSlide, stated.base.slide_scale, fit.found.base.slide_scale,
      1, "1");
  const auto p0 = stated.X_BC.translation(), p1 = fit.found.X_BC.translation();
  add("camera x", "camera.x", RobotParameter::kX, 1e3 * p0.x(), 1e3 * p1.x(), 1e-3, "mm");
  add("camera y", "camera.y", RobotParameter::kY, 1e3 * p0.y(), 1e3 * p1.y(), 1e-3, "mm");
  add("camera z", "camera.z", RobotParameter::kZ, 1e3 * p0.z(), 1e3 * p1.z(), 1e-3, "mm");
  const auto a0 = mount_angles_deg(stated.X_BC.linear()),
             a1 = mount_angles_deg(fit.found.X_BC.linear());
  add("camera yaw", "camera.yaw", RobotParameter::kYaw, a0[0], a1[0], kRadPerDeg, "deg");
  add("camera pitch", "camera.pitch", RobotParameter::kPitch, a0[1], a1[1], kRadPerDeg, "deg");
  add("camera roll", "camera.roll", RobotParameter::kRoll, a0[2], a1[2], kRadPerDeg, "deg");
  return rows;
}

void tell(const RobotFit& fit, const std::vector<Row>& rows, Metrics& metrics) {
  std::printf("           stated      found       sigma\n");
  for (const Row& r : rows) {
    const bool share = std::string(r.unit) == "1";
    std::printf(share ? "%-12s %9.5f   %9.5f   " : "%-12s %9.2f   %9.2f   ", r.name, r.stated,
                r.found);
    if (!r.constrained) {
      // Of four radii the mean may be known, and each of them not.
      const bool wheel = std::string(r.metric).rfind("wheel.", 0) == 0;
      std::printf(wheel ? "not constrained one by one\n"
                        : "not constrained by this drive: as stated\n");
    } else if (share) {
      std::printf("%.5f\n", r.sigma);
    } else {
      std::printf("%.2f %s\n", r.sigma, r.unit);
    }
    const std::string name = std::string("identify.robot.") + r.metric;
    const std::string unit = share ? "" : std::string("_") + r.unit;
    metrics.add(name + unit, r.found, r.unit);
    if (r.constrained) metrics.add(name + "_sigma" + unit, r.sigma, r.unit);
  }
  std::printf(
      "drive      %.1f s, %.2f m, %.0f degrees; %d instants, %d left out; %d of 12 directions "
      "constrained, condition %.3g\n"
      "camera     errs by %.1f mm and %.2f degrees (one standard deviation), floor seen in %d "
      "images\n"
      "wheels     slip differs by %.1f %% from second to second; the mean slip is in the radii\n"
      "odometry   %.1f mm and %.2f degrees a metre as stated, %.1f mm and %.2f degrees as found, "
      "on this drive\n",
      fit.seconds, fit.way_m, fit.turn_rad / kRadPerDeg, fit.instants, fit.left_out, fit.rank,
      fit.condition, 1e3 * fit.camera_m, fit.camera_rad / kRadPerDeg, fit.floor_frames,
      100 * fit.slip, 1e3 * fit.before_m_per_m, fit.before_rad_per_m / kRadPerDeg,
      1e3 * fit.after_m_per_m, fit.after_rad_per_m / kRadPerDeg);
  if (const std::string missing = unconstrained(fit, true); !missing.empty())
    std::printf("as stated  %s: not constrained by this drive\n", missing.c_str());
  metrics.add("identify.robot.seconds", fit.seconds, "s");
  metrics.add("identify.robot.way_m", fit.way_m, "m");
  metrics.add("identify.robot.turn_deg", fit.turn_rad / kRadPerDeg, "deg");
  metrics.add("identify.robot.instants", fit.instants, "1");
  metrics.add("identify.robot.left_out", fit.left_out, "1");
  metrics.add("identify.robot.floor_images", fit.floor_frames, "1");
  metrics.add("identify.robot.rank", fit.rank, "1");
  metrics.add("identify.robot.condition", fit.condition, "1");
  metrics.add("identify.robot.camera_error_mm", 1e3 * fit.camera_m, "mm");
  metrics.add("identify.robot.camera_error_deg", fit.camera_rad / kRadPerDeg, "deg");
  metrics.add("identify.robot.slip_spread", fit.slip, "1");
  metrics.add("identify.robot.odometry_before_mm_per_m", 1e3 * fit.before_m_per_m, "mm/m");
  metrics.add("identify.robot.odometry_after_mm_per_m", 1e3 * fit.after_m_per_m, "mm/m");
  metrics.add("identify.robot.odometry_before_deg_per_m", fit.before_rad_per_m / kRadPerDeg,
              "deg/m");
  metrics.add("identify.robot.odometry_after_deg_per_m", fit.after_rad_per_m / kRadPerDeg, "deg/m");
}

void tell_truth(const RobotFit& fit, const TwinDrive& twin, Metrics& metrics) {
  double wheel = 0;
  for (std::size_t i = 0; i < drivers::kWheels; ++i) {
    wheel = std::max(wheel,
                     std::abs(fit.found.base.wheel_scale[i] / twin.truth.base.wheel_scale[i] - 1));
  }
  const double mm = 1e3 * (fit.found.X_BC.translation() - twin.truth.X_BC.translation()).norm();
  const double deg =
      perception::rotation_angle(fit.found.X_BC.linear().transpose() * twin.truth.X_BC.linear()) /
      kRadPerDeg;
  std::printf(
      "the twin   %d of %d images claimed; off the truth: radii by %.2f %% at most, mount by %.1f "
      "mm and %.2f degrees\n",
      twin.claimed, twin.frames, 100 * wheel, mm, deg);
  metrics.add("identify.robot.claimed_share",
              twin.frames > 0 ? static_cast<double>(twin.claimed) / twin.frames : 0, "1");
  metrics.add("identify.robot.truth.wheel_error", wheel, "1");
  metrics.add("identify.robot.truth.camera_error_mm", mm, "mm");
  metrics.add("identify.robot.truth.camera_error_deg", deg, "deg");
}

// Without all of what a full drive gives, only who asks for it gets a part.
void refuse_part(const RobotFit& fit, bool partial) {
  const std::string missing = unconstrained(fit, false);
  if (partial || missing.empty()) return;
  char text[200];
  std::snprintf(text, sizeof text,
                ": it went %.1f m and turned %.0f degrees; drive forwards, sideways and with turns "
                "both ways, or take the rest with --partial",
                fit.way_m, fit.turn_rad / kRadPerDeg);
  throw std::runtime_error("the drive does not constrain " + missing + text);
}

}  // namespace

void identify_drive(const IdentifyRobotOptions& o) {
  check_outputs({{"--json", o.json}, {"--write", o.write}, {"--plan", o.plan}},
                {o.wheels, o.poses});
  const DriveScript script;
  if (!o.plan.empty()) {
    say_room(script);
    write_whole_file(o.plan, script.csv());
    return;
  }
  if (!o.record.empty()) make_output_folder("--record", o.record);
  const auto scene = load_scene(find_config("scenes", o.scene), o.overrides);
  const RobotModel stated = stated_robot(*scene);
  Metrics metrics("identify robot");
  std::optional<TwinDrive> twin;
  RobotDrive drive;
  if (o.wheels.empty()) {
    say_room(script);
    rt::Startup startup;
    if (!scene->schema.section("fusion").section("tsdf").named("voxel_size_m"))
      scene->graph.fusion.tsdf.voxel_size_m = 0.02;
    twin = drive_twin(startup.token(), *scene, script);
    drive = twin->drive;
    if (!o.record.empty()) {
      write_whole_file(o.record + "/wheels.csv", wheels_csv(drive.wheels));
      write_whole_file(o.record + "/poses.txt", poses_text(drive.cameras));
    }
  } else {
    drive = recorded(o, stated);
  }
  const RobotFit fit = take(fit_robot(drive, stated));
  tell(fit, rows_of(fit, stated), metrics);
  if (twin) tell_truth(fit, *twin, metrics);
  refuse_part(fit, o.partial);
  write_outputs(
      {{o.write,
        [&](const auto& path) { write_whole_file(path, calibration_toml(fit, stated, today())); }},
       {o.json, [&](const auto& path) { metrics.write(path); }}});
}

}  // namespace teletact
