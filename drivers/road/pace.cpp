#include "drivers/road/pace.hpp"

#include <algorithm>

namespace drivers {

namespace {

// A road's round trip is thought to be at most half a second; without a rate, 100 Mbit/s.
constexpr double kLongestRoad_s = 0.5, kUnknownRate_Mbit_per_s = 100;
constexpr std::size_t kRoom = 32768;
constexpr int kLooksToFirst = 4, kLooksToNext = 8, kLooksBack = 60;

std::size_t bytes_of(double rate_Mbit_per_s, double span_s) noexcept {
  return static_cast<std::size_t>(rate_Mbit_per_s * 125e3 * span_s);
}

}  // namespace

RoadPace::RoadPace(double rate_Mbit_per_s) noexcept
    : most_(kRoom + bytes_of(rate_Mbit_per_s > 0 ? rate_Mbit_per_s : kUnknownRate_Mbit_per_s,
                             kLongestRoad_s)),
      allowance_(most_ / 2),
      pacing_rate_(bytes_of(std::max(0.0, rate_Mbit_per_s), kShare)) {}

void RoadPace::look(rt::Nanos round_trip, rt::Nanos least_round_trip,
                    std::size_t in_flight) noexcept {
  rt::Nanos least = least_round_trip;
  const bool knows = looks_ >= kLooksToKnow;
  if (knows) {
    least_smoothed_ = std::min(least_smoothed_, round_trip);
    least = std::clamp(least_smoothed_, least_round_trip, least_round_trip + kJitter);
  } else if (in_flight > 0) {
    ++looks_;
  }
  const rt::Nanos above = round_trip - least;
  if (above >= (knows ? kTooLong : kSurely)) {
    // From what is there: an allowance that nobody uses would take many cuts before it is felt.
    const std::size_t used = std::min(allowance_, std::max(in_flight, kLeast));
    allowance_ = std::max(kLeast, used - used * 7 / 100);
    calm_looks_ = 0;
    if (!knows) return;
    if (++long_looks_ >= (wish_ == 0 ? kLooksToFirst : kLooksToNext)) {
      wish_ = std::min(wish_ + 1, kMostWish);
      long_looks_ = 0;
    }
    return;
  }
  long_looks_ = 0;
  if (above > kShort) {
    calm_looks_ = 0;
    return;
  }
  if (in_flight >= allowance_ / 2) {
    allowance_ = std::min(most_, allowance_ + allowance_ * 6 / 100);
  }
  if (++calm_looks_ >= kLooksBack) {
    wish_ = std::max(0, wish_ - 1);
    calm_looks_ = 0;
  }
}

}  // namespace drivers
