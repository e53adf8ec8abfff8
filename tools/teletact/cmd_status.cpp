// teletact status: what the boxes that this user runs on this machine say of themselves.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <stdexcept>
#include <vector>

#include "tools/box/box_status.hpp"
#include "tools/cli/options.hpp"
#include "tools/teletact/commands.hpp"

namespace teletact {

int cmd_status(int argc, char** argv) {
  CLI::App app{"Prints the state of a box that runs (teletact robot, teletact operator)."};
  std::string box;
  bool json = false;
  app.add_option("--box", box, "which; default: each that runs")
      ->check(CLI::IsMember({"robot", "operator"}));
  app.add_flag("--json", json, "as JSON, one object a box");
  if (!parse_options(app, argc, argv)) return 0;
  const std::vector<std::string> boxes =
      box.empty() ? std::vector<std::string>{"robot", "operator"} : std::vector<std::string>{box};
  int found = 0;
  std::string last;
  for (const auto& name : boxes) {
    const auto path = status_socket(name);
    if (!path) throw std::runtime_error(path.error());
    const auto answer = ask_status(path.value());
    if (!answer) {
      last = answer.error();
      continue;
    }
    const auto text = json ? answer : status_text(answer.value());
    if (!text) throw std::runtime_error(path.value() + ": " + text.error());
    std::printf("%s%s", found++ > 0 && !json ? "\n" : "", text.value().c_str());
  }
  if (found > 0) return 0;
  std::fprintf(stderr, "teletact status: %s\n",
               box.empty() ? "no box of this user runs on this machine" : last.c_str());
  return 1;
}

}  // namespace teletact
