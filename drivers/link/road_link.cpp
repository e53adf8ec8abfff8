#include "drivers/link/road_link.hpp"

#include <unistd.h>

#include <algorithm>

#include "drivers/road/pem.hpp"
#include "drivers/road/road.hpp"
#include "rt/clock/box_time.hpp"
#include "rt/effect_count.hpp"

namespace drivers {

namespace {

constexpr rt::Nanos kPoll = std::chrono::milliseconds{1};
// For Bye to leave, at an orderly end.
constexpr int kPollsForBye = 200;
constexpr std::int64_t kNotePeriod = 1'000'000'000;
// Twice the shortest period of a small message. Silences count from 90 ms on.
constexpr rt::Nanos kTogether = std::chrono::milliseconds{20};
// Longest message that is no image.
constexpr std::size_t kMostControl = kHeaderSize + kMaxControlBody;

bool is_image(std::span<const std::uint8_t> message) noexcept {
  Header h;
  return read_header(message, h) == WireStatus::kOk && h.id == MessageId::kFrame;
}

}  // namespace

RoadLink::RoadLink() = default;
RoadLink::~RoadLink() { stop(); }

rt::Result<std::unique_ptr<RoadLink>> RoadLink::open(const RoadOptions& options) {
  auto road = Road::open(options, {kMostControl, kHeaderSize + kMaxBody});
  if (!road) return rt::Error{road.error()};
  std::unique_ptr<RoadLink> link(new RoadLink);
  link->road_ = std::move(road).value();
  link->rate_Mbit_per_s_ = options.rate_Mbit_per_s;
  link->publish();
  return link;
}

rt::Result<bool> RoadLink::check(const RoadOptions& options) { return Road::check(options); }

rt::Result<std::unique_ptr<LinkTransport>> open_road(const RoadOptions& options) {
  auto link = RoadLink::open(options);
  if (!link) return rt::Error{link.error()};
  return std::unique_ptr<LinkTransport>(std::move(link).value());
}

int RoadLink::port() const noexcept { return road_->port(); }

void RoadLink::start(LinkEndpoint& endpoint, std::function<rt::Time()> now,
                     const std::optional<LinkShapeConfig>& shape,
                     std::function<void()> after_poll) {
  endpoint_ = &endpoint;
  endpoint.gather(kTogether);
  now_ = std::move(now);
  after_poll_ = std::move(after_poll);
  if (shape && shape->any()) {
    rt::effect_built(rt::Effect::kLinkShape);
    shaper_.emplace(*shape, endpoint.box() == rt::Box::kRobot ? 1 : 0);
  }
  Road::Handlers handlers;
  handlers.up = [this] { session_up(); };
  handlers.message = [this](std::span<const std::uint8_t> m) { return take(m); };
  handlers.closing_reason = [this] { return endpoint_->fault(); };
  handlers.down = [this](const std::string& why) { session_down(why); };
  road_->set_handlers(std::move(handlers));
  thread_ = std::thread([this] { run(); });
}

void RoadLink::stop() {
  stop_.store(true);
  if (thread_.joinable()) thread_.join();
}

void RoadLink::session_up() {
  delayed_.clear();
  newest_ = {};
  endpoint_->renew();
  up_ = true;
  publish();  // who it is, before anybody can see that somebody is there
  state_.store(State::kHandshake);
  sessions_.fetch_add(1);
  // Hello goes first, before anything of the other side can be a reason to close.
  poll_session();
}

void RoadLink::session_down(const std::string& why) {
  up_ = false;
  delayed_.clear();
  publish();
  {
    const std::lock_guard lock(told_);
    fault_ = why;
  }
  state_.store(endpoint_->fault().empty() ? State::kClosed : State::kFault);
  if (after_poll_) after_poll_();
  state_.store(State::kConnecting);
}

bool RoadLink::take(std::span<const std::uint8_t> message) {
  if (cut_.load()) return true;  // lost on the way
  if (!is_news(message)) return true;
  const bool good = endpoint_->receive(message, now_(),
                                       [this](std::span<const std::uint8_t> m) { send(m, true); });
  if (endpoint_->bye_received()) road_->expect_end();
  return good;
}

// Of the robot's end. What can not be read is for the endpoint to refuse.
bool RoadLink::is_news(std::span<const std::uint8_t> message) noexcept {
  Header h;
  if (endpoint_->box() != rt::Box::kRobot || read_header(message, h) != WireStatus::kOk)
    return true;
  std::uint64_t& newest = newest_[static_cast<std::size_t>(h.id)];
  if (h.seq <= newest) return false;
  newest = h.seq;
  return true;
}

void RoadLink::send(std::span<const std::uint8_t> message, bool at_once) {
  if (!shaper_) {
    const bool image = is_image(message);
    if (!image && to_control_) road_->send(false, message, at_once);
    if (image || to_bulk_) road_->send(true, message, at_once);
    return;
  }
  rt::effect_ran(rt::Effect::kLinkShape);
  const std::int64_t due = shaper_->deliver_at(rt::monotonic_ns(), message.size());
  delayed_.push_back({due, is_image(message), {message.begin(), message.end()}});
}

void RoadLink::hand_over(std::int64_t now_ns) {
  while (!delayed_.empty() && delayed_.front().due <= now_ns) {
    road_->send(delayed_.front().bulk, delayed_.front().bytes);
    delayed_.pop_front();
  }
}

// A connection that has not taken the last small messages gets no more: when it does, it gets the
// newest. An answer to what is received between two polls goes where the last one went.
void RoadLink::poll_session() {
  const std::int64_t now = rt::monotonic_ns();
  hand_over(now);
  to_control_ = road_->control_free();
  // Not before the other end has answered: nothing may reach it before the Hello that control has.
  to_bulk_ = !shaper_ && endpoint_->box() == rt::Box::kOperator && endpoint_->ready() &&
             road_->bulk_taken();
  if (!up_ || !(to_control_ || to_bulk_)) return;
  endpoint_->set_wish(road_->wish());
  rt::Nanos busy = road_->bulk_busy_for();
  if (shaper_) busy = std::max(busy, shaper_->busy_for(now));
  endpoint_->poll(
      now_(), busy.count() == 0, [this](std::span<const std::uint8_t> m) { send(m, false); }, busy);
  road_->flush();
  if (endpoint_->ready() && state_.load() == State::kHandshake) {
    const std::lock_guard lock(told_);
    fault_.clear();
    state_.store(State::kReady);
  }
}

void RoadLink::publish() {
  if (endpoint_ != nullptr) {
    if (endpoint_->ever_heard()) last_heard_.store(rt::ns_of(endpoint_->last_heard()));
    round_trip_.store(endpoint_->round_trip().count());
    if (endpoint_->clock().valid())
      uncertainty_.store(endpoint_->clock().uncertainty(now_()).count());
  }
  wish_.store(road_->wish());
  const std::int64_t now = rt::monotonic_ns();
  const bool note_due = now >= next_note_ns_;
  if (note_due) next_note_ns_ = now + kNotePeriod;
  const std::lock_guard lock(told_);
  counts_ = road_->counts();
  if (last_refusal_ != road_->last_refusal()) last_refusal_ = road_->last_refusal();
  if (state_.load() == State::kConnecting && !road_->last_end().empty()) fault_ = road_->last_end();
  if (note_due) {
    note_ = road_->note();
    certificate_until_s_ = road_->self().valid_until_s;
  }
  if (up_) {
    peer_ = road_->peer();
    peer_address_ = road_->peer_address();
    congestion_ = road_->congestion();
  } else {
    congestion_.clear();
  }
}

void RoadLink::run() {
  while (!stop_.load()) {
    if (cut_.load()) {
      ::usleep(1000);
    } else {
      road_->run_for(kPoll);
      poll_session();
      publish();
      if (up_ && endpoint_->bye_received()) road_->close_session("the other box has ended");
    }
    cpu_.store(rt::thread_cpu_ns());
    if (after_poll_) after_poll_();
  }
  if (up_ && !cut_.load()) {
    to_control_ = true;  // behind whatever it has not taken yet
    endpoint_->send_bye(now_(), [this](std::span<const std::uint8_t> m) { send(m, true); });
    for (int i = 0; i < kPollsForBye && up_ && (!delayed_.empty() || !road_->control_free()); ++i) {
      road_->run_for(kPoll);
      hand_over(rt::monotonic_ns());
    }
  }
  if (up_) {
    road_->close_session("this box has ended");
    road_->run_for(kPoll);
  }
  state_.store(State::kClosed);
  if (after_poll_) after_poll_();
}

LinkTransport::State RoadLink::state() const noexcept { return state_.load(); }
std::uint64_t RoadLink::sessions() const noexcept { return sessions_.load(); }
std::int64_t RoadLink::last_heard_ns() const noexcept { return last_heard_.load(); }
std::int64_t RoadLink::round_trip_ns() const noexcept { return round_trip_.load(); }
std::int64_t RoadLink::clock_uncertainty_ns() const noexcept { return uncertainty_.load(); }
std::int64_t RoadLink::thread_cpu_ns() const noexcept { return cpu_.load(); }

std::string RoadLink::fault() const {
  const std::lock_guard lock(told_);
  return state_.load() == State::kReady ? std::string{} : fault_;
}

std::string RoadLink::congestion() const {
  const std::lock_guard lock(told_);
  return congestion_;
}

RoadPeer RoadLink::peer() const {
  const std::lock_guard lock(told_);
  return peer_;
}

RoadCounts RoadLink::counts() const {
  const std::lock_guard lock(told_);
  return counts_;
}

std::string RoadLink::last_refusal() const {
  const std::lock_guard lock(told_);
  return last_refusal_;
}

std::string RoadLink::note() const {
  const std::lock_guard lock(told_);
  return note_;
}

LinkNotes RoadLink::notes() const {
  const State state = state_.load();
  const bool there = state == State::kReady || state == State::kHandshake;
  const std::lock_guard lock(told_);
  LinkNotes n;
  if (there)
    n.peer = std::string(role_name(peer_.role)) + " '" + peer_.name + "' from " + peer_address_;
  n.note = note_;
  n.refusal = last_refusal_;
  n.refused = counts_.refused + counts_.crowded;
  n.certificate_until_s = certificate_until_s_;
  n.rate_Mbit_per_s = rate_Mbit_per_s_;
  return n;
}

LinkEndpoint::Stats RoadLink::stats() const {
  return endpoint_ != nullptr ? endpoint_->stats() : LinkEndpoint::Stats{};
}

}  // namespace drivers
