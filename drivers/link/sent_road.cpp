#include "drivers/link/sent_road.hpp"

namespace drivers {

namespace {

// Forgets the first `done` bytes; moves the others only when they are the smaller part.
void forget_front(std::vector<std::uint8_t>& bytes, std::size_t& done) {
  if (done < bytes.size() && done < bytes.size() / 2) return;
  bytes.erase(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(done));
  done = 0;
}

}  // namespace

SentRoad::SentRoad(const NetworkConfig& c, Way way, std::int64_t epoch_ns)
    : road_(c, way, epoch_ns) {}

void SentRoad::offer(std::int64_t now_ns) {
  if (waiting() == 0) return;
  sent_ += road_.write(now_ns, std::span(waiting_).subspan(sent_));
  forget_front(waiting_, sent_);
}

void SentRoad::send(std::span<const std::uint8_t> message, std::int64_t now_ns) {
  waiting_.insert(waiting_.end(), message.begin(), message.end());
  offer(now_ns);
}

std::span<const std::uint8_t> SentRoad::arrived(std::int64_t now_ns) {
  offer(now_ns);
  road_.read(now_ns, arrived_);
  return std::span(arrived_).subspan(taken_);
}

void SentRoad::take(std::size_t bytes) {
  taken_ += bytes;
  forget_front(arrived_, taken_);
}

bool SentRoad::line_free(std::int64_t now_ns) const noexcept {
  return waiting() == 0 && !road_.busy(now_ns);
}

rt::Nanos SentRoad::busy_for(std::int64_t now_ns) const noexcept {
  return waiting() == 0 ? road_.busy_for(now_ns) : rt::Nanos::max();
}

bool SentRoad::ended(std::int64_t now_ns) const noexcept { return road_.ends(now_ns) != ends_; }

bool SentRoad::empty() const noexcept {
  return waiting() == 0 && taken_ == arrived_.size() && road_.next_arrival_ns() == kNever;
}

std::size_t SentRoad::held() const noexcept {
  return waiting_.size() + arrived_.size() + road_.on_the_way();
}

void SentRoad::renew(std::int64_t now_ns) {
  waiting_.clear();
  arrived_.clear();
  sent_ = taken_ = 0;
  road_.renew(now_ns);
  ends_ = road_.ends(now_ns);
}

}  // namespace drivers
