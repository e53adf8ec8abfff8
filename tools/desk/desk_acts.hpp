// What the page asks for, as inputs of the tasks: the same rings and words that a scene's script
// writes (tasks/contract/table.hpp: act, edit, drive; OperatorRequests). Everything by the
// console's thread, but stop().
//
//   engage   pressed, and held by tokens: without one for Hold::kLife the engagement is taken back.
//            Once it has ended, for whatever reason, a new press is needed.
//   drive    a velocity, held by tokens; the first of a press drops a goal that is being driven to,
//            so that letting go never sets the base off to somewhere. Refused, and the hold lost,
//            while the newest picture is older than 1 s.
//   hand     a place for the hand, held by tokens: touched with, marked with (page_hand.hpp). It
//            stays until another is said, as a pointer that rests, and goes with the token.
//   select,  clicks propose an object; what is accepted goes to fusion (desk_objects.hpp).
//   accept
//   device   the clutch of the haptic device, held until it is let go or the page is gone; its
//            scale and turn (page_hand.hpp).
//   record   begins and ends a piece of the run: its number and seconds are told in the events, for
//            `teletact report --from --to`. What a run leaves is written anyhow.
//   save,    what is in the scene, kept and put back (desk_sessions.hpp).
//   open
//   stop     sets the request that supervision latches, which the link sends on at once
//            (tasks/edges/command_edges.hpp). Any thread.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "tools/console/console_server.hpp"
#include "tools/desk/desk_events.hpp"
#include "tools/desk/desk_inbox.hpp"
#include "tools/desk/desk_objects.hpp"
#include "tools/desk/desk_sessions.hpp"
#include "tools/desk/hold.hpp"
#include "tools/desk/intents/desk_bounds.hpp"
#include "tools/desk/intents/desk_undo.hpp"
#include "tools/desk/intents/intent.hpp"
#include "tools/desk/page_hand.hpp"

namespace teletact {

class DeskActs {
 public:
  static constexpr std::size_t kMostObstacles = SavedSession::kMostObstacles,
                               kMostMarks = SavedSession::kMostMarks;
  // Names of the acts that are taken here; `hand` not where a haptic device is in its place.
  [[nodiscard]] std::vector<std::string_view> can() const;

  // `hand` null: the device's own hand alone. `clicks_at_once`: see ClickWorker.
  DeskActs(OperatorBox& box, OperatorConsole& console, DeskEvents& events, PageHand* hand,
           bool clicks_at_once, SessionPlace sessions = {});

  // An act of the inbox that was said at `at`. None: it is answered later, through `answer`.
  using Answer = std::function<void(std::uint32_t session, std::int64_t id, const ConsoleAnswer&)>;
  [[nodiscard]] std::optional<ConsoleAnswer> act(const DeskItem& item, rt::Time at, rt::Time now);
  // The newest velocity; none of it counts without its token. Empty: taken; else why not.
  [[nodiscard]] std::string drive(const Intent& intent, rt::Time at, rt::Time now);
  [[nodiscard]] std::string hand(const Intent& intent, rt::Time now);
  void left();    // the operator's page is gone
  void joined();  // another page
  // Once a tick, after the acts: what is held, and what was let go.
  void keep(rt::Time now, const Answer& answer);
  // Any thread.
  void stop() noexcept;

  [[nodiscard]] const std::map<std::uint16_t, DrawnObstacle>& obstacles() const noexcept {
    return obstacles_;
  }
  [[nodiscard]] const std::vector<ShownMark>& marks() const noexcept { return marks_; }
  [[nodiscard]] DeskObjects& objects() noexcept { return objects_; }
  [[nodiscard]] const DeskObjects& objects() const noexcept { return objects_; }
  [[nodiscard]] const DeskSessions& sessions() const noexcept { return sessions_; }
  // A piece of the run has begun and not ended.
  [[nodiscard]] bool recording() const noexcept { return piece_.from_s.has_value(); }
  // Of the haptic device, now: scene metres per hand metre.
  [[nodiscard]] double device_scale() const;
  [[nodiscard]] bool driving() const noexcept { return driving_; }
  // Holds that have ended though nobody let them go: the page learns of it, for its line was late.
  [[nodiscard]] std::vector<std::string> lost_holds() const {
    std::vector<std::string> lost;
    if (engage_hold_.lost()) lost.emplace_back("engage");
    if (touching_.hold.lost()) lost.emplace_back("hand");
    if (drive_hold_.lost()) lost.emplace_back("drive");
    return lost;
  }
  // Driven by hand the base goes into a keep-out, or is about to; empty: it does not.
  [[nodiscard]] const std::string& drive_warning() const noexcept { return keep_out_.text(); }
  struct FirstSteps {
    bool touch = false, mark = false, obstacle = false, object = false, stop = false;
  };
  [[nodiscard]] const FirstSteps& first_steps() const noexcept { return steps_; }

 private:
  static constexpr const char* kRingFull = "too many acts wait for the tasks: ask again";
  struct Touching {
    Hold hold;
    Intent wanted;
    std::uint64_t press = 0;  // of the hold, in which it was said
    bool on = false;
  };
  struct Piece {
    int begun = 0;
    std::optional<double> from_s;
  };
  struct Goals {
    // By acts: marks and places. Of the task's marks all more are the haptic hand's.
    std::uint64_t asked = 0;
    std::uint64_t mark = 0;        // whose goal is the newest of them; 0: a place, or it is dropped
    std::uint64_t hand_marks = 0;  // when the newest act asked: each later one has the goal now
  };
  // An act that is answered when the boxes have followed it, or did not in time.
  struct Waiting {
    std::uint32_t session = 0;
    std::int64_t id = 0;
    rt::Time since{};
  };
  [[nodiscard]] std::optional<ConsoleAnswer> engage(const DeskItem& item, rt::Time at,
                                                    rt::Time now);
  [[nodiscard]] std::optional<ConsoleAnswer> clear(const DeskItem& item, rt::Time now);
  [[nodiscard]] ConsoleAnswer mark(const Intent& in, rt::Time now);
  [[nodiscard]] ConsoleAnswer unmark(std::uint64_t id, rt::Time now);
  [[nodiscard]] ConsoleAnswer go_to(const Intent& in, rt::Time now);
  [[nodiscard]] ConsoleAnswer cancel(rt::Time now);
  // The haptic hand has made a mark since an act asked for a goal: the newest goal is the hand's.
  [[nodiscard]] bool goal_is_the_hands() const;
  [[nodiscard]] std::uint64_t hand_marks() const;
  void note_goal(std::uint64_t mark);
  [[nodiscard]] ConsoleAnswer draw(const DrawnObstacle& o, rt::Time now, bool undoable);
  [[nodiscard]] ConsoleAnswer drawn(const DrawnObstacle& o) const;
  [[nodiscard]] ConsoleAnswer erase(std::uint16_t id, rt::Time now, bool undoable);
  [[nodiscard]] ConsoleAnswer forget(const Intent& in, rt::Time now);
  [[nodiscard]] ConsoleAnswer device(const Intent& in, rt::Time now);
  [[nodiscard]] ConsoleAnswer undo(rt::Time now);
  [[nodiscard]] ConsoleAnswer record(bool on, rt::Time now);
  [[nodiscard]] bool push(tasks::OperatorAct act, rt::Time now);
  [[nodiscard]] bool push(tasks::SceneEdit edit, rt::Time now);
  [[nodiscard]] ConsoleAnswer take_back(UndoStep& step, rt::Time now);
  [[nodiscard]] ConsoleAnswer put_back_obstacles(UndoStep& step, rt::Time now);
  [[nodiscard]] std::string text_of(const UndoStep& step) const;
  void show_mark(ShownMark mark);
  void hide_mark(std::uint64_t id);
  void keep_stop(rt::Time now);
  void keep_engage(rt::Time now, const Answer& answer);
  [[nodiscard]] std::string drive_ended() const;
  void keep_drive(rt::Time now);
  void watch_keep_outs(rt::Time now);
  void keep_hand(rt::Time now);
  void keep_clear(rt::Time now, const Answer& answer);
  [[nodiscard]] drivers::RobotState heard_robot(rt::Time now) const;
  [[nodiscard]] std::string silence_refusal(rt::Time now) const;
  void keep_objects(rt::Time now, const Answer& answer);
  [[nodiscard]] SavedSession to_save() const;
  void keep_sessions(rt::Time now, const Answer& answer);

  OperatorBox& box_;
  OperatorConsole& console_;
  DeskEvents& events_;
  PageHand* hand_;
  double device_share_ = 1;  // of the scene's scale, as it was asked for
  Hold engage_hold_, drive_hold_;
  Touching touching_;
  bool engage_wanted_ = false, engaged_seen_ = false, driving_ = false;
  std::optional<Waiting> waiting_, clear_waits_;
  std::optional<rt::Time> clear_out_;  // since when no box is in a safe stop
  Intent drive_;
  rt::Time drive_at_{}, clear_from_{}, stop_from_{};
  std::uint64_t drive_press_ = 0;  // of the hold, whose goal was dropped
  std::uint64_t act_seq_ = 0, edit_seq_ = 0, drive_seq_ = 0, mark_id_ = 0;
  std::map<std::uint16_t, DrawnObstacle> obstacles_;
  std::vector<ShownMark> marks_;
  Goals goals_;
  DeskUndo undo_;
  KeepOutWatch keep_out_;
  Piece piece_;
  DeskObjects objects_;
  DeskSessions sessions_;
  rt::Time give_from_{};  // the ring has room for an object's edits then
  FirstSteps steps_;
  std::atomic<std::uint64_t> stops_{0};
  std::uint64_t stops_seen_ = 0;
};

}  // namespace teletact
