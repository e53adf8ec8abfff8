// The inside of a Road: sockets that are being made, the session, and what is due when.
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/ssl.hpp>
#include <list>
#include <memory>
#include <string>
#include <vector>

#include "drivers/road/arrivals.hpp"
#include "drivers/road/door.hpp"
#include "drivers/road/pace.hpp"
#include "drivers/road/road.hpp"
#include "drivers/road/road_connection.hpp"
#include "drivers/road/road_names.hpp"
#include "drivers/road/trust.hpp"

namespace drivers {

class Road::Impl final : public RoadConnectionOwner {
 public:
  Impl(const RoadOptions& options, const Caps& caps, std::unique_ptr<RoadTrust> trust);
  ~Impl() override;
  [[nodiscard]] std::string listen();  // empty: it does

  void run_for(rt::Nanos span);
  void close_session(const std::string& why, RoadDoor::End end, bool gently = true);
  [[nodiscard]] rt::Nanos bulk_busy_for() const noexcept;
  void send(bool bulk, std::span<const std::uint8_t> message, bool at_once);

  RoadOptions options;
  Handlers handlers;
  RoadCounts counts;
  RoadPeer last_peer;
  std::string last_end, last_refusal, last_congestion, last_address;
  std::unique_ptr<RoadTrust> trust;
  RoadPace pace;
  std::shared_ptr<RoadConnection> control, bulk;
  bool up = false, end_expected = false;
  int port = 0;

 private:
  using Tcp = boost::asio::ip::tcp;
  using Code = boost::system::error_code;
  using Shared = std::shared_ptr<RoadConnection>;
  struct Arrival {
    Shared connection;
    std::int64_t until_ns;
  };
  struct Waiting {
    Tcp::socket socket;
    std::string address, place;
    std::int64_t until_ns;
  };

  struct Doorstep {
    // Taken from the kernel: so many that one host's connecting costs little CPU, and so that
    // nobody waits in the kernel's queue behind it.
    static constexpr double kAcceptsPerSecond = 2000, kAcceptsAtOnce = 200;
    static constexpr int kBacklog = 256;
    ArrivalTurns turns;
    ArrivalRate accept_rate{kAcceptsPerSecond, kAcceptsAtOnce};
    bool accepting = false;
    std::list<Waiting> waiting;   // connected, and their handshake has not begun
    std::list<Arrival> arrivals;  // in it, or not yet let in; oldest first
    std::list<Arrival> leaving;   // their last words are on the way
  };

  void connection_shaken(RoadConnection& c) override;
  bool connection_frame(RoadConnection& c, RoadKind kind,
                        std::span<const std::uint8_t> body) override;
  void connection_closed(RoadConnection& c, const std::string& why) override;

  // road_listen.cpp
  void accept_one();
  void arrived(Tcp::socket socket);
  void drop_waiting();
  void give_turns(std::int64_t now_ns);
  [[nodiscard]] std::vector<std::string> waiting_places() const;
  void make_room();
  void begin(Waiting stranger);
  [[nodiscard]] bool greeted(RoadConnection& c, const RoadGreet& greet);
  void refuse(RoadConnection& c, const std::string& why);
  [[nodiscard]] Shared take_arrival(RoadConnection& c);
  void drop_late_arrivals(std::int64_t now_ns);
  void drop_revoked_arrivals();
  // road_dial.cpp
  void dial_if_due(std::int64_t now_ns);
  void dial(bool for_bulk);
  void look_at_names();
  void connect(const std::vector<std::string>& addresses, bool for_bulk);
  [[nodiscard]] bool answered(RoadConnection& c, RoadKind kind, std::span<const std::uint8_t> body);
  void dial_failed(const std::string& why);
  // road.cpp
  void session_up();
  void drop_connections(bool gently, RoadDoor::End end);
  void leave_slowly(Shared connection);
  void tick(std::int64_t now_ns);
  void look_at_list(std::int64_t now_ns);
  void drop_revoked();
  void look_at_pace(std::int64_t now_ns);
  void make_context();

  Caps caps_;
  RoadDoor door_;
  boost::asio::io_context io_;
  std::unique_ptr<boost::asio::ssl::context> context_;
  boost::asio::executor_work_guard<boost::asio::io_context::executor_type> work_;
  Tcp::acceptor acceptor_;
  Doorstep doorstep_;
  // Dialling.
  RoadNames names_;
  enum class Naming : std::uint8_t { kNot, kControl, kBulk } naming_ = Naming::kNot;
  std::shared_ptr<Tcp::socket> trying_;
  bool dialling_ = false;
  RoadToken token_{};
  rt::Nanos backoff_;
  std::int64_t next_dial_ns_ = 0, dial_until_ns_ = 0;
  std::int64_t up_ns_ = 0, heard_ns_ = 0, next_list_ns_ = 0, next_pace_ns_ = 0;
  std::int64_t next_anew_ns_ = 0;
};

}  // namespace drivers
