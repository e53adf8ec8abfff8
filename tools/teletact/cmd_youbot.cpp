// teletact youbot: a youBot's drives for a person at the bench.
//
//   check   which drives there are and whether each is ready; moves nothing
//   setup   commutation, and the arm's homing; a person confirms before anything moves
//   jog     one wheel or joint at a speed for a time; a person confirms
//
// teletact twin youbot: the virtual youBot as a program behind a network card, real clock alone.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <iostream>

#include "drivers/ethercat/scan.hpp"
#include "tools/bus/youbot_command.hpp"
#include "tools/cli/options.hpp"
#include "tools/teletact/commands.hpp"

namespace teletact {

namespace {

void add_youbot_options(CLI::App& c, YoubotOptions& o) {
  c.add_option("--iface", o.bus.iface, "network card; needs CAP_NET_RAW");
  c.add_option("--twin", o.bus.twin,
               "the virtual youBot in this process: base, base+arm, base+2arms, arm");
  c.add_option("--generation", o.bus.generation, "of the twin's boards; new unless said")
      ->check(CLI::IsMember({"old", "new"}));
  c.add_option("--effects", o.bus.effects, "effects of the twin's motors, a file (config/effects)");
  c.add_option("--expect", o.expect, "the chain that it must be; else any of them")
      ->check(CLI::IsMember({"base", "base+arm", "base+2arms", "arm"}));
  c.add_option("--wait", o.wait_s,
               "seconds for boards that are missing: cable, emergency stop, power")
      ->check(in_range(0, 86400));
  c.add_option("--json", o.json, "write the drives, or what moved, to this file");
  c.add_option("--capture", o.bus.capture, "write every frame to this file, as pcap");
}

}  // namespace

int cmd_youbot(int argc, char** argv) {
  YoubotOptions o;
  CLI::App app("A youBot's drives at the bench: are they ready, make them ready, move one.",
               "teletact youbot");
  app.require_subcommand(1);
  auto* check = app.add_subcommand("check", "what each drive says; moves nothing");
  auto* setup = app.add_subcommand("setup", "commutation and the arm's homing; asks first");
  auto* jog = app.add_subcommand("jog", "one drive at a speed for a time; asks first");
  for (CLI::App* c : {check, setup, jog}) add_youbot_options(*c, o);
  setup->add_option("--calibration", o.calibration,
                    "write what homing measures to this file; homes arms that are homed too");
  jog->add_option("--slave", o.slave, "counted from 1")
      ->check(CLI::Range(1, drivers::ethercat::kMostSlaves))
      ->required();
  jog->add_option("--speed", o.speed_rad_per_s, "of wheel or joint, rad/s")
      ->check(CLI::Range(-3.0, 3.0))
      ->capture_default_str();
  jog->add_option("--seconds", o.seconds, "how long")
      ->check(CLI::Range(0.01, 10.0))
      ->capture_default_str();
  if (!parse_options(app, argc, argv)) return 0;
  check_outputs(
      {{"--json", o.json}, {"--capture", o.bus.capture}, {"--calibration", o.calibration}},
      {o.bus.effects});
  try {
    if (check->parsed()) return run_youbot_check(o);
    return setup->parsed() ? run_youbot_setup(o, std::cin) : run_youbot_jog(o, std::cin);
  } catch (const CouldNotDo& e) {
    std::fprintf(stderr, "teletact youbot: %s\n", e.what());
    return 1;
  }
}

int cmd_twin(int argc, char** argv) {
  TwinOptions o;
  std::string clock = "real";
  CLI::App app("A twin of a device as a program of its own.", "teletact twin");
  app.require_subcommand(1);
  auto* youbot = app.add_subcommand("youbot", "EtherCAT slaves of a youBot behind a network card");
  youbot->add_option("--iface", o.iface, "network card; needs CAP_NET_RAW")->required();
  youbot->add_option("--chain", o.chain, "base, base+arm, base+2arms, arm")->capture_default_str();
  youbot->add_option("--generation", o.generation, "of the boards")
      ->check(CLI::IsMember({"old", "new"}))
      ->capture_default_str();
  youbot->add_option("--seconds", o.seconds, "0: until it is interrupted")->capture_default_str();
  youbot->add_option(
      "--effects", o.effects,
      "friction, inertia, play, weight, current limit, I2t: a file (config/effects)");
  youbot->add_option(
      "--fault", o.faults,
      "KIND[:VALUE][@FROM[-TO]], again for each, seconds: lose-out, lose-back, duplicate, delay, "
      "corrupt, counter (:SHARE of frames), cut, fall, i2t, stick (:SLAVE), estop, silence, link");
  youbot->add_flag("--ready", o.ready, "commutation known, as after a set-up");
  youbot->add_option("--clock", clock, "real; a wire has no virtual one")->capture_default_str();
  if (!parse_options(app, argc, argv)) return 0;
  if (clock != "real")
    throw std::runtime_error("--clock " + clock +
                             ": a network card has the real clock alone; in one process with the "
                             "virtual clock: robot.bus.kind = \"ethercat-twin\"");
  return run_youbot_twin(o);
}

}  // namespace teletact
