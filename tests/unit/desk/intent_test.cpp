// What a page may ask for, and that all else is refused as a whole.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "rt/random.hpp"
#include "tools/desk/intents/intent.hpp"

namespace {

using nlohmann::json;
using teletact::Act;
using teletact::Intent;
using teletact::read_intent;
using testing::HasSubstr;

rt::Result<Intent> read(const std::string& text) {
  const json j = json::parse(text);
  return read_intent(j["act"].get<std::string>(), j);
}

// One good intent of each act.
const std::vector<std::string>& good() {
  static const std::vector<std::string> all = {
      R"({"id":1,"act":"engage"})",
      R"({"id":2,"act":"hold"})",
      R"({"id":3,"act":"clear"})",
      R"({"id":4,"act":"token","holds":["engage","drive"]})",
      R"({"id":5,"act":"hand","p":[1,2,0.3],"normal":[0,0,1],"press":true,"button":false,"clutch":false})",
      R"({"id":6,"act":"drive","vx":0.3,"vy":-0.1,"wz":0})",
      R"({"id":7,"act":"mark","points":[[1,0,0],[1.1,0,0]]})",
      R"({"id":8,"act":"go_to","x":1.5,"y":-0.5})",
      R"({"id":9,"act":"go_to","x":1.5,"y":-0.5,"yaw":1.5})",
      R"({"id":10,"act":"cancel"})",
      R"({"id":11,"act":"draw","obstacle":{"id":3,"kind":"box","centre":[1,0,0],"half":[0.2,0.1,0.1],"yaw":0.2}})",
      R"({"id":12,"act":"erase","obstacle_id":0})",
      R"({"id":13,"act":"forget","centre":[1,0,0.2],"half":[0.2,0.2,0.2]})",
      R"({"id":14,"act":"undo"})",
      R"({"id":15,"act":"note","text":"here"})",
      R"({"id":16,"act":"record","on":true})",
      R"({"id":17,"act":"device","scale":2})",
      R"({"id":18,"act":"select","u":0.5,"v":0.5,"sign":1,"new":true})",
      R"({"id":19,"act":"accept","proposal":4,"name":"bin"})",
      R"({"id":20,"act":"save","name":"a-1_b"})",
      R"({"id":21,"act":"open","name":"a-1_b"})",
      R"({"id":22,"act":"unmark","mark_id":3})"};
  return all;
}

TEST(Intents, EachActIsReadWithItsKeys) {
  std::set<Act> seen;
  for (const auto& text : good()) {
    const auto in = read(text);
    ASSERT_TRUE(in) << text << ": " << in.error();
    seen.insert(in.value().act);
  }
  EXPECT_EQ(seen.size(), teletact::kActNames.size()) << "an act without a good intent here";
  const auto drive = read(good()[5]).value();
  EXPECT_EQ(drive.vx, 0.3);
  EXPECT_EQ(drive.vy, -0.1);
  const auto box = read(good()[10]).value().obstacle;
  EXPECT_TRUE(box.box);
  EXPECT_EQ(box.id, 3);
  EXPECT_EQ(box.half_m.x(), 0.2);
  EXPECT_FALSE(read(good()[7]).value().turns);
  EXPECT_TRUE(read(good()[8]).value().turns);
  EXPECT_EQ(read(good()[6]).value().points_W.size(), 2U);
  const auto token = read(good()[3]).value();
  EXPECT_TRUE(token.hold_engage && token.hold_drive && !token.hold_hand);
  EXPECT_TRUE(read(R"({"act":"token","holds":["hand"],"t":1234.5})").value().hold_hand);
  EXPECT_FALSE(read(R"({"act":"token","holds":["hand"],"t":"now"})"));
}

// Every key of every act: taken away, of another type, and one too many.
TEST(Intents, AWrongKeyRefusesTheWhole) {
  const std::set<std::string> optional = {"yaw", "scale", "name"};
  for (const auto& text : good()) {
    const json whole = json::parse(text);
    const std::string act = whole["act"];
    json more = whole;
    more["extra"] = 1;
    EXPECT_FALSE(read_intent(act, more)) << more;
    for (const auto& [key, value] : whole.items()) {
      if (key == "id" || key == "act") continue;
      json changed = whole;
      changed[key] = json::object();
      const auto typed = read_intent(act, changed);
      ASSERT_FALSE(typed) << changed;
      EXPECT_THAT(typed.error(), HasSubstr(act));
      changed.erase(key);
      const bool may = optional.count(key) > 0 && act != "save" && act != "open";
      EXPECT_EQ(read_intent(act, changed).has_value(), may) << changed;
    }
  }
}

TEST(Intents, RangesAreKept) {
  for (
      const char* text :
      {R"({"act":"drive","vx":2.1,"vy":0,"wz":0})",
       R"({"act":"drive","vx":0,"vy":0,"wz":-3.5})",
       R"({"act":"go_to","x":1e9,"y":0})",
       R"({"act":"go_to","x":0,"y":0,"yaw":4})",
       R"({"act":"mark","points":[]})",
       R"({"act":"mark","points":[[1,2]]})",
       R"({"act":"mark","points":[[1,2,"3"]]})",
       R"({"act":"erase","obstacle_id":1000})",
       R"({"act":"erase","obstacle_id":1.5})",
       R"({"act":"erase","obstacle_id":18446744073709551615})",
       R"({"act":"token","holds":["engage","engage"]})",
       R"({"act":"token","holds":["all"]})",
       R"({"act":"token","holds":[1]})",
       R"({"act":"save","name":"../x"})",
       R"({"act":"save","name":"A"})",
       R"({"act":"note","text":""})",
       R"({"act":"note","text":"a\nb"})",
       R"({"act":"select","u":1.1,"v":0,"sign":1,"new":true})",
       R"({"act":"select","u":1,"v":0,"sign":0,"new":true})",
       R"({"act":"accept","proposal":0})",
       R"({"act":"draw","obstacle":{"id":0,"kind":"box","centre":[0,0,0],"half":[1,1,1],"yaw":0}})",
       R"({"act":"draw","obstacle":{"id":1,"kind":"cone","centre":[0,0,0],"half":[1,1,1],"yaw":0}})",
       R"({"act":"draw","obstacle":{"id":1,"kind":"box","centre":[0,0,0],"half":[0,1,1],"yaw":0}})",
       R"({"act":"draw","obstacle":{"id":1,"kind":"box","centre":[0,0,0],"half":[1,1,1],"yaw":0,"z":0}})",
       R"({"act":"fly"})",
       R"({"act":""})"}) {
    EXPECT_FALSE(read(text)) << text;
  }
  std::string many = R"({"act":"mark","points":[)";
  for (int i = 0; i < 129; ++i) many += i > 0 ? ",[0,0,0]" : "[0,0,0]";
  EXPECT_FALSE(read(many + "]}"));
}

// Any JSON in any key: read or refused, never anything but finite numbers in range.
TEST(Intents, AnyJsonIsReadOrRefused) {
  constexpr std::uint64_t kSeed = 210701;
  SCOPED_TRACE(kSeed);
  rt::Random r(kSeed, 0);
  const auto any = [&](auto&& self, int depth) -> json {
    switch (r.integer(0, depth > 3 ? 5 : 7)) {
      case 0:
        return nullptr;
      case 1:
        return r.integer(0, 1) == 1;
      case 2:
        return r.integer(-2, 1001);
      case 3:
        return (static_cast<double>(r.integer(-4000, 4000))) / 1000;
      case 4:
        return std::string(static_cast<std::size_t>(r.integer(0, 210)), 'a');
      case 5:
        return r();
      case 6: {
        json a = json::array();
        for (std::int64_t i = r.integer(0, 4); i > 0; --i) a.push_back(self(self, depth + 1));
        return a;
      }
      default: {
        json o = json::object();
        for (const char* k : {"id", "kind", "centre", "half", "yaw"})
          if (r.integer(0, 3) > 0) o[k] = self(self, depth + 1);
        return o;
      }
    }
  };
  int read_ones = 0;
  for (int i = 0; i < 20000; ++i) {
    json j = json::parse(good()[static_cast<std::size_t>(r.integer(0, 20))]);
    const std::string act = j["act"];
    for (auto& [key, value] : j.items())
      if (key != "act" && r.integer(0, 3) == 0) value = any(any, 0);
    const auto in = read_intent(act, j);
    if (!in) {
      EXPECT_FALSE(in.error().empty());
      continue;
    }
    ++read_ones;
    const Intent& n = in.value();
    EXPECT_TRUE(n.p_W.allFinite() && n.half_m.allFinite() && std::isfinite(n.yaw_rad));
    EXPECT_LE(std::abs(n.vx), 2.0);
    EXPECT_LE(n.points_W.size(), 128U);
    EXPECT_LE(n.text.size(), 200U);
  }
  EXPECT_GT(read_ones, 1000);
}

}  // namespace
