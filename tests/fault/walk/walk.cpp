#include "tests/fault/walk/walk.hpp"

#include <algorithm>
#include <fstream>

namespace walk {

using nlohmann::json;
using tasks::ClearRule;

const tasks::FaultRow* row_in(const std::string& text) {
  const auto at = text.find("F-");
  if (at == std::string::npos) return nullptr;
  for (const tasks::FaultRow& row : tasks::kFaultTable)
    if (text.compare(at, row.code.size(), row.code) == 0) return &row;
  return nullptr;
}

const tasks::FaultRow& row_of(const std::string& code) {
  const tasks::FaultRow* row = row_in(code);
  if (row == nullptr) throw std::logic_error(code + " is no row");
  return *row;
}

// Drives a little before the fault, goes on driving while it lasts, then reads the page and does
// what the row says that the page names.
class Walker final : public desk_run::Person {
 public:
  explicit Walker(const Story& story) : story_(story), row_(row_of(story.code)) {
    viewers = 1;
    world.person = this;
    act = [this](double t) { step(t); };
  }

  drivers::HapticDevice* hand_over(rt::NonRealtime& nrt, drivers::HapticDevice& device) override {
    hand_fault_ = std::make_unique<FaultyHand>(device);
    world.hand = hand_fault_.get();
    return Person::hand_over(nrt, *hand_fault_);
  }
  drivers::Camera* camera(drivers::Camera& twin) {
    camera_fault_ = std::make_unique<FaultyCamera>(twin);
    world.camera = camera_fault_.get();
    return camera_fault_.get();
  }
  void job(const rt::JobRecord& record) override {
    Person::job(record);
    if (record.fault == row_.id) outcome.seen = true;
  }

  World world;
  Outcome outcome;

 private:
  enum class Phase : std::uint8_t { kLook, kClears, kEngages, kDrives, kWaits, kDone };

  void step(double t) {
    world.robot_now = robot_clock(t);
    if (world.twins.lines != nullptr) {
      if (once("switch let go", t, 0.3)) world.twins.lines->let_go(world.robot_now);
      if (once("switch held", t, 0.6)) world.twins.lines->hold(world.robot_now);
    }
    if (once("engage", t, 1.0)) press_engage();
    if (t >= 1.4 && t < (story_.engaged ? kUntil_s : kFrom_s - 0.6)) drive_along(t);
    if (!story_.engaged && once("let go", t, kFrom_s - 0.6)) let_go();
    if (once("from", t, 1.5)) from_ = place();
    if (once("moved", t, 2.4)) outcome.ready = moved();
    if (t >= kFrom_s && t < kUntil_s) {
      if (once("begin", t, kFrom_s) && story_.begin) story_.begin(world);
      if (story_.lasts) story_.lasts(world);
      look_for_code();
    }
    if (once("end", t, kUntil_s)) {
      if (story_.end) story_.end(world);
      let_go();
      phase_ = Phase::kWaits;
      next_s_ = t + 0.4;
    }
    if (t >= kUntil_s && t >= next_s_) follow(t);
  }

  void follow(double t) {
    switch (phase_) {
      case Phase::kWaits:
      case Phase::kLook:
        return look(t);
      case Phase::kClears:
        return cleared(t);
      case Phase::kEngages:
        return engaged(t);
      case Phase::kDrives:
        return drove(t);
      case Phase::kDone:
        return;
    }
  }

  // The page names what holds the boxes: its row says what to do.
  void look(double t) {
    const json page = json::parse(text);
    const std::string mode = page.value("mode", ""), robot = page.value("robot_mode", "");
    for (const char* key : {"mode_cause", "robot_cause"})
      if (const auto* row = row_in(page.value(key, "")))
        outcome.causes.insert(std::string(row->code));
    if (mode == "ramp down" || robot == "ramp down") return wait(t, 0.2);
    if (mode == "safe stop" || robot == "safe stop") {
      const auto* row = row_in(page.value(mode == "safe stop" ? "mode_cause" : "robot_cause", ""));
      if (row == nullptr) return give_up("a safe stop, and the page names no cause");
      if (row->clear == ClearRule::kItself)
        return give_up("a safe stop by " + std::string(row->code) +
                       ", whose row asks for no clear");
      return press_clear(t);
    }
    if (!held_anew_ && world.twins.lines != nullptr && names(page, "F-RIO-23")) return hold_anew(t);
    press_engage();
    phase_ = Phase::kEngages;
    next_s_ = t + 0.2;
  }

  [[nodiscard]] static bool names(const json& page, const char* code) {
    return std::ranges::any_of(page["faults"],
                               [&](const json& f) { return f.value("id", "") == code; });
  }
  // As the row of F-RIO-23 says: let go, held again.
  void hold_anew(double t) {
    released_ = !released_;
    if (released_) {
      world.twins.lines->let_go(world.robot_now);
    } else {
      world.twins.lines->hold(world.robot_now);
      held_anew_ = true;  // until an engage has shown whether that was enough
    }
    wait(t, 0.5);
  }
  void press_clear(double t) {
    ++outcome.clears;
    asked_ = say({{"act", "clear"}});
    phase_ = Phase::kClears;
    next_s_ = t + 0.2;
    given_up_s_ = t + 4;
  }
  void cleared(double t) {
    if (const auto a = answers.find(asked_); a != answers.end()) {
      if (!a->second.ok) outcome.words = a->second.why;
      if (!a->second.ok && is_final(a->second.why)) {
        outcome.final = true;
        return finish();
      }
      return wait(t, a->second.ok ? 0.2 : 1);
    }
    if (t > given_up_s_) return give_up("no answer to a clear");
    next_s_ = t + 0.1;
  }
  // The refusal has the advice of the row that the page names, and that asks for a new start.
  [[nodiscard]] static bool is_final(const std::string& why) {
    const tasks::FaultRow* row = row_in(why);
    return row != nullptr && why.find(std::string(row->advice)) != std::string::npos &&
           row->advice.find("start again") != std::string_view::npos;
  }

  void engaged(double t) {
    if (const auto a = answers.find(asked_); a != answers.end()) {
      if (!a->second.ok) {
        outcome.words = a->second.why;
        let_go();
        return wait(t, 1);
      }
      phase_ = Phase::kDrives;
      drives_from_s_ = t;
      from_ = place();
      return;
    }
    next_s_ = t + 0.1;
  }
  void drove(double t) {
    drive_along(t);
    if (moved()) {
      outcome.driven = true;
      outcome.after_s = t - kUntil_s;
      return finish();
    }
    if (t - drives_from_s_ < 3) return;
    outcome.words = "engaged, and the base does not move: " + json::parse(text).value("held", "");
    let_go();
    wait(t, 1);
  }

  void press_engage() {
    held_anew_ = false;
    ++outcome.engages;
    driven.reset();
    holds = json::array({"engage"});
    asked_ = say({{"act", "engage"}});
  }
  void let_go() {
    driven.reset();
    holds = json::array();
  }
  // There and back, so that nothing is met.
  void drive_along(double t) {
    holds = json::array({"engage", "drive"});
    const double vx = std::fmod(t - 1, 4) < 2 ? 0.2 : -0.2;
    driven = json{{"act", "drive"}, {"vx", vx}, {"vy", 0.0}, {"wz", 0.0}};
  }
  [[nodiscard]] perception::Vec3 place() const {
    const auto& X = world.twins.base->plant().state().X_WB;
    return {X.x, X.y, 0};
  }
  [[nodiscard]] bool moved() const { return (place() - from_).norm() > 0.1; }
  void look_for_code() {
    outcome.seen = outcome.seen || text.find(story_.code) != std::string::npos;
  }
  void wait(double t, double s) {
    phase_ = Phase::kWaits;
    next_s_ = t + s;
  }
  void give_up(const std::string& why) {
    outcome.words = why;
    finish();
  }
  void finish() {
    phase_ = Phase::kDone;
    next_s_ = kMost_s;
    teletact::g_stop_requested.store(true);  // the run ends between two jobs
  }
  [[nodiscard]] rt::Time robot_clock(double) const {
    return teletact::kRobotClock.from_host(teletact::kOperatorClock.to_host(now()));
  }

  const Story& story_;
  const tasks::FaultRow& row_;
  std::unique_ptr<FaultyHand> hand_fault_;
  std::unique_ptr<FaultyCamera> camera_fault_;
  Phase phase_ = Phase::kLook;
  perception::Vec3 from_ = perception::Vec3::Zero();
  std::int64_t asked_ = 0;
  bool released_ = false, held_anew_ = false;  // the enable switch
  double next_s_ = kMost_s, given_up_s_ = 0, drives_from_s_ = 0;
};

namespace {

std::string write_plan(const Story& story) {
  if (story.plan.empty()) return {};
  const auto path = (desk_run::folder() / "walk.toml").string();
  std::ofstream out(path);
  out << "name = 'walk'\npurpose = '" << story.code << "'\n";
  for (const Planned& p : story.plan) {
    out << "[[fault]]\nkind = '" << p.kind << "'\ntarget = '" << p.target
        << "'\nfirst = " << p.first << "\nevery = " << p.every << "\ncount = " << p.count << "\n";
    if (p.magnitude_ms > 0) out << "magnitude_us = " << 1000 * p.magnitude_ms << "\n";
  }
  return path;
}

}  // namespace

Outcome walk(const Story& story) {
  auto scene = desk_run::scene(story.overrides);
  if (story.set_up) story.set_up(*scene);
  Walker person(story);
  teletact::DemoOptions options;
  options.fault_plan = write_plan(story);
  options.robot_options = [&](teletact::BoxOptions& box) {
    box.wrap_camera = [&](drivers::Camera& twin) { return person.camera(twin); };
  };
  options.robot_built = [&](teletact::RobotBox& box) { person.world.twins = box.twins(); };
  static_cast<void>(desk_run::run(*scene, kMost_s, person, options));
  teletact::g_stop_requested.store(false);
  return person.outcome;
}

}  // namespace walk
