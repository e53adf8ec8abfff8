// The operator's console as a web server: the page's files, sessions, views out, acts in.
//
// One ordinary thread of its own does all the work; nothing here may be called from a real-time
// task. publish(), send_to(), answer() and the getters may be called from any ordinary thread: they
// take a lock for a copy of a pointer and never wait for a viewer. Callbacks come on the server's
// thread, one at a time, and must return at once (a few ms); they may call publish(), send_to(),
// answer() and the getters, not stop().
//
// Memory: at most options.most_viewers viewers, each with one waiting view a kind (the newest), a
// place in the mesh, and 256 KiB of answers; at most options.most_connections connections. A viewer
// that does not read for options.write_limit is closed.
//
// Wire: docs/console_protocol.md. Rules, limits, what was rejected: docs/console_server.md.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "rt/clock/box_time.hpp"
#include "rt/result.hpp"
#include "rt/time.hpp"
#include "tools/console/console_counts.hpp"
#include "tools/console/console_views.hpp"

namespace perception {
struct MeshDelta;
}

namespace teletact {

struct ConsoleOptions {
  std::string page_folder;            // the built page: index.html and what it names
  std::string address = "127.0.0.1";  // numeric. Not loopback: `keys` is needed
  int port = 0;                       // 0: the kernel chooses
  // Host names by which browsers may address this server, without the port. Of loopback they are
  // known (127.0.0.1, localhost, ::1); the address itself is always one.
  std::vector<std::string> names;
  // Where browsers find it through a tunnel or a proxy, besides; empty: nowhere else. See
  // public_address.hpp. It is what is printed then.
  std::string public_url;
  // Folder with web.key, web.crt, ca.crt, ca.crl, as `teletact keys web` writes it. Empty: plain
  // HTTP.
  std::string keys;

  std::size_t most_viewers = 8;
  std::size_t most_connections = 64;
  rt::Nanos request_limit =
      std::chrono::seconds{10};  // from connecting, or the last answer, to a whole request
  rt::Nanos write_limit = std::chrono::seconds{10};    // for one message to leave
  rt::Nanos silence_limit = std::chrono::seconds{20};  // nothing heard, not even a pong
  rt::Nanos code_life = std::chrono::hours{1};         // of a one-time code that is not used
  rt::Nanos session_life = std::chrono::hours{12};     // without a connection
  rt::Nanos absence_limit =
      std::chrono::seconds{3};                       // operator gone so long: another may take over
  rt::Nanos asked_limit = std::chrono::seconds{10};  // asked so long ago, unanswered: same
  // By which the line to a page is measured (bulk_window.hpp), ns.
  std::function<std::int64_t()> line_clock = &rt::monotonic_ns;
};

// One intent whose envelope is sound: size, JSON, keys `id` and `act`, rate, role. What it means,
// and each other key, is for the callback to check.
struct ConsoleAct {
  ConsolePerson from;
  std::int64_t id = 0;
  std::string_view act;
  const nlohmann::json& intent;  // the whole object
};

struct ConsoleAnswer {
  bool ok = false;
  std::string why;     // of a refusal: one line for a person
  std::string result;  // JSON text; empty: none
};

struct ConsoleCallbacks {
  // Not for `stop`, `ask_role`, `give_role`, `take_role`, which the server does and answers. Empty:
  // answer() is called later, or this act (token, hand, drive) is not answered.
  std::function<std::optional<ConsoleAnswer>(const ConsoleAct&)> on_act;
  // By POST /stop or the act `stop`, from any role, before whatever waits. Called each time.
  std::function<void(const ConsolePerson&)> on_stop;
  std::function<void(const RoleEvent&)> on_role;
  std::function<void()> on_thread;  // first thing on the server's thread: to place it on a core
};

class ConsoleServer {
 public:
  // Empty, or the line with which start() would refuse now: for whoever has long work before it.
  // The port is tried and let go again.
  [[nodiscard]] static std::string problem(const ConsoleOptions& options);
  // Listens and starts the thread. One line says what is wrong: folder, address, keys.
  [[nodiscard]] static rt::Result<std::unique_ptr<ConsoleServer>> start(
      const ConsoleOptions& options, ConsoleCallbacks callbacks);
  ~ConsoleServer();  // stop()
  ConsoleServer(const ConsoleServer&) = delete;
  ConsoleServer& operator=(const ConsoleServer&) = delete;
  // Closes all with 1001 and ends the thread, within a second.
  void stop();

  [[nodiscard]] int port() const noexcept;
  // With a new one-time code that makes an operator: not for a log. The newest 4 are good.
  [[nodiscard]] std::string url();
  // The same without a code.
  [[nodiscard]] std::string address() const;

  // How many WebSockets stand. 0: whatever is published is thrown away at once; make nothing.
  [[nodiscard]] int viewers() const noexcept;
  [[nodiscard]] std::vector<ConsolePerson> people() const;

  // To every viewer; a newer view of a kind replaces one that still waits. False: nobody there, or
  // longer than kMostViewBytes (counted). Not for kMesh.
  bool publish(ViewKind kind, const ViewStamp& stamp, std::span<const std::uint8_t> body);
  bool publish(ViewKind kind, const ViewStamp& stamp, std::string_view body);
  // To one session: kText where it differs by session, kSelection. Newest wins.
  bool send_to(std::uint32_t session, ViewKind kind, const ViewStamp& stamp,
               std::span<const std::uint8_t> body);
  // To an act that on_act left open. None is lost: a session that does not read them is closed.
  void answer(std::uint32_t session, std::int64_t id, const ConsoleAnswer& answer);
  // "Now" for the heads of what the server itself makes (answers). Empty: 0.
  void set_clock(std::function<double()> now_s);

  // The mesh. The server keeps all blocks; each viewer gets what it has not seen. True until a
  // delta with `restart` comes: the first viewer after a time with none needs the whole mesh, and
  // deltas before it are thrown away (perception::MeshSender::restart()).
  [[nodiscard]] bool wants_whole_mesh() const noexcept;
  bool publish_mesh(const perception::MeshDelta& delta, const ViewStamp& stamp,
                    double block_edge_m);

  [[nodiscard]] ConsoleCounts counts() const;

 private:
  class Impl;
  [[nodiscard]] static rt::Result<std::unique_ptr<Impl>> prepare(const ConsoleOptions& options,
                                                                 ConsoleCallbacks callbacks);
  explicit ConsoleServer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace teletact
