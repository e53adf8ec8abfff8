// What comes from outside, without a socket: names, paths, cookies, codes, envelopes, rates.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tools/console/intent_envelope.hpp"
#include "tools/console/page_files.hpp"
#include "tools/console/web_rules.hpp"

namespace {

using teletact::read_envelope;
using testing::ElementsAre;
using testing::IsEmpty;

TEST(WebNamesTest, OnlyTheNamesOfThisServer) {
  const teletact::WebNames names({"127.0.0.1", "localhost", "::1"}, 8080, false);
  for (const char* good : {"127.0.0.1:8080", "localhost:8080", "LocalHost:8080", "[::1]:8080"})
    EXPECT_TRUE(names.good_host(good)) << good;
  for (const char* bad : {"", "localhost", "localhost:8081", "evil.example:8080", "::1:8080",
                          "localhost:8080.evil.example", "127.0.0.1:8080 ", "user@localhost:8080"})
    EXPECT_FALSE(names.good_host(bad)) << bad;
  EXPECT_TRUE(names.good_origin("http://localhost:8080", "localhost:8080"));
  for (const char* bad : {"", "null", "https://localhost:8080", "http://127.0.0.1:8080",
                          "http://localhost:8080/", "http://localhost", "http://evil.example"})
    EXPECT_FALSE(names.good_origin(bad, "localhost:8080")) << bad;
  EXPECT_TRUE(teletact::WebNames({"box.lab"}, 443, true).good_origin("https://box.lab", "box.lab"));
}

TEST(PagePathTest, SegmentsWithoutAWayOut) {
  EXPECT_THAT(teletact::page_path("/"), ElementsAre("index.html"));
  EXPECT_THAT(teletact::page_path("/?x=1"), ElementsAre("index.html"));
  EXPECT_THAT(teletact::page_path("/assets/main-a1_b.js?v=2#x"),
              ElementsAre("assets", "main-a1_b.js"));
  EXPECT_THAT(teletact::page_path("/%61.js"), ElementsAre("a.js"));
  for (const char* bad : {"", "x", "//", "/..", "/../a", "/a/../b", "/%2e%2e/a", "/a%2f..%2fb",
                          "/a\\..\\b", "/a/", "/.git", "/a/.x", "/%", "/%4", "/%zz", "/a%00.js",
                          "http://a/b", "/a b", "/1/2/3/4/5/6/7/8/9"})
    EXPECT_THAT(teletact::page_path(bad), IsEmpty()) << bad;
  EXPECT_THAT(teletact::page_path("/" + std::string(65, 'a')), IsEmpty());
  EXPECT_THAT(teletact::page_path(std::string("/a\0b", 4)), IsEmpty());
}

TEST(CookieTest, OneValueOrNone) {
  EXPECT_EQ(teletact::cookie_value("a=1; t=xy; b=2", "t"), "xy");
  EXPECT_EQ(teletact::cookie_value("t=xy", "t"), "xy");
  EXPECT_EQ(teletact::cookie_value("tt=xy; at=z", "t"), "");
  EXPECT_EQ(teletact::cookie_value("t=xy; t=ab", "t"), "") << "which one was it";
  EXPECT_EQ(teletact::cookie_value("", "t"), "");
  EXPECT_EQ(teletact::cookie_value(";;=;t", "t"), "");
}

TEST(CodeTest, OneKeyAndHexDigits) {
  const std::string good(32, 'a');
  EXPECT_EQ(teletact::code_of("{\"code\":\"" + good + "\"}"), good);
  for (const std::string& bad :
       {std::string(), std::string("{}"), std::string("[]"), std::string("null"),
        "\"" + good + "\"", "{\"code\":\"" + good + "a\"}", "{\"code\":\"" + good + "\",\"x\":1}",
        "{\"code\":\"" + std::string(32, 'A') + "\"}", std::string("{\"code\":5}")})
    EXPECT_FALSE(teletact::code_of(bad)) << bad;
}

TEST(EnvelopeTest, GoodOnesKeepWhatElseIsInThem) {
  const auto e = read_envelope(R"({"id":7,"act":"go_to","x":1.5,"y":[1,2]})");
  ASSERT_TRUE(e) << e.error();
  EXPECT_EQ(e.value().id, 7);
  EXPECT_EQ(e.value().act, "go_to");
  EXPECT_EQ(e.value().intent.at("x"), 1.5);
  EXPECT_TRUE(read_envelope(R"({"id":9007199254740991,"act":"stop"})"));
}

TEST(EnvelopeTest, WhatIsNoneIsRefusedWithOneLine) {
  const std::string deep =
      R"({"id":1,"act":"a","x":)" + std::string(7, '[') + std::string(7, ']') + "}";
  for (const std::string& bad :
       {std::string(),
        std::string("{"),
        std::string("5"),
        std::string("[1]"),
        std::string("null"),
        std::string(R"({"id":1})"),
        std::string(R"({"act":"stop"})"),
        std::string(R"({"id":"1","act":"stop"})"),
        std::string(R"({"id":-1,"act":"stop"})"),
        std::string(R"({"id":1.5,"act":"stop"})"),
        std::string(R"({"id":9007199254740992,"act":"stop"})"),
        std::string(R"({"id":18446744073709551615,"act":"stop"})"),
        std::string(R"({"id":1,"act":5})"),
        std::string(R"({"id":1,"act":""})"),
        std::string(R"({"id":1,"act":"Stop"})"),
        std::string(R"({"id":1,"act":"a b"})"),
        std::string(R"({"id":1,"act":"abcdefghijklmnopqrstuvwxyz"})"),
        std::string(R"({"id":1,"id":2,"act":"stop"})"),
        std::string(R"({"id":1,"act":"hold","act":"stop"})"),
        std::string(R"({"id":1,"act":"drive","vx":NaN})"),
        std::string(R"({"id":1,"act":"drive","vx":1e999})"),
        std::string(R"({"id":1,"act":"note","text":")") + "\xff\xfe\"}",
        std::string(R"({"id":1,"act":"stop"} x)"),
        deep,
        R"({"id":1,"act":"note","text":")" + std::string(4096, 'x') + "\"}"}) {
    const auto e = read_envelope(bad);
    ASSERT_FALSE(e) << bad;
    EXPECT_FALSE(e.error().empty());
    EXPECT_EQ(e.error().find('\n'), std::string::npos);
  }
}

TEST(RateWindowTest, NeverMoreThanNInASecond) {
  teletact::RateWindow<5> window;
  int taken = 0;
  for (std::int64_t ms = 0; ms < 1000; ++ms) taken += window.take(ms * 1'000'000) ? 1 : 0;
  EXPECT_EQ(taken, 5);
  EXPECT_TRUE(window.take(1'000'000'000));
  EXPECT_FALSE(window.take(1'000'100'000)) << "the second one is 999.1 ms old";
}

}  // namespace
