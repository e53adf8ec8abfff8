#include "tools/desk/session_store.hpp"

#include <algorithm>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <stdexcept>

#include "tools/files/user_folder.hpp"
#include "tools/files/whole_file.hpp"

namespace teletact {

namespace {

namespace fs = std::filesystem;

std::string utc_now() {
  const std::time_t t = std::time(nullptr);
  std::tm utc{};
  char text[32];
  std::strftime(text, sizeof text, "%FT%TZ", ::gmtime_r(&t, &utc));
  return text;
}

// Folders under this one, whether they are sessions or not.
std::vector<std::string> names_in(const std::string& folder) {
  std::vector<std::string> names;
  std::error_code ec;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, ec)) {
    std::string name = entry.path().filename().string();
    if (is_session_name(name)) names.push_back(std::move(name));
  }
  return names;
}

}  // namespace

std::string default_session_folder() { return user_state_folder() + "/sessions"; }

rt::Result<SavedSession> SessionStore::read(const std::string& name) const {
  const fs::path file = fs::path(path_of(name)) / kSession;
  std::error_code ec;
  if (!is_session_name(name) || !fs::is_regular_file(file, ec))
    return rt::Error{"there is no saved session " + name};
  const auto bytes = fs::file_size(file, ec);
  if (ec || bytes > kMostBytes) return rt::Error{file.string() + ": is longer than 1 MiB"};
  std::ifstream in(file);
  std::ostringstream text;
  text << in.rdbuf();
  if (!in) return rt::Error{file.string() + ": can not be read"};
  auto session = read_session(name, text.str());
  if (!session) return rt::Error{file.string() + ": " + session.error()};
  return session;
}

rt::Result<bool> SessionStore::save(SavedSession session, const std::string& scene_toml) const {
  if (folder_.empty()) return rt::Error{"this run keeps no sessions"};
  if (!is_session_name(session.name)) return rt::Error{"a name has 1 to 40 of a-z, 0-9, _ and -"};
  const fs::path here = path_of(session.name);
  std::error_code ec;
  if (fs::exists(here / kSession, ec)) {
    const auto old = read(session.name);
    if (!old || old.value().world != session.world)
      return rt::Error{session.name + " is a session of another map: choose another name"};
  } else if (fs::exists(here, ec) && !fs::is_empty(here, ec)) {
    return rt::Error{here.string() + " holds files of no session: choose another name"};
  } else if (names_in(folder_).size() >= kMost) {
    return rt::Error{"there are 100 sessions: remove some from " + folder_};
  }
  fs::create_directories(here, ec);
  if (ec) return rt::Error{here.string() + ": can not be made: " + ec.message()};
  session.saved = utc_now();
  const bool there = fs::exists(here / kSession, ec);
  try {
    write_whole_file((here / kScene).string(), scene_toml, OnDisk::kWhenBack);
    write_whole_file((here / kSession).string(), session_text(session), OnDisk::kWhenBack);
  } catch (const std::runtime_error& e) {
    if (!there) {
      fs::remove(here / kScene, ec);
      fs::remove(here, ec);  // only if it is empty
    }
    return rt::Error{e.what()};
  }
  return true;
}

rt::Result<bool> SessionStore::save_map(const std::string& name, const std::string& bytes) const {
  try {
    write_whole_file((fs::path(path_of(name)) / kMap).string(), bytes, OnDisk::kWhenBack);
  } catch (const std::runtime_error& e) {
    return rt::Error{e.what()};
  }
  return true;
}

std::vector<SessionRow> SessionStore::list() const {
  std::vector<SessionRow> rows;
  if (folder_.empty()) return rows;
  for (const std::string& name : names_in(folder_)) {
    const auto session = read(name);
    if (!session) continue;
    std::error_code ec;
    rows.push_back({name, session.value().saved, session.value().world,
                    fs::exists(fs::path(path_of(name)) / kMap, ec)});
  }
  std::sort(rows.begin(), rows.end(), [](const SessionRow& a, const SessionRow& b) {
    return a.saved != b.saved ? a.saved > b.saved : a.name < b.name;
  });
  return rows;
}

// ---- its work -----------------------------------------------------------------------------------

SessionWorker::Done SessionWorker::work(Job job) const {
  Done out;
  out.kind = job.kind;
  out.asker = job.asker;
  out.id = job.id;
  if (job.kind == Job::Kind::kOpen) {
    auto read = store_.read(job.session.name);
    if (read)
      out.session = std::move(read).value();
    else
      out.why = read.error();
    return out;
  }
  if (job.kind == Job::Kind::kSave) {
    const auto saved = store_.save(job.session, job.scene_toml);
    if (!saved) out.why = saved.error();
    out.session = std::move(job.session);
  }
  out.rows = store_.list();
  return out;
}

}  // namespace teletact
