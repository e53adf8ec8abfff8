// teletact: touch what only a robot can see. One program, one subcommand a job.
#include <array>
#include <cstdio>
#include <cstring>
#include <exception>

#include "tools/box/run_processes.hpp"
#include "tools/files/build_info.hpp"
#include "tools/teletact/commands.hpp"
#include "tools/teletact/measure.hpp"

namespace {

struct Command {
  const char* name;
  int (*run)(int, char**);
  const char* help;
};

constexpr std::array kCommands{
    Command{"demo", teletact::cmd_demo,
            "run both boxes on this machine, every device a twin; writes a report"},
    Command{"robot", teletact::cmd_robot,
            "run the robot's box, on its own machine or beside the operator's"},
    Command{"operator", teletact::cmd_operator,
            "run the operator's box, on its own machine or beside the robot's"},
    Command{"status", teletact::cmd_status, "what the boxes that run on this machine say"},
    Command{"explain", teletact::cmd_explain, "what a scene simulates, who asks, who pays"},
    Command{"fuse", teletact::cmd_fuse, "a recorded RGB-D sequence to camera poses and a mesh"},
    Command{"film", teletact::cmd_film, "a synthetic place to a recorded RGB-D sequence"},
    Command{"codec", teletact::cmd_codec, "a recording through the link's codecs and back"},
    Command{"touch", teletact::cmd_touch, "a distance field and a hand path to forces"},
    Command{"stability", teletact::start_measure, "the hard cases of touch, judged"},
    Command{"segment", teletact::cmd_segment,
            "the object under a touch, or every region of an image"},
    Command{"predict", teletact::cmd_predict, "an odometry log to delay-compensated poses"},
    Command{"calibrate", teletact::cmd_calibrate,
            "measure what each task variant costs on this machine"},
    Command{"audit", teletact::cmd_audit, "read a run's log: who was late, and why"},
    Command{"report", teletact::cmd_report, "a run's report again, or that of a piece of it"},
    Command{"replay", teletact::cmd_replay, "a recorded run's tasks again, to the last bit"},
    Command{"bench", teletact::start_measure, "rings, wake-up, audit: measured beside their peers"},
    Command{"accuracy", teletact::start_measure,
            "error against CPU time over a method's knobs, with plots"},
    Command{"device", teletact::cmd_device, "open the haptic device, read it, say how it is"},
    Command{"identify", teletact::cmd_identify,
            "the haptic device by ring-down; identify robot: wheels and camera mount"},
    Command{"keys", teletact::cmd_keys, "the lab's CA and its boxes' certificates"},
    Command{"can", teletact::cmd_can,
            "TMCL modules on a CAN bus: who is there, what passes, parameters"},
    Command{"ethercat", teletact::cmd_ethercat,
            "the robot's EtherCAT bus: who is there, states, registers, parameters"},
    Command{"youbot", teletact::cmd_youbot, "a youBot's drives at the bench: check, set-up, jog"},
    Command{"twin", teletact::cmd_twin,
            "a device's twin as a program: twin youbot, behind a network card"},
    Command{"doctor", teletact::cmd_doctor,
            "is this machine fit for real-time use, and what to do"},
};

void usage(std::FILE* out) {
  std::fprintf(
      out, "teletact %s: touch what only a robot can see\n\nusage: teletact COMMAND [OPTIONS]\n\n",
      teletact::kVersion);
  for (const auto& c : kCommands) std::fprintf(out, "  %-10s %s\n", c.name, c.help);
  std::fprintf(out, "\nteletact COMMAND --help tells the options.\n");
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2) {
    usage(stderr);
    return 2;
  }
  if (std::strcmp(argv[1], "--help") == 0 || std::strcmp(argv[1], "-h") == 0) {
    usage(stdout);
    return 0;
  }
  if (std::strcmp(argv[1], "--version") == 0) {
    std::printf("teletact %s\n", teletact::kVersion);
    return 0;
  }
  for (const auto& c : kCommands) {
    if (std::strcmp(argv[1], c.name) != 0) continue;
    try {
      return c.run(argc - 1, argv + 1);
    } catch (const teletact::CouldNotStart& e) {
      std::fprintf(stderr, "teletact %s: %s\n", c.name, e.what());
      return 3;
    } catch (const teletact::Stopped& e) {
      std::fprintf(stderr, "teletact %s: %s\n", c.name, e.what());
      return 1;
    } catch (const std::exception& e) {
      std::fprintf(stderr, "teletact %s: %s\n", c.name, e.what());
      return 2;
    }
  }
  std::fprintf(stderr, "teletact: unknown command '%s'\n\n", argv[1]);
  usage(stderr);
  return 2;
}
