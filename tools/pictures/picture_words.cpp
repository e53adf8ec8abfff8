#include "tools/pictures/picture_words.hpp"

#include <algorithm>
#include <cstdio>

namespace teletact {

namespace {

constexpr int kCoarsest = 3;  // rungs beyond it take pictures, not quality
constexpr std::int64_t kBetweenLines_ns = 2'000'000'000;

}  // namespace

std::string spared_text(drivers::Spared spared) {
  if (spared.rungs == 0) return {};
  const int steps = std::min<int>(spared.rungs, kCoarsest);
  std::string text =
      "depth " + std::to_string(steps) + (steps == 1 ? " step" : " steps") + " coarser";
  if (spared.rungs == kCoarsest + 1) text += ", 24 pictures a second";
  if (spared.rungs > kCoarsest + 1) text += ", 20 pictures a second";
  return text +
         (spared.why == drivers::Spared::Why::kLate
              ? ": the road's round trip has grown by 40 ms or more; a step comes back after "
                "each 3 s in which it is short again"
              : ": the pictures fill the road; a step comes back after 45 pictures in which "
                "it is idle for half of the time");
}

std::string age_text(std::optional<rt::Nanos> age) {
  if (!age) return "no picture yet";
  char text[40];
  const double s = 1e-9 * static_cast<double>(age->count());
  if (s < 1)
    std::snprintf(text, sizeof text, "%.0f ms old", 1e3 * s);
  else
    std::snprintf(text, sizeof text, "%.1f s old", s);
  return text;
}

std::string SparedNews::look(drivers::Spared now_spared, std::int64_t now_ns) {
  if (now_spared.rungs == told_.rungs || now_ns < next_ns_) return {};
  told_ = now_spared;
  next_ns_ = now_ns + kBetweenLines_ns;
  const std::string text = spared_text(now_spared);
  return text.empty() ? "pictures: as fine and as many as the scene asks for" : "pictures: " + text;
}

}  // namespace teletact
