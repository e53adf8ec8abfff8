// A browser's place taken by a WebSocket client: the code, the session, views read and thrown away,
// acts at exact instants. One thread writes, and reads what has come whenever it waits.
#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace teletact {

class PageClient {
 public:
  // http://127.0.0.1:PORT/#code=CODE. Enters and connects; throws std::runtime_error with one line.
  explicit PageClient(const std::string& url);
  ~PageClient();
  PageClient(const PageClient&) = delete;
  PageClient& operator=(const PageClient&) = delete;

  // The WebSocket alone; the session stays, and goes on with come_back().
  void leave();
  void come_back();
  // Number of the act.
  std::int64_t say(nlohmann::json intent);
  // POST /stop, on a connection of its own. False: it was not taken.
  bool post_stop();
  // Tokens and what is driven go on meanwhile, and what comes is read.
  void run(std::chrono::milliseconds how_long);
  // Until this act is answered; false: not within `most`.
  bool answered(std::int64_t id, std::chrono::milliseconds most);
  // As many notes a second as `rate`, spread evenly.
  void hammer(std::chrono::milliseconds how_long, int rate);

  std::vector<std::string> holds;  // said 20 times a second, with `driven`
  nlohmann::json driven;           // null: nothing
  std::map<std::int64_t, nlohmann::json> answers;
  std::string mode;           // newest, of the view `text`
  std::uint64_t said = 0;     // notes
  std::uint64_t refused = 0;  // answers that tell of too much at once
  std::uint64_t views = 0, bytes = 0;

 private:
  struct Wire;
  void take_all();
  void take(const char* data, std::size_t size);
  void tokens();
  std::unique_ptr<Wire> wire_;
  std::int64_t id_ = 0;
  bool held_ = false;
  std::chrono::steady_clock::time_point token_due_{};
};

}  // namespace teletact
