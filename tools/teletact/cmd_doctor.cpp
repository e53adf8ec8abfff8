// teletact doctor: what this machine needs for real-time use. Exit code 0: fine, 1: advice, 2:
// unfit.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>

#include "tools/cli/options.hpp"
#include "tools/doctor/doctor.hpp"
#include "tools/doctor/rights.hpp"
#include "tools/files/metrics_json.hpp"
#include "tools/files/whole_file.hpp"
#include "tools/teletact/commands.hpp"

namespace teletact {

namespace {

using Level = DoctorCheck::Level;

const char* level_name(Level level) {
  return level == Level::kFine ? "fine" : level == Level::kAdvice ? "advice" : "unfit";
}

void print(const std::vector<DoctorCheck>& checks) {
  for (const auto& c : checks) {
    std::printf("[%-6s] %-28s %s\n", level_name(c.level), c.title.c_str(), c.state.c_str());
    if (c.level == Level::kFine) continue;
    std::printf("           why: %s\n            do: %s\n", c.why.c_str(), c.todo.c_str());
  }
  int advice = 0, unfit = 0;
  for (const auto& c : checks) {
    advice += c.level == Level::kAdvice;
    unfit += c.level == Level::kUnfit;
  }
  if (unfit > 0) {
    std::printf("\nnot fit for real-time use: %d must be changed, %d should be\n", unfit, advice);
  } else if (advice > 0) {
    std::printf("\nusable; %d things would make it better\n", advice);
  } else {
    std::printf("\nfit for real-time use\n");
  }
}

// What the demo says when it chooses its clock.
void print(const Rights& rights) {
  if (rights.enough()) {
    std::printf("a demo here runs in real time\n");
  } else {
    std::printf("a demo here is not real-time, timing not measured: %s; to change it: %s\n",
                rights.why().c_str(), rights.command.c_str());
  }
}

std::string json_text(const std::vector<DoctorCheck>& checks) {
  Metrics metrics("doctor");
  metrics.add("doctor.verdict", static_cast<double>(doctor_verdict(checks)), "level");
  for (const auto& c : checks) {
    metrics.add("doctor." + c.id, static_cast<double>(c.level), "level");
  }
  auto out = nlohmann::ordered_json::parse(metrics.json());
  auto& list = out["checks"] = nlohmann::ordered_json::array();
  for (const auto& c : checks) {
    list.push_back({{"id", c.id},
                    {"title", c.title},
                    {"level", level_name(c.level)},
                    {"state", c.state},
                    {"why", c.why},
                    {"do", c.todo}});
  }
  return out.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n";
}

}  // namespace

int cmd_doctor(int argc, char** argv) {
  std::string json, root;
  bool rights_only = false;
  CLI::App app(
      "Checks this machine for real-time use, and says for each finding what to do. Exit "
      "code 0: fine, 1: advice, 2: unfit.",
      "teletact doctor");
  app.add_option("--json", json, "write the findings to this file");
  app.add_option("--root", root, "read proc/, sys/ and dev/ below this folder instead");
  app.add_flag(
      "--rights", rights_only,
      "only whether a demo here runs in real time: exit code 0, or 1 and what gives the right");
  if (!parse_options(app, argc, argv)) return 0;
  check_outputs({{"--json", json}}, {});
  if (!root.empty() && !std::filesystem::is_directory(root)) {
    throw std::runtime_error(root + ": is not a folder");
  }
  const Rights rights = find_rights(root);
  if (rights_only) {
    print(rights);
    return rights.enough() ? 0 : 1;
  }
  const auto checks = run_doctor(root);
  print(checks);
  print(rights);
  if (!json.empty()) write_whole_file(json, json_text(checks));
  return static_cast<int>(doctor_verdict(checks));
}

}  // namespace teletact
