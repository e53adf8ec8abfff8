// Saved sessions on disk.
//
//   FOLDER/NAME/scene.toml     the scene as it was in effect: the settings
//   FOLDER/NAME/session.json   keep-outs, marks, objects (saved_session.hpp); written last: what
//                              has none is no session
//   FOLDER/NAME/fusion.map     the map, once the run that saved it has ended: only then does nobody
//                              write it, and a copy in the midst of a run would hold fusion up
//
// Each file appears whole or not at all, and is on the disk when it is there. A session is replaced
// by a run of its own world alone, so no map ever lies beside places of another one.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tools/desk/desk_thread.hpp"
#include "tools/desk/saved_session.hpp"

namespace teletact {

struct SessionRow {
  std::string name, saved, world;
  bool map = false;  // its map is on the disk
};

// By any ordinary thread; each call waits for the disk.
class SessionStore {
 public:
  static constexpr std::size_t kMost = 100, kMostBytes = std::size_t{1} << 20U;
  static constexpr const char *kScene = "scene.toml", *kSession = "session.json",
                              *kMap = "fusion.map";

  // Empty: sessions are not kept.
  explicit SessionStore(std::string folder) : folder_(std::move(folder)) {}
  [[nodiscard]] const std::string& folder() const noexcept { return folder_; }
  [[nodiscard]] std::string path_of(const std::string& name) const { return folder_ + "/" + name; }

  // Sets when it was saved. The error is one line for a person.
  [[nodiscard]] rt::Result<bool> save(SavedSession session, const std::string& scene_toml) const;
  [[nodiscard]] rt::Result<bool> save_map(const std::string& name, const std::string& bytes) const;
  [[nodiscard]] rt::Result<SavedSession> read(const std::string& name) const;
  // Newest first. What can not be read is left out.
  [[nodiscard]] std::vector<SessionRow> list() const;

 private:
  std::string folder_;
};

// The folder of this user's sessions: XDG_STATE_HOME, else ~/.local/state, with teletact/sessions.
[[nodiscard]] std::string default_session_folder();

// What the console's thread must not wait for. Nothing runs before the first job.
class SessionWorker {
 public:
  static constexpr std::size_t kMostWaiting = 4;
  struct Job {
    enum class Kind : std::uint8_t { kList, kSave, kOpen } kind = Kind::kList;
    std::uint32_t asker = 0;  // who is answered, by what number
    std::int64_t id = 0;
    SavedSession session;    // of kOpen its name alone
    std::string scene_toml;  // kSave
  };
  struct Done {
    Job::Kind kind = Job::Kind::kList;
    std::uint32_t asker = 0;
    std::int64_t id = 0;
    std::string why;               // empty: done
    SavedSession session;          // as it was saved, or read
    std::vector<SessionRow> rows;  // kList, kSave
  };

  // `at_once`: put() itself does the work. For runs that must be the same each time.
  // What was asked for before the end is still saved.
  SessionWorker(std::string folder, bool at_once)
      : store_(std::move(folder)), thread_(kMostWaiting, at_once, AtEnd::kDone, [this](Job job) {
          return work(std::move(job));
        }) {}
  SessionWorker(const SessionWorker&) = delete;
  SessionWorker& operator=(const SessionWorker&) = delete;

  [[nodiscard]] const SessionStore& store() const noexcept { return store_; }
  // False: as many wait as may.
  [[nodiscard]] bool put(Job job) { return thread_.put(std::move(job)); }
  [[nodiscard]] std::vector<Done> take() { return thread_.take(); }

 private:
  [[nodiscard]] Done work(Job job) const;

  SessionStore store_;
  DeskThread<Job, Done> thread_;
};

}  // namespace teletact
