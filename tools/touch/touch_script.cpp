#include "tools/touch/touch_script.hpp"

#include <algorithm>
#include <cstdio>

namespace teletact {

using perception::Vec3;

namespace {

constexpr rt::Nanos kAhead = std::chrono::milliseconds{100};

std::array<float, 3> floats(const Vec3& v) {
  return {static_cast<float>(v.x()), static_cast<float>(v.y()), static_cast<float>(v.z())};
}

}  // namespace

TouchScript::TouchScript(drivers::HandScript& hand, const Reach& reach)
    : hand_(hand), reach_(reach), at_W_(reach.map.to_world(Vec3::Zero())) {
  for (std::size_t i = 0; i < hand.size(); ++i)
    asked_ = asked_ || hand.segment(i).source == "chosen";
}

bool TouchScript::next_is_chosen_move(std::size_t i) const {
  return i + 1 < hand_.size() && hand_.segment(i + 1).source == "chosen" &&
         hand_.segment(i + 1).kind == "move";
}

void TouchScript::tick(rt::Nanos since_epoch, const tasks::SceneView& view,
                       const perception::CostMap& map) {
  if (!asked_ || segment_ >= hand_.size() || view.seq == 0) return;
  if (view.seq != seen_) {
    seen_ = view.seq;
    memory_.see(view, up_of(map, memory_), &reach_);
  }
  for (; segment_ < hand_.size(); ++segment_) {
    if (hand_.segment(segment_).source != "chosen") continue;
    if (since_epoch + kAhead < hand_.start(segment_)) return;
    settle(segment_, since_epoch, view);
  }
}

void TouchScript::settle(std::size_t i, rt::Nanos since_epoch, const tasks::SceneView& view) {
  const auto& segment = hand_.segment(i);
  if (segment.kind == "move") {
    const bool half_way = next_is_chosen_move(i);
    const TouchPlaces::Known* still = nullptr;
    if (visiting_ && next_) still = memory_.at(next_->place.p_W);
    if (still != nullptr && !half_way) {
      next_->pictures = still->pictures;
      onto(still->place);
    } else {
      choose(since_epoch, view);
    }
    visiting_ = half_way;  // the second move is of the same visit
    if (!next_) return;
    const TouchPlace& p = next_->place;
    const Vec3 over = p.p_W + segment.standoff_m * p.n_W;
    const Vec3 to = half_way ? next_->via_W : over;
    (void)hand_.set_point(i, to - segment.standoff_m * p.n_W, p.n_W);
    if (half_way) return;
    at_W_ = over;
    touched_.push_back(p);
    Visit& v = visits_.back();
    v.chosen = true;
    v.kind = p.kind;
    v.p_W = floats(p.p_W);
    v.n_W = floats(p.n_W);
    v.pictures = next_->pictures;
    return;
  }
  if (!next_ || visits_.empty()) return;
  const TouchPlaces::Known* still = memory_.at(next_->place.p_W);
  if (still == nullptr) {
    next_.reset();
    return;
  }
  // The way in is that of the move: only the depth follows the newest picture.
  const TouchPlace& p = next_->place;
  onto(still->place);
  if (!hand_.set_point(i, p.p_W, p.n_W)) return;
  Visit& v = visits_.back();
  v.pressed = true;
  v.p_W = floats(p.p_W);
  v.from_s = rt::seconds(hand_.start(i));
  // Until the hand is drawn back.
  std::size_t end = i + 1;
  while (end < hand_.size() && hand_.segment(end).kind != "move") ++end;
  v.until_s = rt::seconds(hand_.start(end));
}

// The place follows the surface that shows there now; what shows may be a little aside.
void TouchScript::onto(const TouchPlace& now) {
  TouchPlace& p = next_->place;
  p.p_W += (now.p_W - p.p_W).dot(now.n_W) * now.n_W;
}

void TouchScript::begin_visit(rt::Nanos since_epoch) {
  visits_.emplace_back().at_s = rt::seconds(since_epoch);
}

void TouchScript::choose(rt::Nanos since_epoch, const tasks::SceneView& view) {
  if (!visiting_) begin_visit(since_epoch);
  next_ = next_place(memory_, view, reach_, at_W_, touched_);
}

std::string TouchScript::news() {
  std::string out;
  // The last one is told when it is settled.
  const std::size_t settled = segment_ >= hand_.size() || visits_.empty() || visits_.back().pressed
                                  ? visits_.size()
                                  : visits_.size() - 1;
  for (; told_ < settled; ++told_) out += text_of(visits_[told_]) + "\n";
  return out;
}

std::string text_of(const Visit& v) {
  char text[160];
  if (!v.chosen)
    std::snprintf(text, sizeof text, "%5.1f s  no place: none in reach that two pictures showed",
                  v.at_s);
  else
    std::snprintf(
        text, sizeof text,
        "%5.1f s  %s at (%.2f, %.2f, %.2f) m, normal (%.2f, %.2f, %.2f), in %d pictures%s", v.at_s,
        name_of(v.kind), static_cast<double>(v.p_W[0]), static_cast<double>(v.p_W[1]),
        static_cast<double>(v.p_W[2]), static_cast<double>(v.n_W[0]), static_cast<double>(v.n_W[1]),
        static_cast<double>(v.n_W[2]), v.pictures, v.pressed ? "" : ": gone before the press");
  return text;
}

int TouchedPlaces::met() const noexcept {
  return static_cast<int>(
      std::count_if(visits.begin(), visits.end(), [](const Touched& t) { return t.met(); }));
}

std::string too_few_touches(const TouchedPlaces& touched, int asked) {
  const int met = touched.met(), least = std::min(kLeastTouches, asked);
  if (met >= least) return {};
  char text[240];
  std::snprintf(text, sizeof text,
                "the recording was touched %d times, wanted %d: of %d visits %d had no place to "
                "choose, %d places had gone before the press, %d presses met nothing",
                met, least, asked, touched.none, touched.gone,
                static_cast<int>(touched.visits.size()) - touched.none - touched.gone - met);
  return text;
}

std::string TouchedPlaces::text() const {
  std::string out;
  for (std::size_t k = 0; k < touched.size(); ++k) {
    if (touched[k] == 0) continue;
    out += (out.empty() ? "" : ", ") + std::to_string(touched[k]) + " " +
           name_of(static_cast<TouchPlace::Kind>(k)) + (touched[k] > 1 ? "s" : "");
  }
  return out;
}

TouchedPlaces touched_places(const std::vector<Visit>& visits,
                             std::span<const tasks::HapticSample> samples, std::int64_t epoch_ns,
                             const std::vector<Touched>& before) {
  TouchedPlaces out;
  for (const Visit& v : visits) {
    out.none += v.chosen ? 0 : 1;
    out.gone += v.chosen && !v.pressed ? 1 : 0;
    const std::size_t at = out.visits.size();
    Touched& t = out.visits.emplace_back();
    if (at < before.size()) t = before[at];
    for (const tasks::HapticSample& s : samples) {
      const double at_s = 1e-9 * static_cast<double>(rt::ns_of(s.stamp) - epoch_ns);
      if (!v.pressed || !s.in_contact || at_s < v.from_s || at_s > v.until_s) continue;
      t.contact_s += 1e-3;
      t.force_max_N = std::max(t.force_max_N, static_cast<double>(s.force_N));
    }
    out.touched[static_cast<std::size_t>(v.kind)] += t.met() ? 1 : 0;
  }
  return out;
}

}  // namespace teletact
