// teletact identify robot: the wheels' radii and the camera's mount, out of a drive of about a
// minute.
//
//   --scene NAME             the twin of that scene drives; with --wheels its stated values alone
//                            are taken
//   --wheels CSV --poses TUM a recorded drive of a real robot: wheel angles, and the camera's
//   claimed poses (of
//                            teletact fuse); --rgbd DIR: its images, for the floor and with it the camera's height
//   --plan CSV               writes the drive for a real base to follow, and ends
//   --write FILE             TOML with the keys to take over into a scene
#include <CLI/CLI.hpp>

#include "tools/cli/options.hpp"
#include "tools/robot/identify_drive.hpp"
#include "tools/teletact/commands.hpp"

namespace teletact {
namespace {

bool parse(IdentifyRobotOptions& o, int argc, char** argv) {
  CLI::App app(
      "Measures the rolling radii of the four wheels, lever and slide of the base, and the "
      "camera's "
      "mount, out of a drive of about a minute with turns both ways, forwards and sideways. The "
      "drive comes from the twin of a scene, or from files. No real base is moved by this program: "
      "--plan writes the drive for one, to be followed on free floor, with a hand on the stop.",
      "teletact identify robot");
  app.add_option("--scene", o.scene, "scene of the twin; with --wheels: whose values are stated")
      ->capture_default_str();
  app.add_option("--set", o.overrides, "override a key: camera.mount_pitch_deg=25");
  auto* wheels = app.add_option("--wheels", o.wheels,
                                "CSV t_s,front_left,front_right,back_left,back_right: rad");
  app.add_option("--ticks-per-turn", o.ticks_per_turn,
                 "the columns are encoder ticks, so many a motor turn (4000 on the youBot)")
      ->check(in_range(1, 1e6))
      ->needs(wheels);
  auto* poses = app.add_option("--poses", o.poses, "TUM lines, camera to world, clock of --wheels")
                    ->needs(wheels);
  wheels->needs(poses);
  app.add_option("--rgbd", o.rgbd, "images of the same drive: floor and camera height")
      ->needs(wheels);
  app.add_option("--record", o.record, "folder for the twin's wheels.csv and poses.txt")
      ->excludes(wheels);
  app.add_option("--plan", o.plan, "writes the drive as t_s,vx,vy,wz and ends");
  app.add_flag("--partial", o.partial, "take what the drive constrains, the rest stays as stated");
  app.add_option("--write", o.write, "TOML with the keys to take over into a scene");
  app.add_option("--json", o.json, "write the figures to this file");
  return parse_options(app, argc, argv);
}

}  // namespace

int cmd_identify_robot(int argc, char** argv) {
  IdentifyRobotOptions o;
  if (!parse(o, argc, argv)) return 0;
  identify_drive(o);
  return 0;
}

}  // namespace teletact
