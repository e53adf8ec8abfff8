// teletact replay: the tasks of a recorded run again, and whether every job committed the same.
#include <CLI/CLI.hpp>
#include <cinttypes>
#include <cstdio>
#include <filesystem>
#include <stdexcept>

#include "config/fault_plan.hpp"
#include "tools/cli/options.hpp"
#include "tools/files/metrics_json.hpp"
#include "tools/host/replay.hpp"
#include "tools/record/input_recorder.hpp"
#include "tools/teletact/commands.hpp"

namespace teletact {

namespace {

bool recorded(const std::string& folder, rt::Box box) {
  return std::filesystem::exists(recording_file(folder, box));
}

// Of `both`, what is there: the folder of one box's run has one. Where none is, both: reading the
// first one says so.
bool chosen(const std::string& folder, const std::string& choice, rt::Box b) {
  const rt::Box other = b == rt::Box::kOperator ? rt::Box::kRobot : rt::Box::kOperator;
  if (choice == "both") return recorded(folder, b) || !recorded(folder, other);
  return (choice == "operator") == (b == rt::Box::kOperator);
}

}  // namespace

int cmd_replay(int argc, char** argv) {
  CLI::App app{
      "Runs the tasks of a recorded run (demo, robot or operator, --record) again on their "
      "recorded "
      "inputs. Exit code 0: every job committed the same bytes; 1: not; 2: the recording can not "
      "be replayed."};
  std::string folder, box = "both", json;
  std::uint64_t order = 0;
  app.add_option("folder", folder, "REPORT/raw of the run")->required();
  app.add_option("--box", box, "which box; both: of the run of one box, that one")
      ->check(CLI::IsMember({"operator", "robot", "both"}))
      ->capture_default_str();
  app.add_option(
      "--order", order,
      "0: jobs in the order they ran; else the seed of another order that the inputs allow");
  app.add_option("--json", json, "write the figures to this file");
  if (!parse_options(app, argc, argv)) return 0;
  check_outputs({{"--json", json}},
                {folder + "/scene.toml", recording_file(folder, rt::Box::kOperator),
                 recording_file(folder, rt::Box::kRobot)});
  rt::FaultPlan faults;
  if (const std::string file = folder + "/faults.toml"; std::filesystem::exists(file)) {
    auto loaded = config::load_fault_plan(file);
    if (!loaded) throw std::runtime_error(loaded.error());
    faults = std::move(loaded).value();
  }
  rt::Startup startup;
  bool same = true;
  Metrics metrics("replay");
  for (const rt::Box b : {rt::Box::kOperator, rt::Box::kRobot}) {
    const char* name = b == rt::Box::kOperator ? "operator" : "robot";
    if (!chosen(folder, box, b)) continue;
    auto recording = read_recording(recording_file(folder, b));
    if (!recording) throw std::runtime_error(recording.error());
    const auto scene = load_scene(folder + "/scene.toml", {});
    const auto result = replay(startup.token(), *scene, faults, recording.value(), order);
    if (!result) throw std::runtime_error(result.error());
    const auto& r = result.value();
    std::printf("%-8s  %" PRIu64 " of %" PRIu64 " jobs equal, %" PRIu64 " abandoned, %" PRIu64
                " unfinished, %" PRIu64 " messages\n",
                name, r.equal, r.jobs, r.abandoned, r.unfinished, r.messages);
    if (!r.first_difference.empty())
      std::printf("%-8s  first difference: %s\n", name, r.first_difference.c_str());
    same = same && r.same();
    const auto add = [&](const char* what, std::uint64_t value) {
      metrics.add(std::string("replay.") + name + "." + what, static_cast<double>(value), "1");
    };
    add("jobs", r.jobs);
    add("equal", r.equal);
    add("abandoned", r.abandoned);
    add("unfinished", r.unfinished);
    add("messages", r.messages);
  }
  if (!json.empty()) metrics.write(json);
  return same ? 0 : 1;
}

}  // namespace teletact
