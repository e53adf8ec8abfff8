#include "tools/box/picture_phase.hpp"

#include <algorithm>

namespace teletact {

namespace {

constexpr std::size_t kMostWaiting = 64;
// The shortest waits but for this share are by chance; more missed than this are not.
constexpr std::size_t kShortOf = 20, kByChance = PicturePhase::kPictures / kShortOf;
// So many that were passed are no reason to be later: each costs a period, which is what kStep for
// all of a look costs where 3 of 60 were passed.
constexpr std::size_t kFew = 2;
// A shortest wait within this of a release says that the release is among the arrivals.
constexpr rt::Nanos kNear = std::chrono::milliseconds{12};

}  // namespace

void PicturePhase::arrived(rt::Time at, rt::Time exposure) {
  if (waiting_.size() == kMostWaiting) waiting_.pop_front();
  waiting_.push_back({at, exposure});
}

void PicturePhase::found_none(rt::Time start) { job_ = start; }

void PicturePhase::taken(rt::Time start, rt::Time exposure) {
  // The job before this one was there after the picture, and did not take it: not yet decoded. Much
  // after it, that is no matter of decoding.
  const auto passed = [&](const Arrival& a) { return a.at <= job_ && job_ - a.at < kNear; };
  while (!waiting_.empty() && waiting_.front().exposure < exposure) {
    ++missed_;
    if (passed(waiting_.front())) ++passed_;
    waiting_.pop_front();
  }
  if (!waiting_.empty() && waiting_.front().exposure == exposure) {
    const rt::Nanos wait = start - waiting_.front().at;
    if (passed(waiting_.front()))
      ++passed_;
    else if (wait < period_)
      waits_.push_back(wait);
    waiting_.pop_front();
  }
  job_ = start;
}

rt::Nanos PicturePhase::after_passed(rt::Nanos shortest) {
  calm_ = 0;
  // Just before the arrivals; else a few come far behind the others: earlier would pass more.
  if (shortest >= kNear) return shortest > period_ - kNear ? good() : rt::Nanos{0};
  if (tries_) patience_ = std::min(2 * patience_, kLatest);
  tries_ = false;
  slower_ = std::min(slower_ + kStep, kSlowest);
  return kStep;
}

void PicturePhase::try_less() noexcept {
  calm_ += waits_.size();
  if (slower_ == rt::Nanos{0} || calm_ < patience_) return;
  calm_ = 0;
  tries_ = true;
  slower_ = std::max(rt::Nanos{0}, slower_ - kTry);
}

rt::Nanos PicturePhase::look() {
  if (passed_ < kAtOnce && waits_.size() + passed_ < pictures_) return rt::Nanos{0};
  const rt::Nanos later = decide();
  waits_.clear();
  missed_ = passed_ = 0;
  pictures_ = later > rt::Nanos{0} ? kFirst : std::min(pictures_ + kMore, kPictures);
  return later;
}

rt::Nanos PicturePhase::decide() {
  if (waits_.empty()) return good();
  const auto at = waits_.begin() + static_cast<std::ptrdiff_t>(waits_.size() / kShortOf);
  std::nth_element(waits_.begin(), at, waits_.end());
  const rt::Nanos shortest = *at;
  if (passed_ > kFew) return after_passed(shortest);
  const bool many_missed = missed_ > kByChance, few = pictures_ < kPictures;
  try_less();
  if (shortest > most() + (few ? kFar : rt::Nanos{0})) return period_ - (shortest - good());
  // In the midst of the arrivals: the late ones find the next job, and there the next picture.
  // Missed without that, they are by a job that came late, and no phase helps.
  if (few || shortest >= (many_missed ? good() : kLeast)) return rt::Nanos{0};
  return good() - std::min(shortest, good() - kLeast);
}

}  // namespace teletact
