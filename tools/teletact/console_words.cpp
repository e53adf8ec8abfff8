#include "tools/teletact/console_words.hpp"

#include <unistd.h>

#include <CLI/CLI.hpp>
#include <array>
#include <climits>
#include <filesystem>
#include <stdexcept>

namespace teletact {

namespace {

namespace fs = std::filesystem;

fs::path program_folder() {
  char self[PATH_MAX] = {};
  const ssize_t n = ::readlink("/proc/self/exe", self, sizeof self - 1);
  return n > 0 ? fs::path(std::string(self, static_cast<std::size_t>(n))).parent_path()
               : fs::path(".");
}

std::string page_folder(const std::string& given) {
  if (!given.empty()) {
    if (!fs::exists(fs::path(given) / "index.html"))
      throw std::runtime_error("--page " + given + ": holds no index.html");
    return given;
  }
  const fs::path program = program_folder();
  // Beside the program in a build tree; installed, in the prefix.
  const std::array<fs::path, 2> places{program / "share/teletact/console",
                                       program / "../share/teletact/console"};
  for (const auto& p : places)
    if (fs::exists(p / "index.html")) return fs::canonical(p).string();
  throw std::runtime_error(
      "--console: the page is not built; tools/run builds it, and --page names another folder");
}

// NAME among this user's sessions, or a folder by its path.
fs::path session_folder(const std::string& word) {
  const bool path = word.find('/') != std::string::npos;
  const fs::path folder =
      path ? fs::absolute(word).lexically_normal() : fs::path(default_session_folder()) / word;
  return folder.has_filename() ? folder : folder.parent_path();
}

std::string quoted(const std::string& text) {
  std::string out = "\"";
  for (const char c : text) out += c == '"' || c == '\\' ? std::string{'\\', c} : std::string{c};
  return out + "\"";
}

}  // namespace

void add_console_options(CLI::App& app, ConsoleWords& w) {
  auto* console = app.add_flag(
      "--console", w.console,
      "serve the operator's page: see the scene, drive, mark, draw; its address is printed once");
  app.add_flag("--open", w.open, "open the page in this desktop's browser")->needs(console);
  app.add_option("--console-port", w.port, "port of the page; 0: the kernel chooses")
      ->check(CLI::Range(0, 65535))
      ->needs(console);
  auto* keys = app.add_option("--console-keys", w.keys,
                              "folder of `teletact keys web`: HTTPS, for browsers that show a "
                              "certificate of `teletact keys browser`");
  keys->needs(console);
  app.add_option("--console-address", w.address,
                 "numeric address of the page's server; not loopback: with --console-keys")
      ->needs(console);
  app.add_option("--console-name", w.names, "name by which browsers reach this box; repeatable")
      ->needs(console);
  app.add_option("--console-public", w.public_url,
                 "address at which browsers find the page through a tunnel or a proxy: "
                 "https://NAME/PATH/, or http://localhost:PORT/")
      ->needs(console);
  app.add_option("--page", w.page, "folder of the built page")->needs(console);
  app.add_option("--session", w.session,
                 "go on with a session that was saved at the page: its scene, settings, map, "
                 "keep-outs, marks and objects; a name, or a folder by its path")
      ->needs(console);
}

void prepare_console(const ConsoleWords& w, bool scene_given, std::string& scene_name,
                     DemoOptions& o) {
  if (!w.console) return;
  if (!w.session.empty()) {
    if (scene_given) throw std::runtime_error("--session names the scene: leave --scene out");
    const fs::path folder = session_folder(w.session);
    const fs::path map = folder / SessionStore::kMap;
    if (!fs::exists(folder / SessionStore::kSession))
      throw std::runtime_error("--session " + w.session + ": there is none in " +
                               folder.parent_path().string());
    if (!fs::exists(map))
      throw std::runtime_error(
          "--session " + w.session +
          ": its map is missing; the run that saved it has not ended by itself");
    scene_name = (folder / SessionStore::kScene).string();
    o.overrides.insert(o.overrides.begin(), "fusion.map=" + quoted(map.string()));
  }
  // Where the scene, or the command, says nothing else: later words win.
  // A page's hand goes everywhere: beyond a device's reach the workspace follows it.
  // Without an object, following objects costs a comparison a frame.
  const std::vector<std::string> wanted = {"fusion.mesh_blocks=100", "fusion.objects.enabled=true",
                                           "haptic.border_m=0.065", "haptic.border_rate_per_s=20"};
  o.overrides.insert(o.overrides.begin(), wanted.begin(), wanted.end());
}

namespace {

void take_session(const ConsoleWords& w, SessionPlace& place) {
  place.folder = default_session_folder();
  if (w.session.empty()) return;
  const fs::path folder = session_folder(w.session);
  place.folder = folder.parent_path().string();
  auto session = SessionStore(place.folder).read(folder.filename().string());
  if (!session) throw std::runtime_error("--session: " + session.error());
  place.world = session.value().world;
  place.at_start = std::move(session).value();
}

}  // namespace

std::unique_ptr<PageDesk> console_of(const ConsoleWords& w, Scene& scene, const DemoOptions& o) {
  if (!w.console) return nullptr;
  constexpr double kNever_s = 864000;  // as long as a run may be: the scene can be read again
  scene.hand.start_after_s = kNever_s;
  PageOptions page;
  page.server.page_folder = page_folder(w.page);
  page.server.port = w.port;
  page.server.address = w.address;
  page.server.keys = w.keys;
  page.server.names = w.names;
  page.server.public_url = w.public_url;
  // Said now: a calibration may come before the server starts.
  if (const std::string why = ConsoleServer::problem(page.server); !why.empty())
    throw std::runtime_error("--console: " + why);
  page.desk.device = scene.choice.kind;
  page.desk.log = o.report + "/raw/console.log";
  page.figures = o.report + "/raw/console.json";
  page.hand = scene.choice.in_process();
  take_session(w, page.desk.sessions);
  page.open_browser = w.open;
  return std::make_unique<PageDesk>(std::move(page));
}

}  // namespace teletact
