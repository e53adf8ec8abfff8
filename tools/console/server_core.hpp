// The inside of a ConsoleServer: what its connections share. Everything but the inbox, the
// snapshot of
// people and the tally is the server thread's alone.
#pragma once

#include <array>
#include <atomic>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/ssl/context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <deque>
#include <list>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "tools/console/console_mesh.hpp"
#include "tools/console/console_server.hpp"
#include "tools/console/console_sessions.hpp"
#include "tools/console/page_files.hpp"
#include "tools/console/web_rules.hpp"
#include "tools/console/web_trust.hpp"

namespace teletact {

class HttpConnection;
class WsViewer;
struct IntentEnvelope;

// Counters that any thread may read.
struct ConsoleTally {
  using Count = std::atomic<std::uint64_t>;
  Count views_sent{0}, views_replaced{0}, views_refused{0}, bytes_sent{0}, acts{0}, stops{0},
      connections{0}, sessions{0}, reconnects{0};
  std::array<Count, kRefusals> refused{};
  std::atomic<std::int64_t> cpu_ns{0};
  void refuse(Refusal r) noexcept { ++refused[static_cast<std::size_t>(r)]; }
};

// What other threads have left for the server's. Bounded: of each view the newest.
struct ConsoleInbox {
  struct Directed {
    std::uint32_t session;
    ViewKind kind;
    ViewBytes view;
  };
  static constexpr std::size_t kMostAnswers = 4096, kMostDirected = 64;
  std::mutex mutex;
  std::array<ViewBytes, kViewKinds> newest;
  std::vector<Directed> directed;
  std::deque<Directed> answers;
  bool posted = false;
  std::array<std::uint32_t, kViewKinds> sequence{};
};

class ServerCore {
 public:
  ServerCore(const ConsoleOptions& options, ConsoleCallbacks callbacks, PageFiles page);
  // Empty, or what is wrong.
  [[nodiscard]] std::string listen(const boost::asio::ip::address& address,
                                   const std::vector<std::string>& names,
                                   const std::optional<PublicAddress>& known);
  void run();        // the thread
  void shut_down();  // on the thread; it ends soon after

  // By connections.
  [[nodiscard]] bool viewer_place(std::uint32_t session) const noexcept;
  void viewer_up(const std::shared_ptr<WsViewer>& viewer);
  void viewer_down(const WsViewer& viewer);
  // What still stands of a session that is no more.
  void close_viewers_of(std::uint32_t session);
  void connection_down(const HttpConnection& connection);
  void act(WsViewer& viewer, std::string_view text);
  void stop_asked(std::uint32_t session);
  // After whatever may have changed who may do what.
  void tell_roles();
  [[nodiscard]] ConsoleSecret fresh_secret() const;
  [[nodiscard]] ViewBytes answer_view(std::int64_t id, const ConsoleAnswer& answer);

  // From other threads.
  void wake(std::unique_lock<std::mutex> held);
  void drain_inbox();

  const ConsoleOptions options;
  const ConsoleCallbacks callbacks;
  boost::asio::io_context io{1};
  ConsoleTally tally;
  ConsoleSessions sessions;
  PageFiles page;
  std::unique_ptr<WebTrust> trust;
  std::unique_ptr<boost::asio::ssl::context> tls;
  std::unique_ptr<WebNames> names;
  RateWindow<20> code_rate;
  std::string cookie_name;
  int port = 0;

  std::mutex mesh_mutex;
  ConsoleMesh mesh;
  std::atomic<bool> wants_mesh{false};
  std::atomic<int> viewer_count{0};
  ConsoleInbox inbox;
  std::mutex shared_mutex;  // of the two below
  std::vector<ConsolePerson> people;
  std::function<double()> clock_s;

 private:
  void accept();
  void admit(boost::asio::ip::tcp::socket socket);
  void tick();
  void look_at_list();
  [[nodiscard]] std::optional<ConsoleAnswer> do_act(WsViewer& viewer, const IntentEnvelope& e);
  [[nodiscard]] std::optional<ConsoleAnswer> ask_callback(const ConsoleAct& act);
  void reset_mesh();

  boost::asio::ip::tcp::acceptor acceptor_{io};
  boost::asio::steady_timer tick_timer_{io}, accept_timer_{io};
  std::vector<std::shared_ptr<WsViewer>> viewers_;
  std::list<std::shared_ptr<HttpConnection>> connections_;  // oldest first
  bool ending_ = false;
  int ticks_ = 0;
};

}  // namespace teletact
