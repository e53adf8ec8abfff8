// Over the wire: intents in, answers out, one operator, the stop before all queues.
#include <atomic>
#include <chrono>
#include <cstring>
#include <thread>

#include "support.hpp"

namespace console_test {
namespace {

using teletact::ConsoleRole;
using teletact::Refusal;
using teletact::RoleEvent;
using testing::HasSubstr;

std::string intent(int id, const std::string& act, const std::string& more = "") {
  return "{\"id\":" + std::to_string(id) + ",\"act\":\"" + act + "\"" + more + "}";
}

TEST_F(Console, AnActIsHandedOnAndAnswered) {
  callbacks_.on_act = [&](const teletact::ConsoleAct& a) -> std::optional<teletact::ConsoleAnswer> {
    if (a.act == "later") return std::nullopt;
    if (a.act == "bad") throw std::runtime_error("oh");
    return teletact::ConsoleAnswer{a.act != "no", a.act == "no" ? "not \"now\"" : "", "{\"n\":5}"};
  };
  start();
  server_->set_clock([] { return 2.5; });
  const auto s = open(join_operator());
  s->text(intent(1, "go_to", ",\"x\":1"));
  EXPECT_EQ(s->answer(), "{\"id\":1,\"ok\":true,\"result\":{\"n\":5}}");
  s->text(intent(2, "no"));
  EXPECT_EQ(s->answer(),
            "{\"id\":2,\"ok\":false,\"result\":{\"n\":5},\"why\":\"not \\\"now\\\"\"}");
  s->text(intent(3, "later"));
  s->text(intent(4, "bad"));
  EXPECT_EQ(s->answer(), "{\"id\":4,\"ok\":false,\"why\":\"failed: oh\"}");
  server_->answer(server_->people().at(0).session, 3, {true, "", ""});
  EXPECT_EQ(s->answer(), "{\"id\":3,\"ok\":true}");
}

TEST_F(Console, HeldActsAreAnsweredOnlyWhereRefused) {
  start();
  const auto s = open(join_operator());
  s->text(intent(1, "token", ",\"holds\":[\"drive\"]"));
  s->text(intent(2, "drive", ",\"vx\":0.1"));
  s->text(intent(3, "hand"));
  s->text(intent(4, "mark"));
  EXPECT_THAT(s->answer(), HasSubstr("\"id\":4"));
  EXPECT_EQ(acts_, 4);
}

// By it a page knows how late its line is; a viewer sees pictures too.
TEST_F(Console, ATokensTimeIsSaidBackAtOnce) {
  start();
  server_->set_clock([] { return 7.25; });
  const std::string cookie = join_operator();
  const auto s = open(cookie), v = open(join_viewer(cookie));
  s->text(intent(1, "token", ",\"holds\":[\"drive\"],\"t\":1234.5678"));
  const Frame f = s->next(7);
  EXPECT_EQ(f.body(), "{\"id\":1,\"ok\":true,\"result\":{\"t\":1234.5678}}");
  double made = 0;
  std::memcpy(&made, f.payload.data() + 8, sizeof made);
  EXPECT_EQ(made, 7.25);
  s->text(intent(2, "token", ",\"holds\":[],\"t\":\"now\""));
  s->text(intent(3, "hold"));
  EXPECT_THAT(s->answer(), HasSubstr("\"id\":3")) << "no number is not said back";
  EXPECT_EQ(acts_, 3) << "and each went on to whoever does it";
  // As long as it goes on looking.
  for (int id = 1; id <= 150; ++id) {
    v->text(intent(id, "token", ",\"holds\":[],\"t\":" + std::to_string(id)));
    ASSERT_THAT(v->answer(), HasSubstr("{\"t\":" + std::to_string(id) + "}"));
    std::this_thread::sleep_for(std::chrono::milliseconds(12));  // of 100 a second
  }
  EXPECT_EQ(refused(Refusal::kRole), 0U);
  EXPECT_EQ(acts_, 3);
  v->text(intent(151, "token", ",\"holds\":[\"drive\"],\"t\":1"));
  v->text(intent(152, "hold"));
  EXPECT_THAT(v->answer(), HasSubstr("\"id\":152,\"ok\":false"));
  EXPECT_EQ(refused(Refusal::kRole), 2U);
}

TEST_F(Console, WhatIsNoIntentMovesNothing) {
  start();
  const auto s = open(join_operator());
  for (const char* bad : {"", "{", "[]", "{\"id\":1}", "{\"id\":1,\"act\":\"a\",\"act\":\"b\"}"}) {
    s->text(bad);
    EXPECT_THAT(s->answer(), HasSubstr("{\"id\":-1,\"ok\":false")) << bad;
  }
  s->frame(2, "binary");
  s->text(intent(5, "hold"));
  EXPECT_THAT(s->answer(), HasSubstr("\"id\":5,\"ok\":true"));
  for (const int again : {5, 4}) {
    s->text(intent(again, "hold"));
    EXPECT_THAT(s->answer(), HasSubstr("not above")) << again;
  }
  EXPECT_EQ(acts_, 1);
  EXPECT_EQ(refused(Refusal::kEnvelope), 8U);
  s->text(std::string(5000, ' '));
  EXPECT_EQ(s->close_code(), 1009) << "longer than 4 KiB";
  EXPECT_TRUE(wait_for([&] { return refused(Refusal::kEnvelope) == 9U; }));
  EXPECT_TRUE(wait_for([&] { return server_->viewers() == 0; }));
}

TEST_F(Console, GarbageWithoutEndIsClosed) {
  start();
  const auto s = open(join_operator());
  for (int i = 0; i < 150; ++i) s->text("{");
  EXPECT_EQ(s->close_code(), 1008);
  EXPECT_EQ(acts_, 0);
}

TEST_F(Console, TooFastIsRefusedAndAfterTwoSecondsClosed) {
  start();
  const auto s = open(join_operator());
  for (int id = 1; id <= 1000; ++id) s->text(intent(id, "note"));
  int good = 0, bad = 0;
  for (int i = 0; i < 1000; ++i) {
    const std::string a = s->answer();
    good += a.find("\"ok\":true") != std::string::npos ? 1 : 0;
    bad += a.find("too fast") != std::string::npos ? 1 : 0;
  }
  EXPECT_EQ(good + bad, 1000);
  EXPECT_GE(good, 200);
  EXPECT_EQ(acts_, good);
  EXPECT_EQ(refused(Refusal::kRate), static_cast<std::uint64_t>(bad));
  // On and on; answers are read on another thread, or it would be closed for that.
  std::atomic<int> code{0};
  std::thread reader([&] { code = s->close_code(); });
  int id = 1000;
  while (code == 0 && id < 2'000'000) {
    for (int i = 0; i < 20; ++i)
      if (!s->text(intent(++id, "note"))) break;
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  reader.join();
  EXPECT_EQ(code, 1008);
}

TEST_F(Console, StreamsHaveTheirOwnLimits) {
  start();
  const auto s = open(join_operator());
  int id = 0;
  for (int i = 0; i < 300; ++i) {
    s->text(intent(++id, "token"));
    s->text(intent(++id, "drive"));
  }
  s->text(intent(++id, "hold"));
  std::string last;
  for (int i = 0; i < 301; ++i) {
    last = s->answer();
    if (last.find("\"ok\":true") != std::string::npos) break;
    EXPECT_THAT(last, HasSubstr("too fast"));
  }
  EXPECT_THAT(last, HasSubstr("\"id\":601,\"ok\":true")) << "the fast streams did not use it up";
  EXPECT_GE(refused(Refusal::kRate), 1U);
}

TEST_F(Console, WhatWasSeenIsForTheServerAndNeverMoreThanWasSent) {
  std::atomic<int> acts{0};
  callbacks_.on_act = [&](const teletact::ConsoleAct&) {
    ++acts;
    return std::optional(teletact::ConsoleAnswer{true, "", ""});
  };
  start();
  const std::string cookie = join_operator();
  for (const auto& s : {open(cookie), open(join_viewer(cookie))}) {
    int id = 0;
    const auto seen = [&](const std::string& rest) {
      s->text("{\"id\":" + std::to_string(++id) + ",\"act\":\"seen\"" + rest + "}");
    };
    seen(",\"bytes\":0");  // silent: it is right
    for (const char* wrong : {",\"bytes\":1", "", ",\"bytes\":-1", ",\"bytes\":0.5",
                              ",\"bytes\":\"0\"", ",\"bytes\":0,\"of\":4"}) {
      seen(wrong);
      const std::string answer = s->answer();
      EXPECT_THAT(answer, HasSubstr("\"id\":" + std::to_string(id) + ",\"ok\":false")) << wrong;
      EXPECT_THAT(answer, HasSubstr("as many as have been seen")) << wrong;
    }
  }
  EXPECT_EQ(refused(Refusal::kEnvelope), 12U);
  EXPECT_EQ(acts, 0);
}

// 1,000 intents are on their way before it, and whoever does them is slow.
TEST_F(Console, TheStopPassesWhatWaits) {
  std::atomic<int> done_at_stop{-1};
  callbacks_.on_act = [&](const teletact::ConsoleAct&) {
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
    ++acts_;
    return std::optional(teletact::ConsoleAnswer{true, "", ""});
  };
  callbacks_.on_stop = [&](const teletact::ConsolePerson&) {
    ++stops_;
    if (done_at_stop < 0) done_at_stop = acts_.load();
  };
  start();
  const std::string cookie = join_operator();
  const auto s = open(cookie);
  // 100 a second of each stream and 200 others are taken; all are in the socket before the stop.
  std::thread flood([&] {
    int id = 0;
    for (int i = 0; i < 200; ++i) s->text(intent(++id, "note"));
    for (int i = 0; i < 800; ++i) s->text(intent(++id, i % 2 == 0 ? "drive" : "hand"));
  });
  ASSERT_TRUE(wait_for([&] { return acts_ >= 1; }));
  EXPECT_EQ(post("/stop", "", "Cookie: " + cookie + "\r\n").status, 200);
  flood.join();
  EXPECT_EQ(stops_, 1);
  ASSERT_TRUE(wait_for([&] { return acts_ >= 300; }));
  EXPECT_LT(done_at_stop, 200) << "it waited for the queue";
}

TEST_F(Console, StopAsAnActIsNeverLimited) {
  start();
  const std::string cookie = join_operator();
  const auto s = open(join_viewer(cookie));
  for (int i = 0; i < 500; ++i) s->text(intent(0, "stop"));
  for (int i = 0; i < 500; ++i) ASSERT_THAT(s->answer(), HasSubstr("\"id\":0,\"ok\":true"));
  EXPECT_EQ(stops_, 500);
  EXPECT_EQ(refused(Refusal::kRole), 0U);
}

TEST_F(Console, AViewerOnlyLooksAndIsClosedIfItGoesOn) {
  start();
  const std::string cookie = join_operator();
  const auto v = open(join_viewer(cookie));
  v->text(intent(1, "engage"));
  EXPECT_THAT(v->answer(), HasSubstr("only the operator may act"));
  v->text(intent(2, "take_role"));
  EXPECT_THAT(v->answer(), HasSubstr("only look"));
  for (int id = 3; id < 200; ++id) v->text(intent(id, "hold"));
  EXPECT_EQ(v->close_code(), 4003);
  EXPECT_EQ(acts_, 0);
}

TEST_F(Console, TheRoleIsAskedForAndHandedOver) {
  start();
  const auto a = open(join_operator()), b = open(join_operator());
  b->text(intent(1, "take_role"));
  EXPECT_THAT(b->answer(), HasSubstr("\"ok\":false"));
  b->text(intent(2, "ask_role"));
  EXPECT_THAT(b->answer(), HasSubstr("\"ok\":true"));
  a->text(intent(1, "give_role"));
  EXPECT_THAT(a->answer(), HasSubstr("\"ok\":true"));
  a->text(intent(2, "engage"));
  EXPECT_THAT(a->answer(), HasSubstr("only the operator"));
  b->text(intent(3, "engage"));
  EXPECT_THAT(b->answer(), HasSubstr("\"ok\":true"));
  EXPECT_EQ(acts_, 1);
  int operators = 0;
  for (const auto& p : server_->people()) operators += p.role == ConsoleRole::kOperator ? 1 : 0;
  EXPECT_EQ(operators, 1);
  const auto seen = events();
  EXPECT_EQ(std::count_if(seen.begin(), seen.end(),
                          [](const auto& e) { return e.kind == RoleEvent::Kind::kAsked; }),
            1);
  EXPECT_EQ(seen.back().kind, RoleEvent::Kind::kOperator);
}

TEST_F(Console, AReloadResumesAndTheOldOneIsClosed) {
  start();
  const std::string cookie = join_operator();
  const auto first = open(cookie), second = open(cookie);
  EXPECT_EQ(first->close_code(), 4001);
  second->text(intent(1, "engage"));
  EXPECT_THAT(second->answer(), HasSubstr("\"ok\":true")) << "still the operator";
  EXPECT_TRUE(wait_for([&] { return server_->viewers() == 1; }));
  EXPECT_EQ(server_->counts().reconnects, 1U);
}

TEST_F(Console, ANewCodeInTheSameBrowserEndsItsOldSession) {
  start();
  const std::string cookie = join_operator();
  const auto old = open(cookie);
  const Reply r =
      post("/session", "{\"code\":\"" + fresh_code() + "\"}", "Cookie: " + cookie + "\r\n");
  EXPECT_EQ(r.body, "{\"role\":\"operator\"}");
  EXPECT_EQ(old->close_code(), 4001);
  EXPECT_EQ(get("/session", "Cookie: " + cookie + "\r\n").status, 401);
  EXPECT_EQ(server_->people().size(), 1U);
}

TEST_F(Console, WhoLeavesIsToldOf) {
  start();
  auto s = open(join_operator());
  s.reset();
  EXPECT_TRUE(wait_for([&] {
    const auto seen = events();
    return !seen.empty() && seen.back().kind == RoleEvent::Kind::kLeft;
  }));
  EXPECT_EQ(server_->viewers(), 0);
}

}  // namespace
}  // namespace console_test
