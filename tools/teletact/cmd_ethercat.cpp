// teletact ethercat: the EtherCAT bus of a youBot for a person at the bench.
//
//   scan     who is there, by EEPROM, and is it the chain that is expected; all slaves go to INIT
//   state    the state of each slave, changing none; --to STATE brings the chain there
//   read     a register, an EEPROM word, a motor parameter (TMCL), an object (CoE)
//   write    a register, a motor parameter, an object
//   capture  every frame of the card for a time, as pcap; beside a running robot, and sends none
//
//   --iface IF   a network card (CAP_NET_RAW)
//   --twin KIND  the virtual youBot in this process: base, base+arm, base+2arms, arm
//
// Exit code 0: fine; 1: a wrong chain, no frame that comes back, or a slave that does not do it; 2:
// bad input.
#include <CLI/CLI.hpp>
#include <cstdio>

#include "drivers/ethercat/scan.hpp"
#include "tools/bus/ethercat_command.hpp"
#include "tools/cli/options.hpp"
#include "tools/teletact/commands.hpp"

namespace teletact {

namespace {

namespace ec = drivers::ethercat;

void add_bus_options(CLI::App& c, EtherCatOptions& o) {
  c.add_option("--iface", o.bus.iface, "network card; needs CAP_NET_RAW");
  c.add_option("--twin", o.bus.twin, "the virtual youBot: base, base+arm, base+2arms, arm");
  c.add_option("--generation", o.bus.generation, "of the twin's boards; new unless said")
      ->check(CLI::IsMember({"old", "new"}));
  c.add_option("--json", o.json, "write what was found to this file");
}

void add_capture_option(CLI::App& c, EtherCatOptions& o) {
  c.add_option("--capture", o.bus.capture, "write every frame to this file, as pcap");
}

void add_place_options(CLI::App& c, EtherCatOptions& o, bool writing) {
  const auto nothing = CLI::Range(0, 0xFFFF);
  c.add_option("--slave", o.slave, "counted from 1")
      ->check(CLI::Range(1, ec::kMostSlaves))
      ->required();
  c.add_option("--register", o.reg, "of the slave controller, 0x0000 to 0xFFFF")->check(nothing);
  c.add_option("--parameter", o.parameter,
               "of the motor controller (TMCL), 0 to 255; slaves go to PREOP")
      ->check(CLI::Range(0, 255));
  c.add_option("--sdo", o.sdo, "CoE object, INDEX:SUBINDEX in hexadecimal; slaves go to PREOP");
  if (!writing)
    c.add_option("--sii", o.sii, "word of the EEPROM; slaves go to INIT")->check(nothing);
  if (writing) c.add_option("--value", o.value, "what to write")->required();
  c.add_option("--bytes", o.bytes,
               writing ? "of a register or an object, 1 to 8; 2 unless said"
                       : "of a register or the EEPROM, 1 to 512; 2 unless said")
      ->check(CLI::Range(1, 512));
  c.add_option("--motor", o.motor, "of a parameter; the gripper's bars are 0 and 1")
      ->check(CLI::Range(0, 255));
  c.add_option("--module", o.module, "of a parameter: 0 the drive, 1 the gripper behind joint 5")
      ->check(CLI::Range(0, 255));
}

}  // namespace

int cmd_ethercat(int argc, char** argv) {
  EtherCatOptions o;
  CLI::App app("The EtherCAT bus of a youBot: who is there, in which state; reads and writes.",
               "teletact ethercat");
  app.require_subcommand(1);
  auto* scan = app.add_subcommand("scan", "who is there; all slaves go to INIT");
  auto* state = app.add_subcommand("state", "state of each slave, and bring the chain to one");
  auto* read = app.add_subcommand("read", "a register, an EEPROM word, a parameter, an object");
  auto* write = app.add_subcommand("write", "a register, a parameter, an object");
  auto* capture = app.add_subcommand("capture", "every frame of the card for a time, as pcap");
  for (CLI::App* c : {scan, state, read, write, capture}) add_bus_options(*c, o);
  for (CLI::App* c : {scan, state, read, write}) add_capture_option(*c, o);
  capture->add_option("--out", o.bus.capture, "the pcap file")->required();
  capture->add_option("--seconds", o.seconds, "how long")
      ->check(in_range(0.01, 600))
      ->capture_default_str();
  scan->add_option("--expect", o.expect, "the chain it should be: base, base+arm, base+2arms, arm");
  state->add_option("--to", o.to, "bring all slaves there")
      ->check(CLI::IsMember({"init", "preop", "safeop", "op"}));
  add_place_options(*read, o, false);
  add_place_options(*write, o, true);
  if (!parse_options(app, argc, argv)) return 0;
  check_outputs({{"--json", o.json}, {capture->parsed() ? "--out" : "--capture", o.bus.capture}},
                {});
  try {
    if (scan->parsed()) return run_scan(o);
    if (state->parsed()) return run_state(o);
    if (capture->parsed()) return run_capture(o);
    return read->parsed() ? run_read(o) : run_write(o);
  } catch (const CouldNotDo& e) {
    std::fprintf(stderr, "teletact ethercat: %s\n", e.what());
    return 1;
  }
}

}  // namespace teletact
