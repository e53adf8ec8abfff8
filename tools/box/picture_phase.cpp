#include "tools/box/picture_phase.hpp"

#include <algorithm>
#include <utility>

namespace teletact {

namespace {

constexpr std::size_t kMostWaiting = 64;
// The shortest waits but for this share are by chance; more missed than this are not.
constexpr std::size_t kShortOf = 20, kByChance = PicturePhase::kPictures / kShortOf;
// So many that were passed are no pattern.
constexpr std::size_t kFew = 1;

}  // namespace

void PicturePhase::arrived(rt::Time at, rt::Time exposure) {
  if (waiting_.size() == kMostWaiting) waiting_.pop_front();
  waiting_.push_back({at, exposure});
}

void PicturePhase::taken(rt::Time start, rt::Time exposure) {
  while (!waiting_.empty() && waiting_.front().exposure < exposure) {
    ++missed_;
    // Not yet decoded when a job came, or that job was not there at all: then it arrived earlier.
    const rt::Nanos passed_by = start - period_ - waiting_.front().at;
    if (passed_by >= rt::Nanos{0} && passed_by < kGood) ++passed_;
    waiting_.pop_front();
  }
  if (waiting_.empty() || waiting_.front().exposure != exposure) return;
  const rt::Nanos wait = start - waiting_.front().at;
  if (wait < period_)
    waits_.push_back(wait);
  else
    ++passed_;
  waiting_.pop_front();
}

rt::Nanos PicturePhase::look() {
  if (passed_ < kAtOnce && waits_.size() + passed_ < kPictures) return rt::Nanos{0};
  const bool many_passed = std::exchange(passed_, 0) > kFew;
  if (waits_.empty()) {
    missed_ = 0;
    return kGood;
  }
  const auto at = waits_.begin() + static_cast<std::ptrdiff_t>(waits_.size() / kShortOf);
  std::nth_element(waits_.begin(), at, waits_.end());
  const rt::Nanos shortest = *at;
  const bool many_missed = missed_ > kByChance;
  waits_.clear();
  missed_ = 0;
  if (many_passed) {
    if (shortest < kMost) return kStep;
    // Just before the arrivals; else a few come far behind the others: earlier would pass more.
    return shortest > period_ - kMost ? kGood : rt::Nanos{0};
  }
  if (shortest > kMost) return period_ - (shortest - kGood);
  // In the midst of the arrivals: the late ones find the next job, and there the next picture.
  // Missed without that, they are by a job that came late, and no phase helps.
  if (shortest >= (many_missed ? kGood : kLeast)) return rt::Nanos{0};
  return kGood - std::min(shortest, kGood - kLeast);
}

}  // namespace teletact
