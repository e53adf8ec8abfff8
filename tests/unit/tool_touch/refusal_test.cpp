// What teletact touch refuses: one line that names file or option, and no file left.
#include <gtest/gtest.h>

#include <functional>
#include <limits>
#include <sstream>

#include "tests/unit/tool_touch/touch_files.hpp"

namespace {

using namespace touch_files;

class TouchRefusal : public Touch {
 protected:
  // Neither a trace nor the beginning of one.
  [[nodiscard]] bool nothing_left() const {
    for (const auto& e : fs::directory_iterator(dir_)) {
      if (e.path().filename().string().find("trace.csv") != std::string::npos) return false;
    }
    return true;
  }
};

TEST_F(TouchRefusal, BadInputIsOneMessageAndNoFile) {
  struct Case {
    const char* name;
    std::function<void(std::vector<std::string>&)> spoil;
    const char* says;
  };
  const auto replace = [](std::vector<std::string>& a, const char* key, const std::string& value) {
    for (std::size_t i = 0; i + 1 < a.size(); ++i) {
      if (a[i] == key) a[i + 1] = value;
    }
  };
  const std::vector<Case> cases{
      {"no field", [&](auto& a) { replace(a, "--field", (dir_ / "no.npy").string()); }, "no.npy"},
      {"no path", [&](auto& a) { replace(a, "--path", (dir_ / "no.csv").string()); }, "no.csv"},
      {"method", [&](auto& a) { replace(a, "--method", "magic"); },
       "constrained, nearest, nearest10"},
      {"voxel", [&](auto& a) { replace(a, "--voxel", "-1"); }, "--voxel"},
      {"voxel text", [&](auto& a) { replace(a, "--voxel", "ten"); }, "ten"},
      {"unknown option", [&](auto& a) { a.push_back("--colour"); }, "--colour"},
      {"origin", [&](auto& a) { a[4] = "--origin=1,2"; }, "--origin"},
      {"truncated field", [&](auto&) { write(dir_ / "floor.npy", floor(0).substr(0, 9000)); },
       "bytes of data"},
      {"int32",
       [&](auto&) {
         write(dir_ / "floor.npy", npy_bytes({1, 2}, "(2,)", "<i4"));
       },
       "<f4"},
      {"two dimensions",
       [&](auto&) {
         write(dir_ / "floor.npy", npy_bytes({1, 2, 3, 4}, "(2, 2)"));
       },
       "dimensions"},
      {"infinite",
       [&](auto&) {
         std::vector<float> v(8, 1.0F);
         v[3] = std::numeric_limits<float>::infinity();
         write(dir_ / "floor.npy", npy_bytes(v, "(2, 2, 2)"));
       },
       "infinite"},
      {"hand word",
       [&](auto&) { write(dir_ / "hand.csv", "t_s,x,y,z\n0,0,0,0\n0.001,0,zero,0\n"); }, "zero"},
      {"hand nan", [&](auto&) { write(dir_ / "hand.csv", "t_s,x,y,z\n0,0,0,0\n0.001,0,nan,0\n"); },
       "finite"},
      {"hand time", [&](auto&) { write(dir_ / "hand.csv", "t_s,x,y,z\n0.1,0,0,0\n0.1,0,0,0\n"); },
       "rise"},
      {"hand column", [&](auto&) { write(dir_ / "hand.csv", "t_s,x,y\n0,0,0\n"); }, "'z'"},
      {"hand empty", [&](auto&) { write(dir_ / "hand.csv", "t_s,x,y,z\n"); }, "no data"},
      {"out folder", [&](auto& a) { replace(a, "--out", (dir_ / "no" / "trace.csv").string()); },
       "written"},
  };
  for (const Case& c : cases) {
    SetUp();
    auto args = standard();
    c.spoil(args);
    const std::string message = refusal(args);
    EXPECT_NE(message.find(c.says), std::string::npos) << c.name << ": " << message;
    EXPECT_EQ(message.find('\n'), std::string::npos) << c.name << ": " << message;
    EXPECT_FALSE(fs::exists(dir_ / "trace.csv")) << c.name;
    for (const auto& e : fs::directory_iterator(dir_))
      EXPECT_EQ(e.path().filename().string().find("trace.csv"), std::string::npos) << c.name;
  }
}

// A position that the task takes for no position at all.
TEST_F(TouchRefusal, AHandOutOfTheDevicesReachIsRefused) {
  write(dir_ / "hand.csv", "t_s,x,y,z\n0,20,0.31,0.42\n0.001,20,0.31,0.42\n0.002,31,0.31,0.42\n");
  std::string said = refusal(standard());
  EXPECT_NE(said.find("hand.csv:4: 11"), std::string::npos) << said;
  EXPECT_NE(said.find("allowed are 10"), std::string::npos) << said;
  // The border is round the world's origin, and would run away from so far a hand.
  write(dir_ / "hand.csv", press(20));
  auto args = standard();
  args[4] = "--origin=19.9,0.2,0.3";
  args.insert(args.end(), {"--border", "0.5"});
  said = refusal(args);
  EXPECT_NE(said.find("hand.csv:2: "), std::string::npos) << said;
  EXPECT_NE(said.find("--border"), std::string::npos) << said;
  EXPECT_TRUE(nothing_left());
}

// Zeros all along would say that the hand touched nothing.
TEST_F(TouchRefusal, AHandThatMeetsNoKnownSpaceIsRefused) {
  auto away = standard();
  away[4] = "--origin=-50.1,0.2,0.3";
  std::string said = refusal(away);
  EXPECT_NE(said.find("floor.npy: "), std::string::npos) << said;
  EXPECT_NE(said.find("-50.1"), std::string::npos) << said;
  EXPECT_NE(said.find("-0.01"), std::string::npos) << said;
  EXPECT_TRUE(nothing_left());
  write(dir_ / "list.csv", "t_s,file\n50,floor.npy\n");
  auto late = standard();
  late[0] = "--fields";
  late[1] = (dir_ / "list.csv").string();
  said = refusal(late);
  EXPECT_NE(said.find("list.csv: "), std::string::npos) << said;
  EXPECT_NE(said.find("t_s 50,"), std::string::npos) << said;
  EXPECT_TRUE(nothing_left());
  write(dir_ / "floor.npy",
        npy_bytes(std::vector<float>(24 * 24 * 24, std::nanf("")), "(24, 24, 24)"));
  said = refusal(standard());
  EXPECT_NE(said.find("floor.npy: "), std::string::npos) << said;
  EXPECT_NE(said.find("known"), std::string::npos) << said;
  EXPECT_TRUE(nothing_left());
}

TEST_F(TouchRefusal, OptionsWithoutEffectAreRefused) {
  const auto with = [&](const std::vector<std::string>& more) {
    auto args = standard();
    args.insert(args.end(), more.begin(), more.end());
    return refusal(args);
  };
  EXPECT_NE(with({"--border-rate", "3"}).find("--border-rate needs --border"), std::string::npos);
  EXPECT_NE(with({"--texture-period", "0.01"}).find("--texture-period needs --texture"),
            std::string::npos);
  auto nowhere = standard();
  nowhere.back().clear();
  EXPECT_NE(refusal(nowhere).find("--out is empty"), std::string::npos);
  ASSERT_EQ(run(standard()), 0);
  auto recorded = standard();
  recorded.insert(recorded.end(), {"--record", (dir_ / "a.run").string()});
  ASSERT_EQ(run(recorded), 0);
  EXPECT_NE(refusal({"--replay", (dir_ / "a.run").string(), "--out", ""}).find("--out is empty"),
            std::string::npos);
}

TEST_F(TouchRefusal, BadRowsAreNamed) {
  const auto of_list = [&](const std::string& cell) {
    write(dir_ / "list.csv", "t_s,file\n0,floor.npy\n0.1," + cell + "\n");
    auto args = standard();
    args[0] = "--fields";
    args[1] = (dir_ / "list.csv").string();
    return refusal(args);
  };
  EXPECT_NE(of_list("").find("list.csv:3: no file"), std::string::npos) << of_list("");
  fs::create_directories(dir_ / "folder");
  EXPECT_NE(of_list("folder").find("list.csv:3: "), std::string::npos) << of_list("folder");
  EXPECT_NE(of_list("folder").find("is a folder"), std::string::npos);
  EXPECT_NE(of_list("none.npy").find("none.npy: cannot be opened"), std::string::npos);
  auto folder = standard();
  folder[1] = (dir_ / "folder").string();
  EXPECT_NE(refusal(folder).find("is a folder"), std::string::npos);
  write(dir_ / "hand.csv", "t_s,x,y,z,clutch\n0,0,0,0,0\n0.001,0,0,0,2\n");
  EXPECT_NE(refusal(standard()).find("hand.csv:3: clutch 2"), std::string::npos)
      << refusal(standard());
}

}  // namespace
