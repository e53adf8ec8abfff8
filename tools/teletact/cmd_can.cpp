// teletact can: TMCL modules on a CAN bus for a person at the bench.
//
//   scan     who answers, by identifier; asks for the firmware's version alone, nothing moves
//   dump     what passes on the bus, with its TMCL meaning
//   get      an axis parameter, or a global one
//   set      the same, written; a motor may move, so it wants --yes
//   serve    four simulated modules on an interface (vcan), until the time is over
//
//   --iface IF   a CAN interface that is up
//   --twin       simulated modules in this process
//
// Exit code 0: fine; 1: nobody there, or a module refuses; 2: bad input.
#include <CLI/CLI.hpp>
#include <cstdio>

#include "tools/bus/can_command.hpp"
#include "tools/bus/ethercat_session.hpp"
#include "tools/cli/options.hpp"
#include "tools/teletact/commands.hpp"

namespace teletact {

namespace {

void add_parameter_options(CLI::App& c, CanOptions& o) {
  c.add_option("--id", o.id, "CAN identifier that the module listens to")
      ->check(CLI::Range(0, 0x7FF))
      ->required();
  c.add_option("--parameter", o.parameter, "number, 0 to 255")
      ->check(CLI::Range(0, 255))
      ->required();
  c.add_option("--motor", o.motor, "of the module; with --global the bank")
      ->check(CLI::Range(0, 255))
      ->capture_default_str();
  c.add_flag("--global", o.global, "a global parameter");
}

}  // namespace

int cmd_can(int argc, char** argv) {
  CanOptions o;
  CLI::App app("TMCL modules on a CAN bus: list modules, show traffic, read and set parameters.",
               "teletact can");
  app.require_subcommand(1);
  auto* scan = app.add_subcommand("scan", "list the modules that answer; nothing moves");
  auto* dump = app.add_subcommand("dump", "show the traffic on the bus");
  auto* get = app.add_subcommand("get", "read a parameter");
  auto* set = app.add_subcommand("set", "write a parameter; a motor may move");
  auto* serve = app.add_subcommand("serve", "four simulated modules on an interface");
  for (CLI::App* c : {scan, dump, get, set, serve})
    c->add_option("--iface", o.bus.iface, "CAN interface that is up");
  serve->get_option("--iface")->required();
  for (CLI::App* c : {scan, dump, get, set}) {
    c->add_flag("--twin", o.bus.twin, "simulated modules in this process");
    c->add_option("--json", o.json, "write what was found to this file");
  }
  scan->add_option("--last-id", o.last_id, "last identifier that is asked")
      ->check(CLI::Range(1, 0x7FF))
      ->capture_default_str();
  for (CLI::App* c : {scan, get, set})
    c->add_option("--wait-ms", o.wait_ms, "for a reply")
        ->check(CLI::Range(1, 1000))
        ->capture_default_str();
  for (CLI::App* c : {dump, serve})
    c->add_option("--for", o.for_s, "seconds")
        ->check(CLI::Range(0.01, 86400.0))
        ->capture_default_str();
  add_parameter_options(*get, o);
  add_parameter_options(*set, o);
  set->add_option("--value", o.value, "what to write")
      ->check(CLI::Range(-2147483648.0, 2147483647.0))
      ->required();
  set->add_flag("--yes", o.yes, "the place is clear: a motor may move");
  if (!parse_options(app, argc, argv)) return 0;
  check_outputs({{"--json", o.json}}, {});
  try {
    if (scan->parsed()) return can_scan(o);
    if (dump->parsed()) return can_dump(o);
    if (serve->parsed()) return can_serve(o);
    return get->parsed() ? can_get(o) : can_set(o);
  } catch (const CouldNotDo& e) {
    std::fprintf(stderr, "teletact can: %s\n", e.what());
    return 1;
  }
}

}  // namespace teletact
