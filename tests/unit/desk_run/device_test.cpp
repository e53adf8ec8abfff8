// The haptic device's clutch, held from the page: the device moves, the hand in the scene does not.
// Its scale and turn, taken over by such a clutch.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "tests/unit/desk_run/person.hpp"

namespace {

using desk_run::Person;
using nlohmann::json;

TEST(DeskRun, TheClutchOfTheDeviceIsHeldFromThePageAndReplays) {
  auto s = desk_run::scene();
  Person p;
  p.viewers = 1;
  std::int64_t on = 0, off = 0, coarse = 0, map = 0;
  std::vector<bool> clutched;
  json held;
  p.act = [&](double t) {
    if (p.once("coarse", t, 0.4)) coarse = p.say({{"act", "device"}, {"scale", 6.0}});
    if (p.once("map", t, 0.5)) map = p.say({{"act", "device"}, {"scale", 2.0}, {"view_yaw", 0.5}});
    if (p.once("on", t, 2.0)) on = p.say({{"act", "device"}, {"clutch", true}});
    if (p.once("held", t, 2.9)) {
      clutched.push_back(p.seen().haptic.back().clutched);
      held = json::parse(p.text)["device"];
    }
    if (p.once("off", t, 3.0)) off = p.say({{"act", "device"}, {"clutch", false}});
    if (p.once("free", t, 3.5)) clutched.push_back(p.seen().haptic.back().clutched);
    if (p.once("again", t, 3.6)) p.say({{"act", "device"}, {"clutch", true}});
    // The page is gone: nobody holds it any more.
    if (p.once("gone", t, 4.0)) {
      teletact::RoleEvent left;
      left.kind = teletact::RoleEvent::Kind::kLeft;
      left.person.session = 1;
      left.person.role = teletact::ConsoleRole::kOperator;
      clutched.push_back(p.seen().haptic.back().clutched);
      p.desk->role(left);
    }
    if (p.once("alone", t, 4.5)) clutched.push_back(p.seen().haptic.back().clutched);
  };
  teletact::DemoOptions options;
  options.report = (desk_run::folder() / "clutch").string();
  options.record = true;
  options.log_folder = options.report + "/raw";
  static_cast<void>(desk_run::run(*s, 5, p, options));
  EXPECT_TRUE(p.answers[on].ok) << p.answers[on].why;
  EXPECT_TRUE(p.answers[off].ok) << p.answers[off].why;
  EXPECT_FALSE(p.answers[coarse].ok) << "what is stable hangs on the scene's scale";
  EXPECT_THAT(p.answers[coarse].why, testing::HasSubstr("0.69 to 5.50"));
  EXPECT_TRUE(p.answers[map].ok) << p.answers[map].why;
  EXPECT_THAT(clutched, testing::ElementsAre(true, false, true, false));
  EXPECT_TRUE(held["clutch"].get<bool>());
  EXPECT_NEAR(held["scale"].get<double>(), 2.0, 1e-4);
  EXPECT_TRUE(desk_run::same_again(options.log_folder, rt::Box::kOperator));
}

}  // namespace
