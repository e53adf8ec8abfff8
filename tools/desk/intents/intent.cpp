#include "tools/desk/intents/intent.hpp"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>
#include <optional>

namespace teletact {

namespace {

using nlohmann::json;
using perception::Vec3;

// Reads keys of one object and counts them; what is left over at the end was not asked for.
class Keys {
 public:
  Keys(const json& object, std::string where) : object_(object), where_(std::move(where)) {}

  [[nodiscard]] bool has(const char* key) const { return object_.contains(key); }
  void number(const char* key, double& out, double low, double high) {
    const json* v = take(key);
    if (v == nullptr) return;
    if (!v->is_number()) return wrong(key, "is no number");
    const double d = v->get<double>();
    if (!std::isfinite(d) || d < low || d > high) return wrong(key, "is out of range");
    out = d;
  }
  void whole(const char* key, std::int64_t& out, std::int64_t low, std::int64_t high) {
    const json* v = take(key);
    if (v == nullptr) return;
    if (!v->is_number_integer()) return wrong(key, "is no whole number");
    if (v->is_number_unsigned() && v->get<std::uint64_t>() > 0x7FFFFFFFFFFFFFFFULL)
      return wrong(key, "is out of range");
    const auto n = v->get<std::int64_t>();
    if (n < low || n > high) return wrong(key, "is out of range");
    out = n;
  }
  void flag(const char* key, bool& out) {
    const json* v = take(key);
    if (v == nullptr) return;
    if (!v->is_boolean()) return wrong(key, "is neither true nor false");
    out = v->get<bool>();
  }
  void text(const char* key, std::string& out, std::size_t most) {
    const json* v = take(key);
    if (v == nullptr) return;
    if (!v->is_string()) return wrong(key, "is no text");
    const auto& s = v->get_ref<const std::string&>();
    if (s.empty() || s.size() > most) return wrong(key, "is empty or too long");
    const bool control = std::any_of(s.begin(), s.end(), [](char c) {
      return static_cast<unsigned char>(c) < 0x20 || static_cast<unsigned char>(c) == 0x7F;
    });
    if (control) return wrong(key, "holds control characters");
    out = s;
  }
  void vector(const char* key, Vec3& out, double low, double high) {
    const json* v = take(key);
    if (v != nullptr && !vector_of(*v, out, low, high)) wrong(key, "is no [x, y, z] in range");
  }
  void vectors(const char* key, std::vector<Vec3>& out, std::size_t most, double limit) {
    const json* v = take(key);
    if (v == nullptr) return;
    if (!v->is_array() || v->empty() || v->size() > most)
      return wrong(key, "is no list of 1 to 128 points");
    for (const json& e : *v) {
      if (!vector_of(e, out.emplace_back(), -limit, limit))
        return wrong(key, "holds what is no [x, y, z] in range");
    }
  }
  [[nodiscard]] const json* take(const char* key) {
    const auto found = object_.find(key);
    if (found == object_.end()) {
      wrong(key, "is missing");
      return nullptr;
    }
    ++taken_;
    return &*found;
  }
  void wrong(const char* key, const char* what) {
    if (why_.empty()) why_ = where_ + key + " " + what;
  }
  // Of an envelope `id` and `act` were read already.
  [[nodiscard]] const std::string& end(std::size_t read_before) {
    if (why_.empty() && object_.size() != taken_ + read_before)
      why_ = where_.empty() ? "has a key that this act does not know"
                            : where_ + " has a key that it does not know";
    return why_;
  }
  [[nodiscard]] std::string& why() noexcept { return why_; }

 private:
  [[nodiscard]] static bool vector_of(const json& v, Vec3& out, double low, double high) {
    if (!v.is_array() || v.size() != 3) return false;
    for (std::size_t i = 0; i < 3; ++i) {
      if (!v[i].is_number()) return false;
      const double d = v[i].get<double>();
      if (!std::isfinite(d) || d < low || d > high) return false;
      out(static_cast<int>(i)) = d;
    }
    return true;
  }
  const json& object_;
  std::string where_, why_;
  std::size_t taken_ = 0;
};

constexpr double kPlace = IntentLimits::kPlace_m, kPi = std::numbers::pi;

void read_token(Keys& k, Intent& in) {
  double page_s = 0;  // the server has said it back
  if (k.has("t")) k.number("t", page_s, -IntentLimits::kPage_s, IntentLimits::kPage_s);
  const json* holds = k.take("holds");
  if (holds == nullptr) return;
  if (!holds->is_array() || holds->size() > 3) return k.wrong("holds", "is no list of holds");
  for (const json& h : *holds) {
    const std::string name = h.is_string() ? h.get<std::string>() : std::string();
    bool* of = name == "engage"  ? &in.hold_engage
               : name == "hand"  ? &in.hold_hand
               : name == "drive" ? &in.hold_drive
                                 : nullptr;
    if (of == nullptr || *of) return k.wrong("holds", "names no hold, or one twice");
    *of = true;
  }
}

void read_obstacle(Keys& k, Intent& in) {
  const json* o = k.take("obstacle");
  if (o == nullptr) return;
  if (!o->is_object()) return k.wrong("obstacle", "is no object");
  Keys of(*o, "obstacle.");
  std::int64_t id = 0;
  std::string kind;
  of.whole("id", id, 1, 999);
  of.text("kind", kind, 8);
  of.vector("centre", in.obstacle.centre_W, -kPlace, kPlace);
  of.vector("half", in.obstacle.half_m, 0.01, IntentLimits::kHalf_m);
  of.number("yaw", in.obstacle.yaw_rad, -kPi, kPi);
  if (kind != "disc" && kind != "box") of.wrong("kind", "is neither disc nor box");
  in.obstacle.id = static_cast<std::uint16_t>(id);
  in.obstacle.box = kind == "box";
  if (k.why().empty()) k.why() = of.end(0);
}

void read_name(Keys& k, const char* key, Intent& in) {
  k.text(key, in.text, IntentLimits::kMostName);
  const bool good = std::all_of(in.text.begin(), in.text.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '_' || c == '-';
  });
  if (!good) k.wrong(key, "may hold a-z, 0-9, _ and - alone");
}

void read_place(Keys& k, Intent& in) {
  k.number("x", in.p_W.x(), -kPlace, kPlace);
  k.number("y", in.p_W.y(), -kPlace, kPlace);
  in.turns = k.has("yaw");
  if (in.turns) k.number("yaw", in.yaw_rad, -kPi, kPi);
}

void read_hand(Keys& k, Intent& in) {
  k.vector("p", in.p_W, -kPlace, kPlace);
  k.vector("normal", in.normal_W, -1.001, 1.001);
  k.flag("press", in.press);
  k.flag("button", in.button);
  k.flag("clutch", in.clutch);
}

void read_drive(Keys& k, Intent& in) {
  constexpr double v = IntentLimits::kSpeed_m_per_s, w = IntentLimits::kTurn_rad_per_s;
  k.number("vx", in.vx, -v, v);
  k.number("vy", in.vy, -v, v);
  k.number("wz", in.wz, -w, w);
}

void read_click(Keys& k, Intent& in) {
  std::int64_t sign = 0;
  k.number("u", in.u, 0, 1);
  k.number("v", in.v, 0, 1);
  k.whole("sign", sign, -1, 1);
  k.flag("new", in.fresh);
  if (sign == 0) k.wrong("sign", "is neither 1 nor -1");
  in.sign = static_cast<int>(sign);
}

void read_device(Keys& k, Intent& in) {
  in.scale_given = k.has("scale");
  in.clutch_given = k.has("clutch");
  in.yaw_given = k.has("view_yaw");
  if (in.scale_given) k.number("scale", in.scale, 0.1, 20);
  if (in.clutch_given) k.flag("clutch", in.clutch);
  if (in.yaw_given) k.number("view_yaw", in.yaw_rad, -kPi, kPi);
}

void read_keys(Keys& k, Intent& in) {
  std::int64_t number = 0;
  switch (in.act) {
    case Act::kToken:
      return read_token(k, in);
    case Act::kHand:
      return read_hand(k, in);
    case Act::kDrive:
      return read_drive(k, in);
    case Act::kMark:
      return k.vectors("points", in.points_W, IntentLimits::kMostPoints, kPlace);
    case Act::kGoTo:
      return read_place(k, in);
    case Act::kDraw:
      return read_obstacle(k, in);
    case Act::kErase:
      k.whole("obstacle_id", number, 0, 999);
      in.obstacle_id = static_cast<std::uint16_t>(number);
      return;
    case Act::kUnmark:
      k.whole("mark_id", number, 1, 0xFFFFFFFFLL);
      in.mark_id = static_cast<std::uint64_t>(number);
      return;
    case Act::kForget:
      k.vector("centre", in.p_W, -kPlace, kPlace);
      return k.vector("half", in.half_m, 0.005, IntentLimits::kHalf_m);
    case Act::kNote:
      return k.text("text", in.text, IntentLimits::kMostText);
    case Act::kRecord:
      return k.flag("on", in.on);
    case Act::kDevice:
      return read_device(k, in);
    case Act::kSelect:
      return read_click(k, in);
    case Act::kAccept:
      k.whole("proposal", number, 1, 0xFFFFFFFFLL);
      in.proposal = static_cast<std::uint32_t>(number);
      if (k.has("name")) k.text("name", in.text, IntentLimits::kMostName);
      return;
    case Act::kSave:
    case Act::kOpen:
      return read_name(k, "name", in);
    case Act::kEngage:
    case Act::kHold:
    case Act::kClear:
    case Act::kCancel:
    case Act::kUndo:
      return;
  }
}

}  // namespace

rt::Result<Intent> read_intent(std::string_view act, const json& intent) {
  const auto name = std::find(kActNames.begin(), kActNames.end(), act);
  if (name == kActNames.end()) return rt::Error{"there is no such act"};
  if (!intent.is_object()) return rt::Error{"is no object"};
  Intent in;
  in.act = static_cast<Act>(name - kActNames.begin());
  Keys keys(intent, "");
  read_keys(keys, in);
  const std::size_t before = intent.contains("id") + intent.contains("act");
  const std::string& why = keys.end(before);
  if (!why.empty()) return rt::Error{std::string(act) + ": " + why};
  return in;
}

}  // namespace teletact
