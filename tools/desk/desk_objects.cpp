#include "tools/desk/desk_objects.hpp"

#include <algorithm>
#include <nlohmann/json.hpp>

namespace teletact {

using perception::GivenObject;
using perception::Vec3;

namespace {

constexpr const char* kOver = "another object was begun meanwhile";

ConsoleAnswer not_now(std::string why) { return {false, std::move(why), {}}; }

std::span<const tasks::ObjectList::Entry> entries_of(const OperatorView& seen) {
  const auto n = std::clamp<std::int32_t>(seen.objects.size, 0, perception::ObjectMap::kMost);
  return std::span(seen.objects.entries).first(static_cast<std::size_t>(n));
}

// About the boxes of what was accepted, with its fused surface.
Eigen::AlignedBox3d about(const GivenObject& object) {
  constexpr double kBeyond_m = 0.05;
  Eigen::AlignedBox3d all_W = object.bounds();
  all_W.min().array() -= kBeyond_m;
  all_W.max().array() += kBeyond_m;
  return all_W;
}
Vec3 centre_of(const tasks::ObjectList::Entry& e) { return e.X_WO * e.centre_m; }

bool holds(const tasks::ObjectList::Entry& e, const Vec3& p_W) {
  if (!e.summarised) return false;
  const Vec3 p_O = e.X_WO.inverse(Eigen::Isometry) * p_W - e.centre_m;
  return (p_O.cwiseAbs() - 0.5 * e.extent_m).maxCoeff() <= 0;
}

std::string told(const Proposal& p) {
  nlohmann::json j{{"proposal", p.number}, {"clicks", p.clicks}, {"pixels", p.pixels}};
  const Eigen::AlignedBox3d bounds_W = p.object.bounds();
  if (!bounds_W.isEmpty()) {
    const Vec3 size_m = bounds_W.sizes();
    j["size_m"] = {size_m.x(), size_m.y(), size_m.z()};
  }
  return j.dump();
}

}  // namespace

DeskObjects::DeskObjects(OperatorBox& box, bool clicks_at_once, Push push)
    : box_(box), push_(std::move(push)), worker_(clicks_at_once) {}

void DeskObjects::forget() {
  ++round_;
  chosen_ = false;
  shown_.clear();
  proposed_.reset();
}

// ---- clicks -------------------------------------------------------------------------------------

std::optional<ConsoleAnswer> DeskObjects::select(const DeskItem& item, rt::Time now) {
  const Intent& in = item.intent;
  if (clicks_.size() >= ClickWorker::kMostWaiting) return not_now("too many clicks wait");
  WaitingClick click;
  ClickRequest& r = click.request;
  if (in.fresh) {
    if (in.sign < 0) return not_now("the first click chooses; later ones can take away");
    const auto frame = box_.graph().cells().read<tasks::EdgeId::kFrame, tasks::kConsole>();
    if (!frame) return not_now("there is no picture yet");
    if (!frame->has_colour) return not_now("the pictures have no colour now");
    r.frame = std::make_shared<perception::RgbdFrame>(*frame);
    forget();
    chosen_ = true;
  } else if (!chosen_) {
    return not_now("the first click of an object chooses it");
  }
  r.session = item.session;
  r.id = item.id;
  r.round = round_;
  r.u = in.u, r.v = in.v;
  r.add = in.sign > 0;
  click.since = now;
  clicks_.push_back(std::move(click));
  return std::nullopt;
}

// In order; a picture waits until fusion has said where the camera was. A click of a round that is
// over does not count, but is answered.
void DeskObjects::hand_over_clicks(const OperatorView& seen, rt::Time now, const Answer& answer) {
  constexpr rt::Nanos kPatience = std::chrono::milliseconds{500};
  for (; !clicks_.empty(); clicks_.pop_front()) {
    WaitingClick& click = clicks_.front();
    ClickRequest& r = click.request;
    if (r.round != round_) {
      answer(r.session, r.id, not_now(kOver));
      continue;
    }
    if (worker_.full()) return;
    if (r.frame) {
      const bool placed = seen.camera.seq != 0 && seen.camera.exposure >= r.frame->exposure;
      if (!placed && now - click.since < kPatience) return;
      r.X_WC = seen.camera.X_WC;
      r.claimed = placed && seen.camera.claimed;
    }
    worker_.put(std::move(r));
  }
}

void DeskObjects::answer_clicks(const Answer& answer) {
  for (ClickAnswered& a : worker_.take()) {
    if (a.round != round_) {
      answer(a.session, a.id, not_now(kOver));
      continue;
    }
    if (!a.proposal) {
      answer(a.session, a.id, not_now(a.why));
      continue;
    }
    proposed_ = a.proposal;
    shown_.push_back({a.session, a.proposal});
    answer(a.session, a.id, {true, {}, told(*a.proposal)});
  }
}

std::vector<ShownProposal> DeskObjects::take_shown() {
  std::vector<ShownProposal> out;
  out.swap(shown_);
  return out;
}

// ---- accept -------------------------------------------------------------------------------------

// Empty: fusion may be asked.
std::string DeskObjects::why_not(const OperatorView& seen, std::uint32_t proposal) const {
  if (!proposed_ || proposed_->number != proposal) return "what was proposed is another one now";
  if (waiting_) return "the last object is not named yet: in a moment";
  if (!proposed_->claimed) return "the camera did not know where it was: choose it again";
  return why_not(seen, proposed_->object);
}

std::string DeskObjects::why_not(const OperatorView& seen, const GivenObject& object) const {
  if (!box_.graph().config().fusion.objects.enabled)
    return "objects are switched off in this run (fusion.objects.enabled)";
  if (object.count == 0) return "hardly any distance of it was measured";
  if (entries_of(seen).size() >= perception::ObjectMap::kMost)
    return "as many objects as there can be";
  for (const tasks::ObjectList::Entry& e : entries_of(seen))
    if (holds(e, object.p_W)) return "it is an object already: " + name_of(e.serial);
  return {};
}

std::optional<ConsoleAnswer> DeskObjects::accept(const DeskItem& item, const OperatorView& seen,
                                                 rt::Time now) {
  if (std::string why = why_not(seen, item.intent.proposal); !why.empty())
    return not_now(std::move(why));
  if (!push_all(proposed_->object, now))
    return not_now("too many acts wait for the tasks: ask again");
  waiting_ = WaitingObject{
      item.session, item.id, now, seen.objects_named, {item.intent.text, proposed_->object}};
  return std::nullopt;
}

// ---- objects of a saved session -----------------------------------------------------------------

DeskObjects::Given DeskObjects::give(const SavedObject& object, const OperatorView& seen,
                                     rt::Time now) {
  if (waiting_ || seen.camera.seq == 0 || !seen.camera.claimed) return Given::kLater;
  for (const tasks::ObjectList::Entry& e : entries_of(seen)) {
    if (!holds(e, object.object.p_W)) continue;
    if (!object.name.empty()) names_[e.serial] = object.name;
    given_[e.serial] = object;
    return Given::kDone;
  }
  if (std::string why = why_not(seen, object.object); !why.empty()) {
    missed_.push_back((object.name.empty() ? "an object" : object.name) + ": " + why);
    unseen_.push_back(object);
    return Given::kDone;
  }
  if (!push_all(object.object, now)) return Given::kNoRoom;
  waiting_ = WaitingObject{0, 0, now, seen.objects_named, object, false};
  return Given::kDone;
}

std::vector<SavedObject> DeskObjects::to_save(const OperatorView& seen) const {
  std::vector<SavedObject> all;
  for (const tasks::ObjectList::Entry& e : entries_of(seen)) {
    const auto known = given_.find(e.serial);
    if (known == given_.end() || !e.summarised) continue;
    // One that was moved is not where its boxes say.
    if (about(known->second.object).contains(centre_of(e))) all.push_back(known->second);
  }
  if (waiting_ && !waiting_->answered) all.push_back(waiting_->what);
  all.insert(all.end(), unseen_.begin(), unseen_.end());
  return all;
}

std::vector<std::string> DeskObjects::take_missed() {
  std::vector<std::string> out;
  out.swap(missed_);
  return out;
}

void DeskObjects::miss(std::string why, const Answer& answer) {
  const WaitingObject& w = *waiting_;
  if (w.answered) {
    answer(w.session, w.id, not_now(std::move(why)));
  } else {
    missed_.push_back((w.what.name.empty() ? "an object" : w.what.name) + ": " + why);
    unseen_.push_back(w.what);
  }
  waiting_.reset();
}

// One edit a job. Without its end a beginning names nothing.
bool DeskObjects::push_all(const GivenObject& object, rt::Time now) {
  tasks::SceneEdit e;
  e.kind = tasks::SceneEdit::Kind::kObjectBox;
  for (const Eigen::AlignedBox3d& box_W : object.boxes()) {
    const Vec3 centre_W = box_W.center(), half_m = 0.5 * box_W.sizes();
    ++e.id;
    for (int i = 0; i < 3; ++i) {
      e.centre_W[static_cast<std::size_t>(i)] = centre_W(i);
      e.half_m[static_cast<std::size_t>(i)] = half_m(i);
    }
    if (!push_(e, now)) return false;
  }
  e.kind = tasks::SceneEdit::Kind::kObjectPoint;
  for (int i = 0; i < 3; ++i) e.centre_W[static_cast<std::size_t>(i)] = object.p_W(i);
  return push_(e, now);
}

bool DeskObjects::drop(std::uint32_t serial, rt::Time now) {
  tasks::SceneEdit e;
  e.kind = tasks::SceneEdit::Kind::kDropObject;
  e.id = static_cast<std::uint16_t>(serial);
  return push_(e, now);
}

std::optional<NamedObject> DeskObjects::keep(const OperatorView& seen, rt::Time now,
                                             const Answer& answer) {
  // Its edits, one a job; then frames for which fusion waits to know where the camera is.
  constexpr rt::Nanos kPatience = std::chrono::milliseconds{2500};
  hand_over_clicks(seen, now, answer);
  answer_clicks(answer);
  if (!waiting_) return std::nullopt;
  const Eigen::AlignedBox3d about_W = about(waiting_->what.object);
  for (const tasks::ObjectList::Entry& e : entries_of(seen)) {
    if (e.serial <= waiting_->newest_before || !e.summarised) continue;
    if (!about_W.contains(centre_of(e))) continue;
    if (!waiting_->what.name.empty()) names_[e.serial] = waiting_->what.name;
    NamedObject named{e.serial, name_of(e.serial)};
    if (waiting_->answered) {
      const nlohmann::json result{{"serial", e.serial}, {"name", named.name}};
      answer(waiting_->session, waiting_->id, {true, {}, result.dump()});
      proposed_.reset();
    }
    given_[e.serial] = std::move(waiting_->what);
    waiting_.reset();
    return named;
  }
  if (now - waiting_->since > kPatience)
    miss("it is not seen there now: hidden, moved, or the camera is lost", answer);
  return std::nullopt;
}

std::string DeskObjects::name_of(std::uint32_t serial) const {
  const auto named = names_.find(serial);
  return named != names_.end() ? named->second : "object " + std::to_string(serial);
}

}  // namespace teletact
