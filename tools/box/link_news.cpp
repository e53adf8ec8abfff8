#include "tools/box/link_news.hpp"

#include <cstdio>

namespace teletact {

namespace {

constexpr std::int64_t kSecond = 1'000'000'000;
constexpr std::int64_t kTurnedAway = 10 * kSecond, kShaking = 10 * kSecond;
// A road that carries less than this share of the pictures, for so long, is worth a word.
constexpr double kFewPictures = 0.8;
constexpr std::int64_t kSlowFor = 5 * kSecond;

bool is_slow(const PictureRoad& road, double per_s) {
  return road.lossless && road.rate_Mbit_per_s > 0 && per_s >= 0 &&
         per_s < kFewPictures * road.camera_per_s;
}

}  // namespace

void PictureRate::look(std::uint64_t pictures, std::int64_t now_ns) noexcept {
  if (since_ns_ != 0 && now_ns - since_ns_ < kSecond) return;
  if (since_ns_ != 0)
    per_s_ =
        1e9 * static_cast<double>(pictures - pictures_) / static_cast<double>(now_ns - since_ns_);
  pictures_ = pictures;
  since_ns_ = now_ns;
}

std::string slow_text(const PictureRoad& road, double per_s) {
  if (!is_slow(road, per_s)) return {};
  char text[320];
  std::snprintf(
      text, sizeof text,
      "%.0f of %.0f pictures a second: lossless depth does not fit a road of %.3g Mbit/s; "
      "start both boxes with --set 'link.depth_codec=\"auto\"' (and "
      "'link.colour_codec=\"h264\"'), or give --rate what the road carries",
      per_s, road.camera_per_s, road.rate_Mbit_per_s);
  return text;
}

std::string LinkNews::line(bool ready, std::uint64_t sessions, const std::string& fault,
                           const std::string& who) {
  const bool first = !begun_;
  begun_ = true;
  if (ready && (!was_ready_ || sessions != sessions_)) {
    was_ready_ = true;
    sessions_ = sessions;
    told_fault_.clear();
    return "link: the other box is there (connection " + std::to_string(sessions) + ")" +
           (who.empty() ? "" : ": " + who) + (sessions > 1 ? "; engage again to go on" : "");
  }
  if (ready) return {};
  const bool lost = was_ready_;
  was_ready_ = false;
  if (!first && !lost && fault == told_fault_) return {};
  told_fault_ = fault;
  return (lost ? "link: the other box is gone" : "link: no other box yet") +
         (fault.empty() ? std::string() : " (" + fault + ")") + "; this box holds still";
}

std::string LinkNews::shaking_line(bool ready, const std::string& who, std::int64_t now_ns) {
  if (ready || who.empty() || (who == told_shaking_ && now_ns < next_shaking_ns_)) return {};
  told_shaking_ = who;
  next_shaking_ns_ = now_ns + kShaking;
  return "link: " + who + " has come; hand-shake";
}

std::string LinkNews::turned_away_line(std::uint64_t refused, const std::string& newest,
                                       std::int64_t now_ns) {
  if (refused == turned_away_ || now_ns < next_turned_away_ns_) return {};
  const std::uint64_t more = refused - turned_away_;
  turned_away_ = refused;
  next_turned_away_ns_ = now_ns + kTurnedAway;
  return "link: turned away: " + newest +
         (more > 1 ? " (the newest of " + std::to_string(more) + ")" : std::string());
}

std::string LinkNews::note_line(const std::string& note) {
  if (note == told_note_) return {};
  const std::string before = told_note_;
  told_note_ = note;
  return note.empty() ? "link: no longer so: " + before : "link: " + note;
}

std::string LinkNews::refused_line(std::uint64_t refused, const char* newest, std::int64_t now_ns) {
  if (refused == refused_ || now_ns < next_refused_ns_) return {};
  // Another box, which counts from one, may be there since.
  const std::uint64_t more = refused > refused_ ? refused - refused_ : refused;
  refused_ = refused;
  next_refused_ns_ = now_ns + kSecond;
  return "the robot's box refused " + std::to_string(more) + " command" + (more == 1 ? "" : "s") +
         " (the newest: " + newest + ")";
}

std::string LinkNews::slow_line(bool ready, const PictureRoad& road, double per_s,
                                std::int64_t now_ns) {
  if (!ready) slow_told_ = false;
  if (!ready || !is_slow(road, per_s)) {
    slow_since_ns_ = 0;
    return {};
  }
  if (slow_since_ns_ == 0) slow_since_ns_ = now_ns;
  if (slow_told_ || now_ns - slow_since_ns_ < kSlowFor) return {};
  slow_told_ = true;
  return "link: the road carries " + slow_text(road, per_s);
}

std::vector<std::string> LinkNews::look(const drivers::LinkTransport& link,
                                        const tasks::LinkStatus& status, const PictureRoad& road,
                                        std::int64_t now_ns) {
  const bool ready = link.state() == drivers::LinkTransport::State::kReady;
  const drivers::LinkNotes notes = link.notes();
  rate_.look(status.pictures.load(), now_ns);
  std::vector<std::string> due;
  for (std::string& text : std::vector<std::string>{
           line(ready, link.sessions(), ready ? std::string() : link.fault(), notes.peer),
           shaking_line(ready, notes.peer, now_ns), note_line(notes.note),
           turned_away_line(notes.refused, notes.refusal, now_ns),
           refused_line(
               status.commands_refused.load(),
               drivers::to_text(static_cast<drivers::CommandFault>(status.commands_newest.load())),
               now_ns),
           ready ? spared_news_.look(status.spared(), now_ns) : std::string(),
           slow_line(ready, road, rate_.per_s(), now_ns)}) {
    if (!text.empty()) due.push_back(std::move(text));
  }
  return due;
}

}  // namespace teletact
