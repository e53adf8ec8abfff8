// A saved session: what is written is read again, what is wrong is refused as a whole, and a disk
// that refuses leaves nothing half.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <thread>

#include "rt/random.hpp"
#include "tools/desk/session_store.hpp"

namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using perception::Vec3;
using teletact::read_session;
using teletact::SavedSession;
using teletact::session_text;
using teletact::SessionStore;
using teletact::SessionWorker;
using testing::HasSubstr;

constexpr const char *kHere = "0123456789abcdef", *kElsewhere = "fedcba9876543210";

SavedSession session(const std::string& name, const std::string& world = kHere) {
  SavedSession s;
  s.name = name;
  s.world = world;
  s.saved = "2026-01-02T03:04:05Z";
  teletact::DrawnObstacle disc, box;
  disc.id = 3;
  disc.centre_W = {1.0 / 3, -0.7, 0};
  disc.half_m = {0.2, 0.2, 0.1};
  box.id = 999;
  box.box = true;
  box.centre_W = {2, 0.1, 0};
  box.half_m = {0.3, 0.1, 0.1};
  box.yaw_rad = -1.25;
  s.obstacles = {disc, box};
  s.marks_W = {{Vec3(0.1, 0.2, 0), Vec3(0.15, 0.2, 0.001)}, {Vec3(1, 1, 0)}};
  teletact::SavedObject bin;
  bin.name = "the bin";
  bin.object.boxes_W[0] = {Vec3(0.9, 0.9, 0), Vec3(1.1, 1.1, 0.3)};
  bin.object.boxes_W[1] = {Vec3(1.1, 0.9, 0), Vec3(1.2, 1.0, 0.3)};
  bin.object.count = 2;
  bin.object.p_W = {1, 1, 0.2};
  s.objects = {bin};
  return s;
}

class Sessions : public testing::Test {
 protected:
  void SetUp() override { fs::remove_all(root_); }
  void TearDown() override { fs::remove_all(root_); }
  // With what is left of a write that failed.
  [[nodiscard]] std::size_t files() const {
    std::size_t n = 0;
    if (fs::exists(root_))
      for (const auto& e : fs::recursive_directory_iterator(root_))
        n += e.is_regular_file() ? 1U : 0U;
    return n;
  }
  fs::path root_ = fs::temp_directory_path() / ("teletact_sessions_" + std::to_string(::getpid()));
};

TEST_F(Sessions, WhatIsWrittenIsReadAgainToTheLastBit) {
  const SavedSession s = session("a");
  const auto back = read_session("a", session_text(s));
  ASSERT_TRUE(back) << back.error();
  const SavedSession& b = back.value();
  EXPECT_EQ(b.world, s.world);
  ASSERT_EQ(b.obstacles.size(), 2U);
  EXPECT_EQ(b.obstacles[0].id, 3);
  EXPECT_FALSE(b.obstacles[0].box);
  EXPECT_EQ(b.obstacles[0].centre_W, s.obstacles[0].centre_W);
  EXPECT_TRUE(b.obstacles[1].box);
  EXPECT_EQ(b.obstacles[1].yaw_rad, -1.25);
  EXPECT_EQ(b.marks_W, s.marks_W);
  ASSERT_EQ(b.objects.size(), 1U);
  EXPECT_EQ(b.objects[0].name, "the bin");
  ASSERT_EQ(b.objects[0].object.count, 2);
  EXPECT_EQ(b.objects[0].object.p_W, s.objects[0].object.p_W);
  EXPECT_EQ(b.objects[0].object.boxes_W[1].max(), s.objects[0].object.boxes_W[1].max());
  EXPECT_EQ(session_text(b), session_text(s));
}

TEST_F(Sessions, AWrongKeyRefusesTheWhole) {
  const json good = json::parse(session_text(session("a")));
  const auto wrong = [&](const char* pointer, const json& value) {
    json j = good;
    j[json::json_pointer(pointer)] = value;
    const auto read = read_session("a", j.dump());
    EXPECT_FALSE(read) << pointer << " = " << value;
    if (!read) {
      EXPECT_FALSE(read.error().empty());
    }
  };
  wrong("/format", 2);
  wrong("/format", "1");
  wrong("/more", 1);
  wrong("/world", "0123");
  wrong("/world", "0123456789ABCDEF");
  wrong("/saved", 7);
  wrong("/obstacles", json::object());
  wrong("/obstacles/0/id", 0);
  wrong("/obstacles/0/id", 999);  // twice
  wrong("/obstacles/0/half/0", 1e9);
  wrong("/obstacles/1/kind", "cone");
  wrong("/marks/0", json::array());
  wrong("/marks/1/0/2", "0");
  wrong("/objects/0/name", std::string(41, 'a'));
  wrong("/objects/0/name", "a\nb");
  wrong("/objects/0/boxes", json::array());
  wrong("/objects/0/boxes/0/min/2", 0.3);  // no height
  wrong("/objects/0/point", {3, 3, 3});    // in no box
  wrong("/objects/0/boxes/1/more", 1);
  for (const auto& [key, value] : good.items()) {
    json less = good;
    less.erase(key);
    EXPECT_FALSE(read_session("a", less.dump())) << key;
  }
  json many = good;
  for (int i = 0; i < 40; ++i) many["marks"].push_back(many["marks"][0]);
  EXPECT_FALSE(read_session("a", many.dump()));
  EXPECT_FALSE(read_session("a", ""));
  EXPECT_FALSE(read_session("a", "[]"));
}

// Bytes changed and cut anywhere: read or refused, and never anything but finite places.
TEST_F(Sessions, AnyBytesAreReadOrRefused) {
  constexpr std::uint64_t kSeed = 210811;
  SCOPED_TRACE(kSeed);
  rt::Random r(kSeed, 0);
  const std::string whole = session_text(session("a"));
  int read_ones = 0;
  for (int i = 0; i < 20000; ++i) {
    std::string text = whole;
    for (std::int64_t n = r.integer(1, 3); n > 0; --n)
      text[static_cast<std::size_t>(r.integer(0, static_cast<std::int64_t>(text.size()) - 1))] =
          static_cast<char>(r.integer(0, 2) == 0 ? r.integer(-128, 127) : r.integer('-', '9'));
    if (r.integer(0, 9) == 0)
      text.resize(static_cast<std::size_t>(r.integer(0, static_cast<std::int64_t>(text.size()))));
    const auto read = read_session("a", text);
    if (!read) continue;
    ++read_ones;
    for (const auto& o : read.value().obstacles)
      EXPECT_TRUE(o.centre_W.allFinite() && o.half_m.allFinite() && o.half_m.minCoeff() > 0);
    for (const auto& o : read.value().objects)
      EXPECT_TRUE(o.object.count > 0 && o.object.contains(o.object.p_W));
  }
  EXPECT_GT(read_ones, 100);
}

TEST_F(Sessions, NamesAreNoPaths) {
  const SessionStore store(root_.string());
  for (const char* name : {"", ".", "..", "../a", "a/b", "A", "a b", "a\n", "\xc3\xa4"}) {
    EXPECT_FALSE(store.save(session(name), "x = 1\n")) << name;
    EXPECT_FALSE(store.read(name)) << name;
  }
  EXPECT_FALSE(store.save(session(std::string(41, 'a')), ""));
  EXPECT_TRUE(store.save(session(std::string(40, 'a')), ""));
  EXPECT_FALSE(SessionStore("").save(session("a"), ""));
}

TEST_F(Sessions, OneOfAnotherWorldIsNeverReplaced) {
  const SessionStore store(root_.string());
  ASSERT_TRUE(store.save(session("a"), "one = 1\n"));
  ASSERT_TRUE(store.save_map("a", "map"));
  ASSERT_TRUE(store.save(session("a"), "two = 2\n")) << "of its own world it is";
  const auto other = store.save(session("a", kElsewhere), "three = 3\n");
  ASSERT_FALSE(other);
  EXPECT_THAT(other.error(), HasSubstr("another name"));
  EXPECT_EQ(store.read("a").value().world, kHere);
  std::ifstream toml(root_ / "a" / SessionStore::kScene);
  std::string line;
  std::getline(toml, line);
  EXPECT_EQ(line, "two = 2");
  // A folder with something else in it is no session's.
  fs::create_directories(root_ / "b");
  std::ofstream(root_ / "b" / "scene.toml") << "mine";
  EXPECT_FALSE(store.save(session("b"), ""));
  ASSERT_TRUE(store.save(session("c", kElsewhere), ""));
  const auto rows = store.list();
  ASSERT_EQ(rows.size(), 2U) << "b is no session";
  for (const auto& row : rows) {
    EXPECT_EQ(row.map, row.name == "a");
    EXPECT_EQ(row.world, row.name == "a" ? kHere : kElsewhere);
  }
}

// As on a full disk: a file may not grow beyond some bytes.
TEST_F(Sessions, AFullDiskIsToldAndLeavesNothingHalf) {
  const SessionStore store(root_.string());
  rlimit before{};
  ASSERT_EQ(::getrlimit(RLIMIT_FSIZE, &before), 0);
  auto* const handler = std::signal(SIGXFSZ, SIG_IGN);
  rlimit little = before;
  little.rlim_cur = 64;
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &little), 0);
  const auto full = store.save(session("a"), "x = 1\n");
  ::setrlimit(RLIMIT_FSIZE, &before);
  std::signal(SIGXFSZ, handler);
  ASSERT_FALSE(full);
  EXPECT_THAT(full.error(), HasSubstr("session.json"));
  EXPECT_EQ(files(), 0U);
  EXPECT_TRUE(store.list().empty());
  EXPECT_TRUE(store.save(session("a"), "x = 1\n")) << "with room again";
}

TEST_F(Sessions, TheWorkerAnswersEachAndSavesWhatWasAskedBeforeItsEnd) {
  using Kind = SessionWorker::Job::Kind;
  {
    SessionWorker worker(root_.string(), false);
    ASSERT_TRUE(worker.put({Kind::kSave, 7, 1, session("a"), "x = 1\n"}));
    ASSERT_TRUE(worker.put({Kind::kOpen, 7, 2, session("none"), {}}));
    std::vector<SessionWorker::Done> done;
    for (int i = 0; i < 2000 && done.size() < 2; ++i) {
      for (auto& d : worker.take()) done.push_back(std::move(d));
      std::this_thread::sleep_for(std::chrono::milliseconds{5});
    }
    ASSERT_EQ(done.size(), 2U);
    EXPECT_EQ(done[0].id, 1);
    EXPECT_TRUE(done[0].why.empty()) << done[0].why;
    EXPECT_EQ(done[0].rows.size(), 1U);
    EXPECT_THAT(done[1].why, HasSubstr("no saved session none"));
    ASSERT_TRUE(worker.put({Kind::kSave, 7, 3, session("last"), ""}));
  }
  EXPECT_TRUE(SessionStore(root_.string()).read("last"));
}

}  // namespace
