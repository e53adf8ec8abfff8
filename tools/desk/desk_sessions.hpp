// Save and open: what a person has put into the scene, kept and put back. By the console's thread;
// the disk is the worker's (session_store.hpp).
//
//   save   keep-outs, marks and objects as they are now, and the scene's settings. The map follows
//          when the run has ended (PageDesk).
//   open   puts them back by the same inputs as when they were made, so a recording holds them: all
//          that is drawn goes, then one edit after another, as the ring takes them. Strokes are
//          shown again and no goal is set by them: opening never moves the base. Objects follow one
//          by one, each as soon as the camera knows where it is.
//
// While keep-outs are put back some are missing, so the base holds, and no act on the scene is
// taken.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "rt/time.hpp"
#include "tools/console/console_server.hpp"
#include "tools/desk/desk_inbox.hpp"
#include "tools/desk/session_store.hpp"

namespace teletact {

struct SessionPlace {
  std::string folder;                    // of all sessions; empty: none are kept
  std::string world = new_world();       // of this run: its own, or the one it started with
  std::string scene_toml;                // in effect
  std::optional<SavedSession> at_start;  // put back as soon as the run goes
};

// What is done to the scene, by whoever makes inputs of it. False: no room now.
struct SessionHands {
  std::function<std::string()> why_not;  // empty: a session may be put back now
  std::function<bool()> erase_all;
  std::function<bool(const DrawnObstacle&)> draw;
  std::function<void(std::vector<std::vector<perception::Vec3>>)> marks;
  std::function<bool(const SavedObject&)> give;  // false: later
  std::function<void(const std::string&)> tell;  // for the timeline
};

class DeskSessions {
 public:
  using Answer = std::function<void(std::uint32_t session, std::int64_t id, const ConsoleAnswer&)>;
  // Most rows that are told of.
  static constexpr std::size_t kMostRows = 32;

  // `at_once`: see SessionWorker.
  DeskSessions(SessionPlace place, bool at_once);

  // None: answered later. `now` without name and world.
  [[nodiscard]] std::optional<ConsoleAnswer> save(const DeskItem& item, SavedSession now);
  [[nodiscard]] std::optional<ConsoleAnswer> open(const DeskItem& item);
  // Keep-outs are being put back.
  [[nodiscard]] bool opening() const noexcept { return opening_.has_value(); }
  // Once a tick.
  void keep(const SessionHands& hands, const Answer& answer);

  // Objects that are still to be put back.
  [[nodiscard]] const std::deque<SavedObject>& objects_left() const noexcept { return objects_; }
  // Newest first.
  [[nodiscard]] const std::vector<SessionRow>& rows() const noexcept { return rows_; }
  [[nodiscard]] const std::string& world() const noexcept { return place_.world; }
  // Of this run, whose map is still to be written.
  [[nodiscard]] const std::vector<std::string>& saved() const noexcept { return saved_; }
  [[nodiscard]] const SessionStore& store() const noexcept { return worker_.store(); }

 private:
  struct Opening {
    std::uint32_t asker = 0;
    std::int64_t id = 0;
    SavedSession session;
    bool erased = false;
    std::size_t drawn = 0;
  };
  [[nodiscard]] bool put(SessionWorker::Job job);
  void take(SessionWorker::Done done, const SessionHands& hands, const Answer& answer);
  void begin(Opening opening, const SessionHands& hands, const Answer& answer);
  void put_back(const SessionHands& hands, const Answer& answer);

  SessionPlace place_;
  SessionWorker worker_;
  std::vector<SessionRow> rows_;
  std::vector<std::string> saved_;
  bool asked_ = false, listed_ = false;  // one save or open at a time
  std::optional<Opening> opening_;
  std::deque<SavedObject> objects_;
};

}  // namespace teletact
