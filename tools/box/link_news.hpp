// What a person is told of a link that lasts: that it waits, who holds the place and is not ready,
// who is there, why it has gone, who was turned away and why, and how certificates are judged where
// that is not as usual. One line each time that this changes; of strangers at once, then every ten
// seconds at most. And, once a second at most, that commands were refused; and what is lowered of
// the pictures, why, and that it is whole again; once a connection, that a codec fits the road so
// badly that pictures come slowly.
//
// Pure: time is an argument.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "drivers/link/link_transport.hpp"
#include "tasks/graph/operator_graph.hpp"
#include "tools/pictures/picture_words.hpp"

namespace teletact {

// Of a counter of pictures that is looked at again and again: how many a second, over the last one.
class PictureRate {
 public:
  void look(std::uint64_t pictures, std::int64_t now_ns) noexcept;
  [[nodiscard]] double per_s() const noexcept { return per_s_; }  // below 0: not known yet

 private:
  std::uint64_t pictures_ = 0;
  std::int64_t since_ns_ = 0;
  double per_s_ = -1;
};

// How the pictures are coded, and how many a second there would be.
struct PictureRoad {
  bool lossless = false;  // each frame alone: it is as large as it is
  double camera_per_s = 30, rate_Mbit_per_s = 0;
};
// "7 of 30 pictures a second: ..." where a lossless codec makes the road the bottleneck; else
// empty.
[[nodiscard]] std::string slow_text(const PictureRoad& road, double per_s);

class LinkNews {
 public:
  // The lines that are due.
  [[nodiscard]] std::vector<std::string> look(const drivers::LinkTransport& link,
                                              const tasks::LinkStatus& status,
                                              const PictureRoad& road, std::int64_t now_ns);
  [[nodiscard]] double pictures_per_s() const noexcept { return rate_.per_s(); }

  // One of them each; or empty. `who`: LinkNotes::peer.
  [[nodiscard]] std::string line(bool ready, std::uint64_t sessions, const std::string& fault,
                                 const std::string& who = {});
  // Who holds the place while the hand-shake is not over: each at once, the same one every ten
  // seconds at most.
  [[nodiscard]] std::string shaking_line(bool ready, const std::string& who, std::int64_t now_ns);
  [[nodiscard]] std::string turned_away_line(std::uint64_t refused, const std::string& newest,
                                             std::int64_t now_ns);
  [[nodiscard]] std::string note_line(const std::string& note);
  [[nodiscard]] std::string refused_line(std::uint64_t refused, const char* newest,
                                         std::int64_t now_ns);
  [[nodiscard]] std::string slow_line(bool ready, const PictureRoad& road, double per_s,
                                      std::int64_t now_ns);

 private:
  SparedNews spared_news_;
  PictureRate rate_;
  std::string told_fault_, told_note_, told_shaking_;
  bool begun_ = false, was_ready_ = false, slow_told_ = false;
  std::uint64_t sessions_ = 0, refused_ = 0, turned_away_ = 0;
  std::int64_t next_refused_ns_ = 0, next_turned_away_ns_ = 0, slow_since_ns_ = 0;
  std::int64_t next_shaking_ns_ = 0;
};

}  // namespace teletact
