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

TEST(PublicAddressTest, IsReadAsBrowsersSendIt) {
  using teletact::PublicAddress;
  struct Case {
    const char *url, *origin, *host, *path;
    bool secure;
  };
  for (const Case& c : {
           Case{"https://lab.example/robots/rover/", "https://lab.example", "lab.example",
                "/robots/rover/", true},
           Case{"HTTPS://Lab.Example:443", "https://lab.example", "lab.example", "/", true},
           Case{"https://lab:8443/Rover", "https://lab:8443", "lab:8443", "/Rover/", true},
           Case{"http://localhost:9000/", "http://localhost:9000", "localhost:9000", "/", false},
           Case{"http://[::1]:9000", "http://[::1]:9000", "[::1]:9000", "/", false},
           Case{"http://127.0.0.1:80", "http://127.0.0.1", "127.0.0.1", "/", false},
       }) {
    const auto a = PublicAddress::parse(c.url);
    ASSERT_TRUE(a) << a.error();
    EXPECT_EQ(a.value().origin, c.origin);
    EXPECT_EQ(a.value().host, c.host);
    EXPECT_EQ(a.value().path, c.path);
    EXPECT_EQ(a.value().secure, c.secure);
  }
  for (const std::string& bad : {std::string(),
                                 std::string("lab.example"),
                                 std::string("//lab.example/"),
                                 std::string("ftp://lab.example/"),
                                 std::string("https://"),
                                 std::string("https:///x"),
                                 std::string("http://lab.example/"),
                                 std::string("http://localhost.evil.example/"),
                                 std::string("https://a b/"),
                                 std::string("https://user@lab/"),
                                 std::string("https://lab:"),
                                 std::string("https://lab:0/"),
                                 std::string("https://lab:65536/"),
                                 std::string("https://lab:80x/"),
                                 std::string("https://[::1/"),
                                 std::string("https://::1/"),
                                 std::string("https://lab/a//b"),
                                 std::string("https://lab/../b"),
                                 std::string("https://lab/a;b"),
                                 std::string("https://lab/?x"),
                                 std::string("https://lab/#code=1"),
                                 std::string("https://lab/\r\nX: y"),
                                 std::string("https://lab/\0", 13),
                                 "https://lab/" + std::string(200, 'a')}) {
    const auto a = PublicAddress::parse(bad);
    ASSERT_FALSE(a) << bad;
    EXPECT_THAT(a.error(), testing::HasSubstr("allowed https://NAME[:PORT]/[PATH/]")) << bad;
  }
}

TEST(WebNamesTest, ThePublicAddressBesides) {
  const auto known = teletact::PublicAddress::parse("https://lab.example/robots/rover/");
  ASSERT_TRUE(known);
  const teletact::WebNames names({"127.0.0.1"}, 8080, false, known.value());
  const std::string lab = "lab.example", own = "127.0.0.1:8080";
  EXPECT_TRUE(names.good_host(lab)) << "a proxy that leaves the name";
  EXPECT_TRUE(names.good_host(own)) << "one that sends its own";
  EXPECT_FALSE(names.good_host("lab.example:8080"));
  EXPECT_TRUE(names.good_origin("https://lab.example", lab));
  EXPECT_TRUE(names.good_origin("https://Lab.example", own));
  EXPECT_TRUE(names.good_origin("http://127.0.0.1:8080", own));
  for (const char* bad :
       {"", "null", "http://lab.example", "https://lab.example:8080",
        "https://lab.example/robots/rover/", "https://evil.example", "https://127.0.0.1:8080"}) {
    EXPECT_FALSE(names.good_origin(bad, lab)) << bad;
    EXPECT_FALSE(names.good_origin(bad, own)) << bad;
  }
  EXPECT_FALSE(names.good_origin("https://lab.example", "evil.example"));
  EXPECT_FALSE(names.good_origin("http://127.0.0.1:8080", lab));
  EXPECT_EQ(names.inside("/robots/rover/ws"), "/ws");
  EXPECT_EQ(names.inside("/robots/rover/"), "/");
  EXPECT_EQ(names.inside("/ws"), "/ws") << "a proxy that takes the path away";
  EXPECT_EQ(names.inside("/robots/roverx"), "/robots/roverx");
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
