#include "tools/desk/saved_session.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <random>
#include <set>

namespace teletact {

namespace {

using nlohmann::json;
using perception::GivenObject;
using perception::Vec3;

constexpr int kFormat = 1;

json place(const Vec3& v) { return json::array({v.x(), v.y(), v.z()}); }

bool read_place_W(const json& j, Vec3& out) {
  if (!j.is_array() || j.size() != 3) return false;
  for (std::size_t i = 0; i < 3; ++i) {
    if (!j[i].is_number()) return false;
    const double d = j[i].get<double>();
    if (!std::isfinite(d) || std::abs(d) > IntentLimits::kPlace_m) return false;
    out(static_cast<int>(i)) = d;
  }
  return true;
}

json obstacle_json(const DrawnObstacle& o) {
  return {{"id", o.id},
          {"kind", o.box ? "box" : "disc"},
          {"centre", place(o.centre_W)},
          {"half", place(o.half_m)},
          {"yaw", o.yaw_rad}};
}

json object_json(const SavedObject& o) {
  json boxes = json::array();
  for (const Eigen::AlignedBox3d& box_W : o.object.boxes())
    boxes.push_back({{"min", place(box_W.min())}, {"max", place(box_W.max())}});
  return {{"name", o.name}, {"point", place(o.object.p_W)}, {"boxes", boxes}};
}

bool is_world(const std::string& s) {
  return s.size() == 16 && std::all_of(s.begin(), s.end(), [](char c) {
           return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f');
         });
}

// The list of this key, at most so long. Null: it is none.
const json* list_of(const json& j, const char* key, std::size_t most) {
  const auto found = j.find(key);
  if (found == j.end() || !found->is_array() || found->size() > most) return nullptr;
  return &*found;
}

// Each of these is empty where all was read, and else says what is wrong.
std::string read_text(const json& j, const char* key, std::size_t most, std::string& out) {
  const auto found = j.find(key);
  if (found == j.end() || !found->is_string()) return std::string(key) + " is missing or no text";
  out = found->get<std::string>();
  const bool control = std::any_of(out.begin(), out.end(),
                                   [](char c) { return static_cast<unsigned char>(c) < 0x20; });
  return out.size() > most || control ? std::string(key) + " is too long or no line"
                                      : std::string();
}

std::string read_obstacles(const json& j, SavedSession& out) {
  const json* all = list_of(j, "obstacles", SavedSession::kMostObstacles);
  if (all == nullptr) return "obstacles is no list of at most 32";
  std::set<std::uint16_t> ids;
  for (const json& o : *all) {
    auto read = read_intent("draw", {{"obstacle", o}});
    if (!read) return read.error();
    out.obstacles.push_back(read.value().obstacle);
    if (!ids.insert(out.obstacles.back().id).second) return "obstacles has an id twice";
  }
  return {};
}

std::string read_marks(const json& j, SavedSession& out) {
  const json* all = list_of(j, "marks", SavedSession::kMostMarks);
  if (all == nullptr) return "marks is no list of at most 32";
  for (const json& points : *all) {
    auto read = read_intent("mark", {{"points", points}});
    if (!read) return read.error();
    out.marks_W.push_back(std::move(read.value().points_W));
  }
  return {};
}

std::string read_object(const json& j, SavedObject& out) {
  constexpr auto kMost = static_cast<std::size_t>(GivenObject::kMost);
  if (!j.is_object() || j.size() != 3) return "an object has name, point and boxes";
  if (std::string why = read_text(j, "name", IntentLimits::kMostName, out.name); !why.empty())
    return "an object's " + why;
  const json* boxes = list_of(j, "boxes", kMost);
  if (boxes == nullptr || boxes->empty()) return "an object has 1 to 12 boxes";
  if (!j.contains("point") || !read_place_W(j["point"], out.object.p_W))
    return "an object's point is no [x, y, z] in range";
  for (const json& b : *boxes) {
    Vec3 low_W, high_W;
    const bool good = b.is_object() && b.size() == 2 && b.contains("min") && b.contains("max") &&
                      read_place_W(b["min"], low_W) && read_place_W(b["max"], high_W) &&
                      (high_W - low_W).minCoeff() > 0;
    if (!good) return "a box has min below max";
    out.object.boxes_W[static_cast<std::size_t>(out.object.count++)] = {low_W, high_W};
  }
  return out.object.contains(out.object.p_W) ? std::string()
                                             : std::string("an object's point lies in no box");
}

std::string read_objects(const json& j, SavedSession& out) {
  const json* all = list_of(j, "objects", SavedSession::kMostObjects);
  if (all == nullptr) return "objects is no list of at most 15";
  for (const json& o : *all) {
    if (std::string why = read_object(o, out.objects.emplace_back()); !why.empty()) return why;
  }
  return {};
}

std::string read_all(const json& j, SavedSession& out) {
  if (j.is_discarded() || !j.is_object()) return "is no JSON object";
  const auto format = j.find("format");
  if (format == j.end() || *format != kFormat) return "is of another version";
  if (j.size() != 6) return "has a key that it does not know";
  std::string why = read_text(j, "world", 16, out.world);
  if (why.empty() && !is_world(out.world)) why = "world is no 16 hexadecimal digits";
  if (why.empty()) why = read_text(j, "saved", 40, out.saved);
  if (why.empty()) why = read_obstacles(j, out);
  if (why.empty()) why = read_marks(j, out);
  if (why.empty()) why = read_objects(j, out);
  return why;
}

}  // namespace

bool is_session_name(std::string_view name) noexcept {
  return !name.empty() && name.size() <= IntentLimits::kMostName &&
         std::all_of(name.begin(), name.end(), [](char c) {
           return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '_' || c == '-';
         });
}

std::string new_world() {
  std::random_device chance;
  char text[17];
  std::snprintf(text, sizeof text, "%08x%08x", chance(), chance());
  return text;
}

std::string session_text(const SavedSession& s) {
  json obstacles = json::array(), marks = json::array(), objects = json::array();
  for (const DrawnObstacle& o : s.obstacles) obstacles.push_back(obstacle_json(o));
  for (const auto& points_W : s.marks_W) {
    json points = json::array();
    for (const Vec3& p_W : points_W) points.push_back(place(p_W));
    marks.push_back(std::move(points));
  }
  for (const SavedObject& o : s.objects) objects.push_back(object_json(o));
  const json all{{"format", kFormat},      {"world", s.world}, {"saved", s.saved},
                 {"obstacles", obstacles}, {"marks", marks},   {"objects", objects}};
  return all.dump(1, ' ', false, json::error_handler_t::replace) + "\n";
}

rt::Result<SavedSession> read_session(const std::string& name, std::string_view text) {
  SavedSession out;
  out.name = name;
  const std::string why = read_all(json::parse(text, nullptr, false), out);
  if (!why.empty()) return rt::Error{why};
  return out;
}

}  // namespace teletact
