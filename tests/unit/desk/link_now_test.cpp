// The link's figures of the newest two seconds, against sums made by hand.
#include "tools/desk/link_now.hpp"

#include <gtest/gtest.h>

#include <vector>

#include "tasks/supervision/fault_ids.hpp"
#include "tools/desk/desk_text.hpp"

namespace {

using teletact::link_now;
using teletact::LinkNow;
using teletact::PictureLoss;

rt::Time at_ms(std::int64_t ms) { return rt::time_from_ns(ms * 1'000'000); }
tasks::LinkSample sample(std::int64_t ms, std::int64_t age_ms, std::uint32_t bytes, bool picture) {
  tasks::LinkSample s;
  s.stamp = at_ms(ms);
  s.made = at_ms(ms - age_ms);
  s.bytes = bytes;
  s.picture = picture;
  return s;
}

TEST(LinkNow, CountsWhatCameInTheNewestTwoSeconds) {
  std::vector<tasks::LinkSample> all;
  for (int i = 0; i < 100; ++i) all.push_back(sample(1000 + 50 * i, 80, 10'000, true));
  for (int i = 0; i < 100; ++i) all.push_back(sample(5950 + i / 10, 30, 100, false));
  // At 6 s: pictures of 4050 to 5950 count, 39 of them, and all states.
  const LinkNow l = link_now(all, at_ms(6000));
  EXPECT_DOUBLE_EQ(l.fps, 39 / 2.0);
  EXPECT_NEAR(l.mbit_s, 8e-6 * (39 * 10'000 + 100 * 100) / 2, 1e-12);
  EXPECT_NEAR(l.picture_age_ms, 6000 - 5950 + 80, 1e-6);
  EXPECT_NEAR(l.state_age_ms, 6000 - 5959 + 30, 1e-6);
}

TEST(LinkNow, ASilentLinkStillSaysHowOldTheNewestIs) {
  const std::vector<tasks::LinkSample> all{sample(1000, 80, 10'000, true),
                                           sample(1100, 30, 100, false)};
  const LinkNow l = link_now(all, at_ms(9000));
  EXPECT_EQ(l.fps, 0);
  EXPECT_EQ(l.mbit_s, 0);
  EXPECT_NEAR(l.picture_age_ms, 8080, 1e-6);
  EXPECT_NEAR(l.state_age_ms, 7930, 1e-6);
  EXPECT_EQ(link_now({}, at_ms(9000)), LinkNow{});
}

TEST(LinkNow, PicturesThatDidNotArriveAreAShare) {
  PictureLoss loss;
  EXPECT_LT(loss.share(), 0);
  loss.see(100, 50, at_ms(0));
  EXPECT_LT(loss.share(), 0);
  for (int i = 1; i <= 30; ++i) loss.see(100 + 4 * i, 50 + 3 * i, at_ms(100 * i));
  EXPECT_NEAR(loss.share(), 0.25, 1e-12);
  // What was lost long ago is forgotten.
  for (int i = 1; i <= 40; ++i) loss.see(220 + i, 140 + i, at_ms(3000 + 100 * i));
  EXPECT_EQ(loss.share(), 0);
  // The robot's box begins anew.
  loss.see(1, 181, at_ms(7100));
  EXPECT_LT(loss.share(), 0);
}

// What the page names as a fault does not wait for a change of mode: in hold a silence changes none.
TEST(LinkFacts, WhatIsWrongWithTheLinkNow) {
  using teletact::LinkFacts;
  LinkFacts f;
  EXPECT_EQ(f.fault(), rt::kNoFault) << "never heard: another box is waited for";
  f.closed = true;
  EXPECT_EQ(f.fault(), rt::kNoFault) << "none was open";
  f.closed = false;
  f.heard_ago_ms = LinkFacts::kSilent_ms;
  EXPECT_EQ(f.fault(), rt::kNoFault);
  f.heard_ago_ms = LinkFacts::kSilent_ms + 1;
  EXPECT_EQ(f.fault(), tasks::kFaultLinkSilent);
  f.heard_ago_ms = 1;
  f.closed = true;
  EXPECT_EQ(f.fault(), tasks::kFaultLinkSilent);
  f.refused = true;
  EXPECT_EQ(f.fault(), tasks::kFaultLinkRefused);
}

}  // namespace
