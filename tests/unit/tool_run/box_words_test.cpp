// What a box of its own says and is told: addresses, news of the link, its status.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <atomic>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <thread>

#include "rt/random.hpp"
#include "tools/box/box_status.hpp"
#include "tools/box/link_news.hpp"
#include "tools/box/road_address.hpp"

namespace {

namespace fs = std::filesystem;
using teletact::parse_road_address;
using teletact::StatusServer;
using testing::HasSubstr;

TEST(RoadAddress, TakesHostsAndPorts) {
  struct Case {
    const char *text, *host;
    int port;
  };
  for (const Case& c : {Case{"127.0.0.1:47110", "127.0.0.1", 47110},
                        {"robot.lab:1", "robot.lab", 1},
                        {"[::1]:65535", "::1", 65535},
                        {"[fe80::1%eth0]:5", "fe80::1%eth0", 5}}) {
    const auto a = parse_road_address("--x", c.text, false);
    ASSERT_TRUE(a) << c.text;
    EXPECT_EQ(a.value().host, c.host);
    EXPECT_EQ(a.value().port, c.port);
  }
  EXPECT_TRUE(parse_road_address("--listen", "0.0.0.0:0", true)) << "the kernel chooses";
}

TEST(RoadAddress, RefusesWithOneLine) {
  for (const char* text :
       {"", "host", ":5", "host:", "host:x", "host:5x", "host:-1", "host:65536", "host:0", "::1:5",
        "[]:5", "[::1]5", "a b:5", "host: 5", "host:+5", "host:99999999999999999999"}) {
    const auto a = parse_road_address("--robot-address", text, false);
    ASSERT_FALSE(a) << text;
    EXPECT_EQ(a.error().find("--robot-address " + std::string(text) + ": "), 0U) << a.error();
    EXPECT_THAT(a.error(), HasSubstr("port 1..65535"));
    EXPECT_EQ(a.error().find('\n'), std::string::npos);
  }
  EXPECT_FALSE(parse_road_address("--listen", "host:65536", true));
}

TEST(RoadAddress, AnyTextIsTakenOrRefused) {
  constexpr std::uint64_t kSeed = 20130;
  std::printf("seed %llu\n", static_cast<unsigned long long>(kSeed));
  rt::Random r(kSeed);
  const std::string letters = "0123456789.:[]ab-/ \t%";
  int taken = 0;
  for (int n = 0; n < 100000; ++n) {
    std::string text;
    for (std::int64_t i = r.integer(0, 12); i > 0; --i)
      text += letters[static_cast<std::size_t>(r.integer(0, std::ssize(letters) - 1))];
    const auto a = parse_road_address("--x", text, true);
    if (!a) continue;
    ++taken;
    ASSERT_FALSE(a.value().host.empty()) << text;
    ASSERT_GE(a.value().port, 0);
    ASSERT_LE(a.value().port, 65535);
  }
  EXPECT_GT(taken, 100);
}

TEST(RoadAddress, Loopback) {
  for (const char* h : {"127.0.0.1", "127.1.2.3", "localhost", "::1"})
    EXPECT_TRUE(teletact::is_loopback(h)) << h;
  for (const char* h : {"0.0.0.0", "128.0.0.1", "10.0.0.1", "127.0.0.1.evil.org", "::", "127"})
    EXPECT_FALSE(teletact::is_loopback(h)) << h;
}

TEST(LinkNews, SaysEachChangeOnce) {
  teletact::LinkNews news;
  EXPECT_THAT(news.line(false, 0, ""), HasSubstr("no other box yet; this box holds still"));
  EXPECT_EQ(news.line(false, 0, ""), "");
  EXPECT_THAT(news.line(false, 0, "link: bad magic"), HasSubstr("(link: bad magic)"));
  EXPECT_EQ(news.line(false, 0, "link: bad magic"), "");
  EXPECT_THAT(news.line(true, 1, ""), HasSubstr("is there (connection 1)"));
  EXPECT_EQ(news.line(true, 1, ""), "");
  EXPECT_THAT(news.line(false, 1, ""), HasSubstr("is gone; this box holds still"));
  EXPECT_EQ(news.line(false, 1, ""), "");
  EXPECT_THAT(news.line(true, 2, ""), HasSubstr("(connection 2); engage again"));
  EXPECT_THAT(news.line(true, 3, ""), HasSubstr("(connection 3)")) << "too short to be seen";
}

TEST(LinkNews, RefusedCommandsOnceASecond) {
  teletact::LinkNews news;
  constexpr std::int64_t kSecond = 1'000'000'000;
  EXPECT_EQ(news.refused_line(0, "", kSecond), "");
  EXPECT_EQ(news.refused_line(1, "too late", kSecond),
            "the robot's box refused 1 command (the newest: too late)");
  EXPECT_EQ(news.refused_line(4, "replayed", kSecond + 1), "");
  EXPECT_EQ(news.refused_line(5, "replayed", 2 * kSecond),
            "the robot's box refused 4 commands (the newest: replayed)");
  EXPECT_EQ(news.refused_line(2, "too late", 3 * kSecond),
            "the robot's box refused 2 commands (the newest: too late)")
      << "another box, which counts from one";
  EXPECT_EQ(news.refused_line(2, "too late", 9 * kSecond), "");
}

TEST(LinkNews, SaysWhoIsThere) {
  teletact::LinkNews news;
  EXPECT_EQ(news.line(true, 1, "", "operator 'ada' from 10.0.0.3"),
            "link: the other box is there (connection 1): operator 'ada' from 10.0.0.3");
}

// Who sends nothing holds the place all the same, and anybody else would read "busy: NAME".
TEST(LinkNews, SaysWhoHoldsThePlaceBeforeTheHandShakeIsOver) {
  teletact::LinkNews news;
  constexpr std::int64_t kSecond = 1'000'000'000;
  const std::string ada = "operator 'ada' from 10.0.0.3", bob = "operator 'bob' from 10.0.0.4";
  EXPECT_EQ(news.shaking_line(false, "", kSecond), "");
  EXPECT_EQ(news.shaking_line(false, ada, kSecond),
            "link: operator 'ada' from 10.0.0.3 has come; hand-shake");
  for (int s = 2; s < 11; ++s) EXPECT_EQ(news.shaking_line(false, ada, s * kSecond), "");
  EXPECT_NE(news.shaking_line(false, ada, 11 * kSecond), "") << "still, or again";
  EXPECT_NE(news.shaking_line(false, bob, 12 * kSecond), "") << "another one";
  EXPECT_EQ(news.shaking_line(true, ada, 13 * kSecond), "") << "has a line of its own";
}

TEST(LinkNews, StrangersAtOnceAndThenEachTenSeconds) {
  teletact::LinkNews news;
  constexpr std::int64_t kSecond = 1'000'000'000;
  EXPECT_EQ(news.turned_away_line(0, "", kSecond), "");
  EXPECT_EQ(news.turned_away_line(1, "10.0.0.9: it shows no certificate", kSecond),
            "link: turned away: 10.0.0.9: it shows no certificate");
  for (int s = 2; s < 11; ++s) EXPECT_EQ(news.turned_away_line(200, "a crowd", s * kSecond), "");
  EXPECT_EQ(news.turned_away_line(201, "10.0.0.9: it does not speak TLS", 11 * kSecond),
            "link: turned away: 10.0.0.9: it does not speak TLS (the newest of 200)");
  EXPECT_EQ(news.turned_away_line(201, "10.0.0.9: it does not speak TLS", 99 * kSecond), "");
}

TEST(LinkNews, ANoteOnceAndThatItIsOver) {
  teletact::LinkNews news;
  EXPECT_EQ(news.note_line(""), "");
  EXPECT_EQ(news.note_line("keys/ca.crl: is gone"), "link: keys/ca.crl: is gone");
  EXPECT_EQ(news.note_line("keys/ca.crl: is gone"), "");
  EXPECT_EQ(news.note_line(""), "link: no longer so: keys/ca.crl: is gone");
  EXPECT_EQ(news.note_line(""), "");
}

// Lossless depth on a road that it does not fit is told once a connection; the same few pictures of
// another codec have words of their own (SparedNews).
TEST(LinkNews, FewPicturesOfALosslessCodec) {
  constexpr std::int64_t kSecond = 1'000'000'000;
  teletact::PictureRate rate;
  rate.look(100, kSecond);
  EXPECT_LT(rate.per_s(), 0) << "one look tells no rate";
  rate.look(104, kSecond + kSecond / 2);
  rate.look(107, 2 * kSecond);
  EXPECT_DOUBLE_EQ(rate.per_s(), 7);
  const teletact::PictureRoad road{true, 30, 10};
  teletact::LinkNews news;
  EXPECT_EQ(news.slow_line(true, road, 7, 10 * kSecond), "") << "it may be the beginning";
  EXPECT_THAT(news.slow_line(true, road, 7, 15 * kSecond),
              HasSubstr("link: the road carries 7 of 30 pictures a second: lossless depth does not "
                        "fit a road of 10 Mbit/s"));
  EXPECT_EQ(news.slow_line(true, road, 7, 30 * kSecond), "");
  EXPECT_EQ(news.slow_line(false, road, 0, 31 * kSecond), "");
  (void)news.slow_line(true, road, 7, 32 * kSecond);
  EXPECT_NE(news.slow_line(true, road, 7, 40 * kSecond), "") << "another connection";
  for (const teletact::PictureRoad& fits :
       {teletact::PictureRoad{false, 30, 10}, teletact::PictureRoad{true, 30, 0}})
    EXPECT_EQ(teletact::slow_text(fits, 7), "");
  EXPECT_EQ(teletact::slow_text(road, 29), "");
  // What it says can be typed: a text in TOML is quoted, and the shell keeps the quotes.
  const std::string text = teletact::slow_text(road, 7);
  EXPECT_THAT(text, HasSubstr("--set 'link.depth_codec=\"auto\"'"));
  EXPECT_THAT(text, HasSubstr("'link.colour_codec=\"h264\"'"));
  EXPECT_THAT(text, testing::EndsWith("or give --rate what the road carries"));
}

struct Folder {
  std::string path;
  Folder() {
    path = (fs::temp_directory_path() / ("teletact-status-" + std::to_string(::getpid()))).string();
    fs::remove_all(path);
    fs::create_directories(path);
  }
  ~Folder() { fs::remove_all(path); }
};

TEST(BoxStatus, IsReadThroughASocketOfItsUserAlone) {
  const Folder f;
  const std::string path = f.path + "/teletact/robot.sock";
  const auto nobody = teletact::ask_status(path);
  ASSERT_FALSE(nobody);
  EXPECT_THAT(nobody.error(), HasSubstr("no box runs there"));
  auto server = StatusServer::open(path);
  ASSERT_TRUE(server) << server.error();
  struct stat info {};
  ASSERT_EQ(::stat(path.c_str(), &info), 0);
  EXPECT_EQ(info.st_mode & 0777U, 0600U);
  ASSERT_EQ(::stat((f.path + "/teletact").c_str(), &info), 0);
  EXPECT_EQ(info.st_mode & 0777U, 0700U);

  teletact::BoxStatus s;
  s.box = "robot";
  s.mode = "hold";
  s.cause = "F-SUP-02 \"quoted\"\n\xff";
  s.connections = 3;
  s.peer = "operator 'ada' from 10.0.0.3";
  s.turned_away = 7;
  s.turned_away_newest = "10.0.0.9: it shows no certificate";
  s.certificate_until = "2031-05-17";
  s.real_time = "no: haptic: SCHED_FIFO 80";
  std::atomic<bool> done{false};
  std::thread box([&] {
    while (!done) {
      server.value().serve([&] { return teletact::status_json(s); });
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  });
  for (int i = 0; i < 20; ++i) {
    const auto answer = teletact::ask_status(path);
    ASSERT_TRUE(answer) << answer.error();
    const auto j = nlohmann::json::parse(answer.value());
    EXPECT_EQ(j["box"], "robot");
    EXPECT_EQ(j["connections"], 3);
    EXPECT_EQ(j["peer"], s.peer);
    EXPECT_EQ(j["turned_away"], 7);
    EXPECT_EQ(j["turned_away_newest"], s.turned_away_newest);
    EXPECT_EQ(j["certificate_until"], "2031-05-17");
    EXPECT_EQ(j["real_time"], s.real_time);
    for (const char* key : {"link_note", "pictures_per_s", "rate_Mbit_per_s", "store_MiB",
                            "store_cap_MiB", "disk_free_MiB"})
      EXPECT_TRUE(j.contains(key)) << key;
    const auto text = teletact::status_text(answer.value());
    ASSERT_TRUE(text);
    EXPECT_THAT(text.value(), HasSubstr("mode                      hold\n"));
  }
  const auto second = StatusServer::open(path);
  ASSERT_FALSE(second);
  EXPECT_THAT(second.error(), HasSubstr("another box of this user answers there"));
  done = true;
  box.join();
}

// What a box that was killed leaves behind is taken over; a folder that others may enter is not
// used.
TEST(BoxStatus, StaleSocketsAndOpenFolders) {
  const Folder f;
  const std::string path = f.path + "/teletact/operator.sock";
  fs::create_directories(f.path + "/teletact");
  fs::permissions(f.path + "/teletact", fs::perms(0755));
  const auto open_to_all = StatusServer::open(path);
  ASSERT_FALSE(open_to_all);
  EXPECT_THAT(open_to_all.error(), HasSubstr("mode 0700"));
  fs::permissions(f.path + "/teletact", fs::perms(0700));
  const int fd = ::socket(AF_UNIX, SOCK_STREAM, 0);
  sockaddr_un a{};
  a.sun_family = AF_UNIX;
  path.copy(a.sun_path, sizeof a.sun_path - 1);
  ASSERT_EQ(::bind(fd, reinterpret_cast<const sockaddr*>(&a), sizeof a), 0);
  ::close(fd);  // nobody listens; the name is still there
  ASSERT_TRUE(fs::exists(path));
  {
    const auto server = StatusServer::open(path);
    EXPECT_TRUE(server);
  }
  EXPECT_FALSE(fs::exists(path)) << "an orderly end takes it away";
  EXPECT_FALSE(StatusServer::open(f.path + "/" + std::string(200, 'x') + "/robot.sock"));
}

// A box serves whoever is there and waits for nobody who is not.
TEST(BoxStatus, ServesWithoutWaiting) {
  const Folder f;
  const auto server = StatusServer::open(f.path + "/teletact/robot.sock");
  ASSERT_TRUE(server);
  int asked = 0;
  for (int i = 0; i < 100; ++i) server.value().serve([&] { return ++asked, std::string("{}"); });
  EXPECT_EQ(asked, 0);
}

TEST(BoxStatus, OnlyAStatusIsText) {
  for (const char* bad : {"", "x", "[1]", "{", "{\"a\":{\"b\":1}}", "{\"a\":[]}", "7"})
    EXPECT_FALSE(teletact::status_text(bad)) << bad;
  constexpr std::uint64_t kSeed = 20131;
  std::printf("seed %llu\n", static_cast<unsigned long long>(kSeed));
  rt::Random r(kSeed);
  const std::string good = teletact::status_json({});
  ASSERT_TRUE(teletact::status_text(good));
  for (int n = 0; n < 20000; ++n) {
    std::string text = good;
    for (std::int64_t i = r.integer(1, 4); i > 0; --i)
      text[static_cast<std::size_t>(r.integer(0, std::ssize(text) - 1))] = static_cast<char>(r());
    text.resize(static_cast<std::size_t>(r.integer(0, std::ssize(text))));
    (void)teletact::status_text(text);
  }
}

}  // namespace
