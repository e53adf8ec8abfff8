// The link over a network: TLS 1.3 with certificates on both sides, two TCP connections (small
// messages, images), one ordinary thread. A *lasting* transport: it listens or dials again after
// each
// end, and renews the endpoint for each session, so a box may start, stop and crash at any time.
// Engagement is no matter of the transport: sessions() tells that the road was another one.
//
// Small messages go together, each 20 ms: a packet that is lost holds up all behind it for a round
// trip and more, so there are to be few.
//
// What the operator's box says goes both ways, on control and on bulk, where it has no images: what
// one connection holds up the other one brings. The robot's end takes what comes first; a copy, and
// what is older than what came, it drops, and counts as nothing heard.
//
// Security: docs/security.md. Send rules: docs/link.md, Road.
#pragma once

#include <array>
#include <atomic>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "drivers/link/link_transport.hpp"
#include "drivers/road/road_options.hpp"
#include "rt/result.hpp"

namespace drivers {

class Road;

class RoadLink final : public LinkTransport {
 public:
  // One line names what is wrong: address, port, a file of the keys.
  [[nodiscard]] static rt::Result<std::unique_ptr<RoadLink>> open(const RoadOptions& options);
  // What open() would refuse but for the port: address, options, files of the keys. Nothing stays
  // open.
  [[nodiscard]] static rt::Result<bool> check(const RoadOptions& options);
  ~RoadLink() override;

  [[nodiscard]] int port() const noexcept;  // where it listens, or what it dials
  // As the interface says; `shape` delays what is sent, like a network would.
  void start(LinkEndpoint& endpoint, std::function<rt::Time()> now,
             const std::optional<LinkShapeConfig>& shape,
             std::function<void()> after_poll = {}) override;
  void stop() override;
  void cut() noexcept override { cut_.store(true); }
  // The cable is whole again.
  void heal() noexcept { cut_.store(false); }

  // kConnecting while there is no session, between sessions too; kFault and kClosed are seen by one
  // call of after_poll each.
  [[nodiscard]] State state() const noexcept override;
  // Why there is no session, or why the last one ended; empty while one is ready.
  [[nodiscard]] std::string fault() const override;
  [[nodiscard]] std::uint64_t sessions() const noexcept override;
  [[nodiscard]] std::int64_t last_heard_ns() const noexcept override;
  [[nodiscard]] std::int64_t round_trip_ns() const noexcept override;
  [[nodiscard]] std::int64_t clock_uncertainty_ns() const noexcept override;
  [[nodiscard]] std::int64_t thread_cpu_ns() const noexcept override;
  [[nodiscard]] LinkEndpoint::Stats stats() const override;

  // 0: the road carries what it is given; up to 5: quality steps that it wishes to be spared,
  // because its round trip grows (pace.hpp). The numbers are the rungs of FrameAsker.
  [[nodiscard]] int wish() const noexcept { return wish_.load(); }
  [[nodiscard]] std::string congestion() const override;
  [[nodiscard]] LinkNotes notes() const override;
  [[nodiscard]] RoadPeer peer() const;  // of the last session
  [[nodiscard]] RoadCounts counts() const;
  [[nodiscard]] std::string last_refusal() const;  // of a stranger, by this box
  // How certificates are judged where that differs from the usual: a clock that is unset.
  [[nodiscard]] std::string note() const;

 private:
  struct Delayed {
    std::int64_t due = 0;
    bool bulk = false;
    std::vector<std::uint8_t> bytes;
  };
  RoadLink();
  void run();
  void poll_session();
  void session_up();
  void session_down(const std::string& why);
  [[nodiscard]] bool take(std::span<const std::uint8_t> message);
  void send(std::span<const std::uint8_t> message, bool at_once);
  [[nodiscard]] bool is_news(std::span<const std::uint8_t> message) noexcept;
  void hand_over(std::int64_t now_ns);
  void publish();

  std::unique_ptr<Road> road_;
  LinkEndpoint* endpoint_ = nullptr;
  std::function<rt::Time()> now_;
  std::function<void()> after_poll_;
  std::optional<LinkShaper> shaper_;
  std::deque<Delayed> delayed_;
  double rate_Mbit_per_s_ = 0;
  std::thread thread_;
  bool up_ = false;
  // Which connections take what is said now.
  bool to_control_ = true, to_bulk_ = false;
  std::array<std::uint64_t, kMessageIds + 1> newest_{};  // by message id, of this session
  std::int64_t next_note_ns_ = 0;
  std::atomic<bool> stop_{false}, cut_{false};
  std::atomic<State> state_{State::kConnecting};
  std::atomic<std::uint64_t> sessions_{0};
  std::atomic<std::int64_t> last_heard_{0}, round_trip_{0}, uncertainty_{0}, cpu_{0};
  std::atomic<int> wish_{0};
  mutable std::mutex told_;  // guards what follows: words for people
  std::string fault_, congestion_, last_refusal_, note_, peer_address_;
  std::int64_t certificate_until_s_ = 0;
  RoadPeer peer_;
  RoadCounts counts_;
};

// The factory for boxes that only know the interface.
[[nodiscard]] rt::Result<std::unique_ptr<LinkTransport>> open_road(const RoadOptions& options);

}  // namespace drivers
