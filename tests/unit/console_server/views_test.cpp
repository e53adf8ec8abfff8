// Over the wire: views out. Newest wins, memory is bounded, with nobody there nothing is kept.
#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <fstream>
#include <thread>

#include "perception/tsdf/mesh/mesh_deltas.hpp"
#include "support.hpp"
#include "tools/console/bulk_window.hpp"

namespace console_test {
namespace {

using teletact::Refusal;
using teletact::ViewKind;

std::size_t resident_bytes() {
  std::size_t all = 0, resident = 0;
  std::ifstream("/proc/self/statm") >> all >> resident;
  return resident * static_cast<std::size_t>(sysconf(_SC_PAGESIZE));
}

TEST_F(Console, AViewHasItsHeadAndBody) {
  start();
  EXPECT_FALSE(server_->publish(ViewKind::kPose, {}, "nobody there"));
  const auto s = open(join_operator());
  ASSERT_TRUE(wait_for([&] { return server_->viewers() == 1; }));
  ASSERT_TRUE(server_->publish(ViewKind::kText, {12.5, -1, 3}, "{\"a\":1}"));
  const Frame f = s->next(1);
  ASSERT_EQ(f.payload.size(), 24U + 7U);
  const unsigned char head[] = {1, 1, 3,    0,    0, 0, 0, 0, 0, 0, 0,    0,
                                0, 0, 0x29, 0x40, 0, 0, 0, 0, 0, 0, 0xf0, 0xbf};
  EXPECT_EQ(f.payload.substr(0, 24), std::string(reinterpret_cast<const char*>(head), 24));
  EXPECT_EQ(f.body(), "{\"a\":1}");
  ASSERT_TRUE(server_->publish(ViewKind::kText, {}, "{}"));
  EXPECT_EQ(s->next(1).sequence(), 1U);
}

TEST_F(Console, WhatIsTooLongOrNoViewIsRefused) {
  start();
  const auto s = open(join_operator());
  ASSERT_TRUE(wait_for([&] { return server_->viewers() == 1; }));
  const std::string text(65537, 'x');
  EXPECT_FALSE(server_->publish(ViewKind::kText, {}, text));
  EXPECT_TRUE(server_->publish(ViewKind::kText, {}, text.substr(1)));
  EXPECT_FALSE(server_->publish(ViewKind::kMesh, {}, "x"));
  EXPECT_FALSE(server_->publish(ViewKind::kAnswer, {}, "x"));
  EXPECT_FALSE(server_->publish(static_cast<ViewKind>(99), {}, "x"));
  EXPECT_EQ(server_->counts().views_refused, 4U);
}

TEST_F(Console, OneSessionsViewReachesItAlone) {
  start();
  const std::string cookie = join_operator();
  const auto a = open(cookie), b = open(join_viewer(cookie));
  ASSERT_TRUE(wait_for([&] { return server_->viewers() == 2; }));
  const std::uint32_t viewer = server_->people().at(1).session;
  const std::string body = "for b";
  server_->send_to(viewer, ViewKind::kSelection, {},
                   std::span(reinterpret_cast<const std::uint8_t*>(body.data()), body.size()));
  EXPECT_EQ(b->next().body(), "for b");
  server_->publish(ViewKind::kText, {}, "all");
  EXPECT_EQ(a->next().body(), "all") << "nothing before it";
}

TEST_F(Console, TooManyViewersAreRefused) {
  options_.most_viewers = 2;
  start();
  const std::string cookie = join_operator();
  const auto a = open(cookie), b = open(join_viewer(cookie));
  const Socket c(server_->port(), upgrade_head(join_viewer(cookie)));
  EXPECT_EQ(c.status(), 503);
  EXPECT_EQ(refused(Refusal::kCrowded), 1U);
  const auto again = open(cookie);
  EXPECT_EQ(again->status(), 101) << "a reload has its place";
}

// 400 pictures of 1 MiB to one that reads nothing: what waits is one picture, and the other viewer
// gets the newest.
TEST_F(Console, ASlowViewerCostsOnePictureAndNobodyElse) {
  options_.write_limit = std::chrono::seconds{600};
  start();
  const std::string cookie = join_operator();
  const auto quick = open(cookie), slow = open(join_viewer(cookie), 4096);
  ASSERT_TRUE(wait_for([&] { return server_->viewers() == 2; }));
  std::vector<std::uint8_t> picture(std::size_t{1} << 20U, 7);
  std::size_t before = 0, most = 0;
  for (std::uint32_t n = 0; n < 400; ++n) {
    ASSERT_TRUE(server_->publish(ViewKind::kPicture, {}, picture));
    EXPECT_EQ(quick->next(4).sequence(), n);
    if (n == 20) before = resident_bytes();
    if (n > 20) most = std::max(most, resident_bytes());
  }
  // Two pictures in flight, one that waits, sockets' buffers, an allocator's habits.
  EXPECT_LT(most, before + (std::size_t{32} << 20U));
  EXPECT_GE(server_->counts().views_replaced, 390U);
  // And when it reads at last, the newest is there after what had left.
  std::uint32_t last = 0;
  for (int i = 0; i < 4 && last != 399; ++i) last = slow->next(4).sequence();
  EXPECT_EQ(last, 399U);
}

// A page that reads its socket at once and takes in what came much later: what it has not seen is
// bounded by the rule of bulk_window.hpp, what is small goes past, and what comes next is the
// newest. The line is measured by a clock that the test moves.
TEST_F(Console, APageThatSaysWhatItHasSeenIsNotSentMoreThanItTakesIn) {
  constexpr std::uint64_t kSize = 200'024;  // of a picture with its head
  std::atomic<std::int64_t> now_ns{1'000'000'000};
  options_.line_clock = [&] { return now_ns.load(); };
  start();
  const auto page = open(join_operator());
  ASSERT_TRUE(wait_for([&] { return server_->viewers() == 1; }));
  const std::vector<std::uint8_t> picture(200'000, 7), pose(64, 1);
  teletact::BulkWindow rule;
  ASSERT_TRUE(server_->publish(ViewKind::kPicture, {}, picture));
  EXPECT_EQ(page->next(4).sequence(), 0U);
  rule.sent(kSize, now_ns);
  std::uint64_t seen = 0;
  int id = 0;
  const auto tell = [&](std::uint32_t pictures) {
    now_ns += 10'000'000;
    seen += kSize * pictures;
    EXPECT_TRUE(rule.seen(seen, now_ns));
    page->text("{\"id\":" + std::to_string(++id) +
               ",\"act\":\"seen\",\"bytes\":" + std::to_string(seen) + "}");
  };
  // The answer says that what came before it was taken.
  const auto tell_and_wait = [&](std::uint32_t pictures) {
    tell(pictures);
    page->text("{\"id\":" + std::to_string(++id) + ",\"act\":\"hold\"}");
    EXPECT_THAT(page->answer(), testing::HasSubstr("\"id\":" + std::to_string(id)));
  };
  tell_and_wait(1);
  for (std::uint32_t round = 0; round < 3; ++round) {
    std::uint32_t pictures = 0, most = 0;
    for (std::uint32_t n = 0; n < 20; ++n) {
      ASSERT_TRUE(server_->publish(ViewKind::kPicture, {}, picture));
      ASSERT_TRUE(server_->publish(ViewKind::kPose, {}, pose));
      for (;;) {  // up to this pose, which nothing holds back
        const auto view = page->next();
        ASSERT_EQ(view.opcode, 2);
        if (view.kind() == 2 && view.sequence() == 20 * round + n) break;
        if (view.kind() == 4) ++pictures;
      }
    }
    for (; rule.room(); ++most) rule.sent(kSize, now_ns);
    EXPECT_EQ(pictures, most);
    EXPECT_LE(most, 4U) << "a round holds more than that";
    tell(pictures);
    // Held back meanwhile: the newest of the round.
    EXPECT_EQ(page->next(4).sequence(), 20 * round + 20);
    rule.sent(kSize, now_ns);
    tell_and_wait(1);
  }
  EXPECT_GT(server_->counts().views_replaced, 40U);
}

TEST_F(Console, WhoDoesNotReadIsCut) {
  options_.write_limit = std::chrono::milliseconds{500};
  start();
  const auto s = open(join_operator(), 4096);
  ASSERT_TRUE(wait_for([&] { return server_->viewers() == 1; }));
  const std::vector<std::uint8_t> picture(std::size_t{2} << 20U, 7);
  EXPECT_TRUE(wait_for([&] {
    server_->publish(ViewKind::kPicture, {}, picture);
    return server_->viewers() == 0;
  }));
  EXPECT_EQ(refused(Refusal::kSlow), 1U);
}

TEST_F(Console, AnswersThatAreNotReadEndTheConnection) {
  options_.write_limit = std::chrono::seconds{600};
  callbacks_.on_act = [](const teletact::ConsoleAct&) {
    return std::optional(teletact::ConsoleAnswer{true, "", "\"" + std::string(50000, 'x') + "\""});
  };
  start();
  const auto s = open(join_operator(), 4096);
  ASSERT_TRUE(wait_for([&] { return server_->viewers() == 1; }));
  for (int id = 1; id <= 190; ++id) s->text("{\"id\":" + std::to_string(id) + ",\"act\":\"save\"}");
  EXPECT_TRUE(wait_for([&] { return server_->viewers() == 0; }));
  EXPECT_EQ(refused(Refusal::kSlow), 1U);
}

TEST_F(Console, SilenceEndsAViewer) {
  options_.silence_limit = std::chrono::milliseconds{600};
  start();
  const auto s = open(join_operator());
  // Its pings are not answered.
  EXPECT_TRUE(wait_for([&] { return server_->viewers() == 1; }));
  EXPECT_TRUE(wait_for([&] { return server_->viewers() == 0; }));
}

perception::MeshDelta& one_block(perception::MeshDelta& d, int x, bool restart) {
  d = {};
  d.restart = restart;
  d.block_count = 1;
  d.blocks[0].at = {x, 0, 0};
  d.blocks[0].version = 1;
  return d;
}

TEST_F(Console, TheMeshBeginsAnewWhenViewersComeBack) {
  const auto d = std::make_unique<perception::MeshDelta>();
  start();
  EXPECT_FALSE(server_->publish_mesh(one_block(*d, 1, true), {}, 0.08)) << "nobody there";
  const std::string cookie = join_operator();
  for (int round = 1; round <= 2; ++round) {
    auto s = open(cookie);
    ASSERT_TRUE(wait_for([&] { return server_->viewers() == 1; }));
    EXPECT_TRUE(server_->wants_whole_mesh());
    EXPECT_FALSE(server_->publish_mesh(one_block(*d, 2, false), {}, 0.08)) << "has holes";
    ASSERT_TRUE(server_->publish_mesh(one_block(*d, 3, true), {}, 0.08));
    EXPECT_FALSE(server_->wants_whole_mesh());
    const Frame whole = s->next(3);
    ASSERT_EQ(whole.body().size(), 12U + 20U + 4U);
    EXPECT_EQ(whole.body()[4], 1) << "restart";
    EXPECT_EQ(whole.body()[12], 3);
    ASSERT_TRUE(server_->publish_mesh(one_block(*d, 4, false), {}, 0.08));
    EXPECT_EQ(s->next(3).body()[12], 4);
    // A second viewer gets all of it.
    const auto late = open(join_viewer(cookie));
    const std::string all = late->next(3).body();
    ASSERT_EQ(all.size(), 12U + 40U + 4U);
    EXPECT_EQ(all[8], 2) << "blocks";
    s.reset();
    late->frame(8, "");
    ASSERT_TRUE(wait_for([&] { return server_->viewers() == 0; }));
    EXPECT_EQ(server_->counts().mesh_blocks, 0U);
  }
}

TEST_F(Console, TwoHundredReconnectsLeaveNothing) {
  start();
  const std::string cookie = join_operator();
  std::size_t after_first = 0, handles_first = 0;
  const auto handles = [] {
    std::size_t n = 0;
    for (int fd = 0; fd < 1024; ++fd) n += ::fcntl(fd, F_GETFD) >= 0 ? 1 : 0;
    return n;
  };
  for (int i = 0; i < 200; ++i) {
    auto s = open(cookie);
    ASSERT_TRUE(wait_for([&] { return server_->viewers() >= 1; }));
    server_->publish(ViewKind::kPicture, {}, std::string(300000, 'p'));
    EXPECT_EQ(s->next(4).body().size(), 300000U);
    if (i % 2 == 0) s->frame(8, std::string("\x03\xe8", 2));  // some say good-bye
    s.reset();
    ASSERT_TRUE(wait_for([&] { return server_->viewers() == 0; }));
    if (i == 20) {
      after_first = resident_bytes();
      handles_first = handles();
    }
  }
  EXPECT_LE(resident_bytes(), after_first + (std::size_t{8} << 20U));
  EXPECT_TRUE(wait_for([&] { return handles() <= handles_first + 2; }));
  EXPECT_EQ(server_->people().size(), 1U) << "one session all along";
}

TEST_F(Console, TheEndIsSaidAndComes) {
  start();
  const auto s = open(join_operator());
  ASSERT_TRUE(wait_for([&] { return server_->viewers() == 1; }));
  std::thread ending([&] { server_->stop(); });
  EXPECT_EQ(s->close_code(), 1001);
  ending.join();
  EXPECT_EQ(server_->viewers(), 0);
  EXPECT_FALSE(server_->publish(ViewKind::kText, {}, "x"));
  EXPECT_GT(server_->counts().cpu_ns, 0);
}

}  // namespace
}  // namespace console_test
