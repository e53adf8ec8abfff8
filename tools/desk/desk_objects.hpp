// Objects by clicks: select, accept. By the console's thread.
//
//   select   the first click takes the newest picture; where the camera was in it is known as soon
//            as fusion has consumed it. Each click is answered when the click worker has: with a
//            proposal, which is shown, or with why it does not count.
//   accept   the newest proposal's boxes go to fusion as edits (tasks/contract/scene_edit.hpp). It
//            is answered when the list of objects holds one more there.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "tools/console/console_server.hpp"
#include "tools/desk/click_worker.hpp"
#include "tools/desk/desk_inbox.hpp"
#include "tools/desk/saved_session.hpp"
#include "tools/host/console.hpp"

namespace teletact {

// A proposal that is to be shown to a session.
struct ShownProposal {
  std::uint32_t session = 0;
  std::shared_ptr<const Proposal> proposal;
};

struct NamedObject {
  std::uint32_t serial = 0;
  std::string name;
};

class DeskObjects {
 public:
  using Answer = std::function<void(std::uint32_t session, std::int64_t id, const ConsoleAnswer&)>;
  using Push = std::function<bool(const tasks::SceneEdit&, rt::Time now)>;

  // `clicks_at_once`: see ClickWorker. `push` hands an edit to fusion; false: no room.
  DeskObjects(OperatorBox& box, bool clicks_at_once, Push push);

  // None: answered later, by keep().
  [[nodiscard]] std::optional<ConsoleAnswer> select(const DeskItem& item, rt::Time now);
  [[nodiscard]] std::optional<ConsoleAnswer> accept(const DeskItem& item, const OperatorView& seen,
                                                    rt::Time now);
  // An object of a saved session, as if it were proposed and accepted now; nobody is answered.
  // What is an object there already takes its name. kLater: the camera does not know where it is,
  // or another one is not named yet. What is not seen there now stays with what is saved.
  enum class Given : std::uint8_t { kDone, kLater, kNoRoom };
  [[nodiscard]] Given give(const SavedObject& object, const OperatorView& seen, rt::Time now);
  // All that is an object by boxes, where it still lies, and what was not seen.
  [[nodiscard]] std::vector<SavedObject> to_save(const OperatorView& seen) const;
  void forget_unseen() { unseen_.clear(); }
  // What was given and not found, since the last call: a line each.
  [[nodiscard]] std::vector<std::string> take_missed();
  // Is none any more. False: no room.
  [[nodiscard]] bool drop(std::uint32_t serial, rt::Time now);
  // Another person, or nobody: what was clicked is forgotten.
  void forget();
  // Once a tick. An object that has been named since the last.
  [[nodiscard]] std::optional<NamedObject> keep(const OperatorView& seen, rt::Time now,
                                                const Answer& answer);
  [[nodiscard]] std::vector<ShownProposal> take_shown();
  // "object 3", unless a person has called it something else.
  [[nodiscard]] std::string name_of(std::uint32_t serial) const;

 private:
  struct WaitingClick {
    ClickRequest request;
    rt::Time since{};
  };
  struct WaitingObject {
    std::uint32_t session = 0;
    std::int64_t id = 0;
    rt::Time since{};
    std::uint32_t newest_before = 0;  // serial
    SavedObject what;
    bool answered = true;  // somebody waits for an answer
  };
  [[nodiscard]] std::string why_not(const OperatorView& seen, std::uint32_t proposal) const;
  [[nodiscard]] std::string why_not(const OperatorView& seen,
                                    const perception::GivenObject& object) const;
  void miss(std::string why, const Answer& answer);
  [[nodiscard]] bool push_all(const perception::GivenObject& object, rt::Time now);
  void hand_over_clicks(const OperatorView& seen, rt::Time now, const Answer& answer);
  void answer_clicks(const Answer& answer);

  OperatorBox& box_;
  Push push_;
  ClickWorker worker_;
  std::uint64_t round_ = 0;  // of a person's clicks
  bool chosen_ = false;      // there was a first click in this round
  std::deque<WaitingClick> clicks_;
  std::shared_ptr<const Proposal> proposed_;
  std::vector<ShownProposal> shown_;
  std::optional<WaitingObject> waiting_;
  std::map<std::uint32_t, std::string> names_;
  std::map<std::uint32_t, SavedObject> given_;  // by serial
  std::vector<SavedObject> unseen_;             // of an opened session
  std::vector<std::string> missed_;
};

}  // namespace teletact
