// The words --console, --open and what goes with them, of `teletact demo` and `teletact operator`.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "tools/desk/page_desk.hpp"
#include "tools/host/run_options.hpp"

namespace CLI {
class App;
}

namespace teletact {

struct ConsoleWords {
  bool console = false, open = false;
  int port = 0;
  std::string address = "127.0.0.1", keys;  // not loopback: HTTPS with this folder of keys
  std::vector<std::string> names;           // by which browsers reach this box
  std::string public_url;                   // where they find it through a tunnel or a proxy
  std::string page;  // folder of the built page; empty: beside the program, or in the source tree
  std::string session;  // a saved one to go on with: its name, or its folder; empty: none
};

void add_console_options(CLI::App& app, ConsoleWords& words);
// Before the scene is read: a page wants the mesh; a saved session names the scene and its map, and
// is refused with a line beside a scene on the command line.
void prepare_console(const ConsoleWords& words, bool scene_given, std::string& scene_name,
                     DemoOptions& options);
// Null: nobody asked for one. Changes the scene: no script moves the hand. Throws
// std::runtime_error where the page is not there, or its server would not start.
[[nodiscard]] std::unique_ptr<PageDesk> console_of(const ConsoleWords& words, Scene& scene,
                                                   const DemoOptions& options);

}  // namespace teletact
