// A saved session as text: what a person has put into a scene. Map and settings lie beside it
// (session_store.hpp). Read strictly: each key has its type and range, as if a page had asked for
// it again, and whatever is wrong refuses the whole.
//
// All places are in W, which begins where a run begins. So a session says of which world it is, and
// only a run of the same world puts it back: the run that saved it, or one that started with its
// map.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "perception/objects/given_object.hpp"
#include "rt/result.hpp"
#include "tools/desk/intents/intent.hpp"

namespace teletact {

struct SavedObject {
  std::string name;  // as a person has called it; empty: by its number
  perception::GivenObject object;
};

struct SavedSession {
  static constexpr std::size_t kMostObstacles = 32, kMostMarks = 32, kMostObjects = 15;
  std::string name;
  std::string world;  // 16 hexadecimal digits
  std::string saved;  // UTC, 2026-11-25T19:00:00Z
  std::vector<DrawnObstacle> obstacles;
  std::vector<std::vector<perception::Vec3>> marks_W;
  std::vector<SavedObject> objects;
};

// [a-z0-9_-]{1,40}: a name of a folder everywhere, and no path.
[[nodiscard]] bool is_session_name(std::string_view name) noexcept;
// Of a world that begins now.
[[nodiscard]] std::string new_world();

// Without its name, which is the folder's.
[[nodiscard]] std::string session_text(const SavedSession& session);
[[nodiscard]] rt::Result<SavedSession> read_session(const std::string& name, std::string_view text);

}  // namespace teletact
