// A whole run with a browser's place taken by a WebSocket client: code, session, views, an object
// by a click, a goal by click, the stop. Simulated time, paced by the real clock.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <boost/asio/connect.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <chrono>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <future>
#include <map>
#include <nlohmann/json.hpp>
#include <thread>

#include "tools/desk/page_desk.hpp"
#include "tools/host/calibrate.hpp"
#include "tools/host/run_options.hpp"

namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = boost::beast::http;
namespace fs = std::filesystem;
using nlohmann::json;
using tcp = asio::ip::tcp;

// What a page does, in one thread: writes, and reads what has come.
class Page {
 public:
  explicit Page(const std::string& url) {
    // http://127.0.0.1:PORT/#code=CODE
    const auto host_at = url.find("//") + 2, path_at = url.find('/', host_at);
    host_ = url.substr(host_at, path_at - host_at);
    code_ = url.substr(url.find("code=") + 5);
    port_ = static_cast<std::uint16_t>(std::stoi(host_.substr(host_.find(':') + 1)));
  }

  http::response<http::string_body> post(const std::string& path, const std::string& body) {
    beast::tcp_stream stream(io_);
    stream.connect(tcp::endpoint(asio::ip::make_address("127.0.0.1"), port_));
    http::request<http::string_body> r{http::verb::post, path, 11};
    r.set(http::field::host, host_);
    r.set(http::field::origin, "http://" + host_);
    r.set(http::field::content_type, "application/json");
    if (!cookie_.empty()) r.set(http::field::cookie, cookie_);
    r.body() = body;
    r.prepare_payload();
    http::write(stream, r);
    beast::flat_buffer buffer;
    http::response<http::string_body> answer;
    http::read(stream, buffer, answer);
    return answer;
  }

  int enter() {
    const auto answer = post("/session", json{{"code", code_}}.dump());
    const std::string set(answer[http::field::set_cookie]);
    cookie_ = set.substr(0, set.find(';'));
    return static_cast<int>(answer.result_int());
  }

  void connect() {
    ws_.next_layer().connect(tcp::endpoint(asio::ip::make_address("127.0.0.1"), port_));
    ws_.set_option(beast::websocket::stream_base::decorator([this](auto& r) {
      r.set(http::field::origin, "http://" + host_);
      r.set(http::field::cookie, cookie_);
      r.set(http::field::sec_websocket_protocol, "teletact.1");
    }));
    ws_.handshake(host_, "/ws");
    ws_.text(true);
  }

  std::int64_t say(json intent) {
    intent["id"] = ++id_;
    ws_.write(asio::buffer(intent.dump()));
    return id_;
  }

  // Until `there` says so, at most so long; tokens go on, also between the views of a long queue.
  bool until(const std::function<bool()>& there, std::chrono::seconds most) {
    const auto end = std::chrono::steady_clock::now() + most;
    while (std::chrono::steady_clock::now() < end) {
      send_token();
      while (ws_.next_layer().socket().available() > 0) {
        take();
        send_token();
      }
      if (there()) return true;
      std::this_thread::sleep_for(std::chrono::milliseconds{5});
    }
    return false;
  }

  // A new press of what is held until it is let go. Returns the act's id.
  std::int64_t press(const char* hold) {
    holds = json::array();
    say({{"act", "token"}, {"holds", holds}});
    holds.push_back(hold);
    say({{"act", "token"}, {"holds", holds}});
    return say({{"act", hold}});
  }

  json text;  // newest slow state
  json holds;
  std::map<std::int64_t, json> answers;
  std::map<int, int> views;

 private:
  void send_token() {
    if (holds.is_null() || std::chrono::steady_clock::now() < token_due_) return;
    token_due_ = std::chrono::steady_clock::now() + std::chrono::milliseconds{50};
    say({{"act", "token"}, {"holds", holds}});
  }
  void take() {
    beast::flat_buffer buffer;
    ws_.read(buffer);
    const auto* bytes = static_cast<const char*>(buffer.data().data());
    if (buffer.size() < 24) return;
    const int kind = static_cast<unsigned char>(bytes[0]);
    ++views[kind];
    const std::string body(bytes + 24, buffer.size() - 24);
    if (kind == 1) text = json::parse(body);
    if (kind == 7) {
      const json a = json::parse(body);
      answers[a["id"]] = a;
    }
  }
  asio::io_context io_;
  beast::websocket::stream<beast::tcp_stream> ws_{io_};
  std::string host_, code_, cookie_;
  std::uint16_t port_ = 0;
  std::int64_t id_ = 0;
  std::chrono::steady_clock::time_point token_due_{};
};

fs::path page_folder() {
  const fs::path folder = fs::temp_directory_path() / ("teletact_page_" + std::to_string(getpid()));
  fs::create_directories(folder);
  std::ofstream(folder / "index.html") << "<!doctype html><title>t</title>";
  return folder;
}

std::string state(const Page& p, const char* key) {
  return p.text.is_object() ? p.text.value(key, "") : std::string();
}

// Engages and sends the robot to a place until it has arrived there. Where this machine is too busy
// for a token within 200 ms the box lets go, rightly, and drops the goal: as a person, the test then
// presses and asks again.
void drive_to(Page& p, double x, double y) {
  using namespace std::chrono_literals;
  bool arrived = false;
  for (int press = 0; press < 40 && !arrived; ++press) {
    const auto engage = p.press("engage");
    ASSERT_TRUE(p.until([&] { return p.answers.count(engage) > 0; }, 60s));
    if (!p.answers[engage]["ok"]) continue;
    const auto goal = p.say({{"act", "go_to"}, {"x", x}, {"y", y}});
    ASSERT_TRUE(p.until([&] { return p.answers.count(goal) > 0; }, 60s));
    bool engaged = false;
    const bool told = p.until(
        [&] {
          arrived = state(p, "phase") == "arrived";
          const bool was = engaged;
          engaged = state(p, "mode") == "engaged";
          return arrived || (was && !engaged);
        },
        180s);
    if (!told) break;
    std::printf("press %d: %s\n", press + 1, arrived ? "arrived" : "let go by the box");
  }
  EXPECT_TRUE(arrived) << p.text;
}

TEST(DeskPage, APersonAtABrowserDrivesTheRobotToAPlace) {
  using namespace std::chrono_literals;
  constexpr double kX = 1.43, kY = 0.70;
  const fs::path folder = page_folder();
  std::promise<std::string> told;
  teletact::PageOptions o;
  o.server.page_folder = folder.string();
  o.quiet = true;
  o.tell = [&](const std::string& url) { told.set_value(url); };
  teletact::PageDesk desk(std::move(o));
  auto scene = teletact::load_scene(teletact::find_config("scenes", "default_room"),
                                    {"fusion.mesh_blocks=100"});
  scene->hand.start_after_s = 3600;
  teletact::DemoOptions options;
  options.seconds = 300;
  options.virtual_clock = options.quiet = options.paced = true;
  options.cores = 2;
  options.page = &desk;
  teletact::VirtualRun run;
  std::thread box([&] {
    rt::Startup startup;
    run =
        teletact::run_virtual(startup.token(), *scene, options, teletact::reference_calibration());
  });
  auto url = told.get_future();
  [&] {
    ASSERT_EQ(url.wait_for(60s), std::future_status::ready);
    Page p(url.get());
    ASSERT_EQ(p.enter(), 200);
    p.connect();
    p.holds = json::array({"engage"});
    ASSERT_TRUE(p.until([&] { return state(p, "mode") == "hold" && p.views[5] > 0; }, 120s));
    EXPECT_EQ(p.text["role"], "operator");
    const auto echo = p.say({{"act", "token"}, {"holds", {"engage"}}, {"t", 12.5}});
    ASSERT_TRUE(p.until([&] { return p.answers.count(echo) > 0; }, 60s));
    EXPECT_EQ(p.answers[echo]["result"]["t"], 12.5);
    // The bin, as the camera sees it from the start.
    const auto select =
        p.say({{"act", "select"}, {"u", 0.577}, {"v", 0.235}, {"sign", 1}, {"new", true}});
    ASSERT_TRUE(p.until([&] { return p.answers.count(select) > 0; }, 60s));
    EXPECT_TRUE(p.answers[select]["ok"]) << p.answers[select];
    EXPECT_GT(p.answers[select]["result"]["pixels"], 500);
    EXPECT_TRUE(p.until([&] { return p.views[8] == 1; }, 60s)) << "what is proposed is shown";
    const auto wrong = p.say({{"act", "go_to"}, {"x", "there"}, {"y", kY}});
    ASSERT_TRUE(p.until([&] { return p.answers.count(wrong) > 0; }, 60s));
    EXPECT_FALSE(p.answers[wrong]["ok"]);
    drive_to(p, kX, kY);
    if (HasFatalFailure()) return;
    for (const int kind : {1, 2, 3, 4, 5}) EXPECT_GT(p.views[kind], 0) << kind;
    EXPECT_EQ(p.post("/stop", "{}").result_int(), 200U);
    EXPECT_TRUE(p.until([&] { return state(p, "mode") == "hold"; }, 60s)) << p.text;
  }();
  teletact::g_stop_requested.store(true);
  box.join();
  teletact::g_stop_requested.store(false);
  fs::remove_all(folder);
  ASSERT_FALSE(run.robot.view.truth.empty());
  const auto& end = run.robot.view.truth.back();
  EXPECT_LT(std::hypot(end.x_m - kX, end.y_m - kY), 0.10);
}

}  // namespace
