// Clicks on a picture of a table with boxes: what is proposed, what does not count, and that the
// thread proposes what put() itself would.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <thread>

#include "tests/unit/perception_objects/table.hpp"
#include "tools/desk/click_worker.hpp"
#include "tools/desk/desk_views.hpp"

namespace {

using teletact::ClickAnswered;
using teletact::ClickRequest;
using teletact::ClickWorker;
using teletact::Proposal;
using testing::HasSubstr;

struct Picture {
  tests::Rendered image;
  std::shared_ptr<perception::RgbdFrame> frame = std::make_shared<perception::RgbdFrame>();
  perception::Pose X_WC = tests::carried(0);

  Picture() {
    rt::Random random(5, 0);
    tests::render(tests::kTable, X_WC, {}, random, image);
    frame->intrinsics = tests::kCamera;
    frame->has_colour = true;
    frame->exposure = rt::time_from_ns(1'000'000'000);
    for (int v = 0; v < tests::kH; ++v)
      for (int u = 0; u < tests::kW; ++u) {
        frame->rgb().at(u, v) = image.rgb.at(u, v);
        frame->depth().at(u, v) = image.depth.at(u, v);
      }
  }
  // The middle of what it shows of a solid; 0: a place of the table.
  ClickRequest click(int what, bool add, bool first) const {
    double su = 0, sv = 0, n = 0;
    for (int v = 0; v < tests::kH; ++v)
      for (int u = 0; u < tests::kW; ++u)
        if (image.truth.at(u, v) == what) su += u, sv += v, n += 1;
    ClickRequest r;
    r.session = 3;
    r.round = 9;
    r.u = what == 0 ? 0.5 : (su / n + 0.5) / tests::kW;
    r.v = what == 0 ? 0.95 : (sv / n + 0.5) / tests::kH;
    r.add = add;
    if (first) {
      r.frame = frame;
      r.X_WC = X_WC;
      r.claimed = true;
    }
    return r;
  }
  double iou(const Proposal& p, const std::set<int>& solids) const {
    double both = 0, either = 0;
    for (std::size_t i = 0; i < p.mask.size(); ++i) {
      const bool is = solids.contains(image.truth.data()[i]);
      both += is && p.mask[i] != 0 ? 1 : 0;
      either += is || p.mask[i] != 0 ? 1 : 0;
    }
    return both / either;
  }
};

ClickAnswered ask(ClickWorker& worker, ClickRequest r, std::int64_t id) {
  r.id = id;
  worker.put(std::move(r));
  std::vector<ClickAnswered> all;
  for (int i = 0; i < 3000 && all.empty(); ++i) {
    all = worker.take();
    if (all.empty()) std::this_thread::sleep_for(std::chrono::milliseconds{10});
  }
  if (all.size() != 1) return {};
  EXPECT_EQ(all[0].session, 3U);
  EXPECT_EQ(all[0].id, id);
  EXPECT_EQ(all[0].round, 9U);
  return all[0];
}

TEST(ClickWorker, ClicksAddAndTakeAwayAndWhatIsWrongDoesNotCount) {
  const Picture picture;
  ClickWorker worker(true);
  const auto none = ask(worker, picture.click(1, true, false), 1);
  EXPECT_THAT(none.why, HasSubstr("first click"));
  const auto one = ask(worker, picture.click(1, true, true), 2);
  ASSERT_TRUE(one.proposal) << one.why;
  EXPECT_EQ(one.proposal->number, 1U);
  EXPECT_EQ(one.proposal->clicks, 1);
  EXPECT_EQ(one.proposal->width, tests::kW);
  EXPECT_EQ(one.proposal->exposure, picture.frame->exposure);
  EXPECT_TRUE(one.proposal->claimed);
  EXPECT_GE(picture.iou(*one.proposal, {1}), 0.8);
  EXPECT_GE(one.proposal->object.count, 1);
  EXPECT_TRUE(one.proposal->object.contains(one.proposal->object.p_W));
  const auto against = ask(worker, picture.click(1, false, false), 3);
  EXPECT_THAT(against.why, HasSubstr("one pixel"));
  const auto two = ask(worker, picture.click(2, true, false), 4);
  ASSERT_TRUE(two.proposal) << two.why;
  EXPECT_EQ(two.proposal->clicks, 2) << "the wrong one does not count";
  EXPECT_EQ(two.proposal->number, 2U);
  EXPECT_GT(two.proposal->pixels, one.proposal->pixels);
  const auto three = ask(worker, picture.click(3, false, false), 5);
  ASSERT_TRUE(three.proposal) << three.why;
  EXPECT_EQ(three.proposal->clicks, 3);
  const auto anew = ask(worker, picture.click(3, true, true), 6);
  ASSERT_TRUE(anew.proposal) << anew.why;
  EXPECT_EQ(anew.proposal->clicks, 1);
  EXPECT_GE(picture.iou(*anew.proposal, {3}), 0.8);
}

TEST(ClickWorker, TheTableIsNoObject) {
  const Picture picture;
  ClickWorker worker(true);
  const auto table = ask(worker, picture.click(0, true, true), 1);
  EXPECT_FALSE(table.proposal);
  EXPECT_THAT(table.why, HasSubstr("stand on"));
  EXPECT_THAT(ask(worker, picture.click(1, true, false), 2).why, HasSubstr("first click"));
}

TEST(ClickWorker, ItsThreadProposesTheSameAndEndsWhileClicksWait) {
  const Picture picture;
  ClickWorker at_once(true);
  auto worker = std::make_unique<ClickWorker>(false);
  for (const int what : {1, 2}) {
    const auto want = ask(at_once, picture.click(what, true, what == 1), what);
    const auto have = ask(*worker, picture.click(what, true, what == 1), what);
    ASSERT_TRUE(want.proposal && have.proposal) << want.why << have.why;
    EXPECT_EQ(have.proposal->mask, want.proposal->mask);
    EXPECT_EQ(have.proposal->object.count, want.proposal->object.count);
    EXPECT_EQ(have.proposal->object.p_W, want.proposal->object.p_W);
  }
  int put = 0;
  for (; put < 100 && !worker->full(); ++put) worker->put(picture.click(1, true, true));
  EXPECT_GE(put, static_cast<int>(ClickWorker::kMostWaiting));
  worker.reset();  // does not wait for all of them, and does not hang
}

TEST(ClickWorker, TheViewIsBitsFromTheLowestOn) {
  Proposal p;
  p.number = 0x01020304;
  p.width = 5, p.height = 2;
  p.mask = {1, 0, 0, 1, 0, 0, 0, 0, 1, 1};
  EXPECT_THAT(teletact::selection_body(p),
              testing::ElementsAre(5, 0, 2, 0, 4, 3, 2, 1, 0b00001001, 0b00000011));
}

}  // namespace
