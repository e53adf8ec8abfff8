// REPORT/raw: the files of an earlier run are replaced, and nothing that a user has put there is
// lost.
#include "tools/host/run_folder.hpp"
#include "tests/support/paths.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <set>
#include <sstream>

namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;
using testing::Not;

const std::string kMark = teletact::kRunFolderMark;

class RunFolder : public testing::Test {
 protected:
  RunFolder() { fs::create_directories(raw()); }
  ~RunFolder() override { fs::remove_all(report_); }

  [[nodiscard]] std::string report() const { return report_; }
  [[nodiscard]] std::string raw() const { return report_ / "raw"; }
  void put(const std::string& name, const std::string& text = "mine") const {
    std::ofstream(raw() + "/" + name) << text;
  }
  [[nodiscard]] std::string text_of(const std::string& name) const {
    std::stringstream s;
    s << std::ifstream(raw() + "/" + name).rdbuf();
    return s.str();
  }
  [[nodiscard]] std::set<std::string> names() const {
    std::set<std::string> out;
    for (const auto& e : fs::directory_iterator(raw())) out.insert(e.path().filename());
    return out;
  }
  // What is said when the folder is made and when it is cleared; empty: neither refused.
  [[nodiscard]] std::string refusal() const {
    std::string made, cleared;
    try {
      teletact::make_run_folder(report());
    } catch (const std::runtime_error& e) {
      made = e.what();
    }
    try {
      teletact::clear_run_folder(raw());
    } catch (const std::runtime_error& e) {
      cleared = e.what();
    }
    EXPECT_EQ(made, cleared);
    return made;
  }

 private:
  fs::path report_ =
      fs::temp_directory_path() / ("teletact_folder_" + std::to_string(::getpid()) + "_" +
                                   testing::UnitTest::GetInstance()->current_test_info()->name());
};

const std::set<std::string> kOfARun{"operator.log",     "robot.log",
                                    "operator.run",     "robot.run",
                                    "operator.view",    "robot.view.tmp",
                                    "operator.effects", "robot.inputs",
                                    "operator.stop",    "robot.stop",
                                    "robot.port",       "robot.port.tmp",
                                    "scene.toml",       "faults.toml",
                                    "scene.ply",        "scene.ply.tmp4711",
                                    "console.log",      "console.json",
                                    "link.cut",         "notes",
                                    "not_realtime",     "pids"};

TEST_F(RunFolder, AnEarlierRunsFilesAreTakenAway) {
  for (const auto& name : kOfARun) put(name);
  teletact::make_run_folder(report());
  EXPECT_EQ(names().size(), kOfARun.size() + 1) << "made, nothing is taken away yet";
  teletact::clear_run_folder(raw());
  EXPECT_EQ(names(), std::set<std::string>{kMark});
}

// The evidence of a crash outlives the restart that follows it: a few times, and no more.
TEST_F(RunFolder, BlackBoxesAreKeptWithTheLogsBesideThem) {
  teletact::make_run_folder(report());
  for (int run = 1; run <= 8; ++run) {
    for (const std::string name : {"robot.log", "robot.1.log", "robot.run", "robot.stop",
                                   "robot.blackbox", "robot.stop12.blackbox"})
      put(name, "run " + std::to_string(run));
    EXPECT_EQ(refusal(), "") << run;
  }
  EXPECT_EQ(names(), (std::set<std::string>{kMark, "before-1", "before-5", "before-6", "before-7",
                                            "before-8"}))
      << "the first one, where a crash loop began, and the newest four";
  EXPECT_EQ(text_of("before-1/robot.blackbox"), "run 1");
  for (const std::string name : {"robot.blackbox", "robot.stop12.blackbox", "robot.log"})
    EXPECT_EQ(text_of("before-8/" + name), "run 8") << name;
  EXPECT_FALSE(fs::exists(raw() + "/before-8/robot.run"));
  put("robot.log", "nothing happened in this one");
  EXPECT_EQ(refusal(), "");
  EXPECT_FALSE(fs::exists(raw() + "/before-9"));
  std::ofstream(raw() + "/before-8/mine") << "mine";
  EXPECT_THAT(refusal(), HasSubstr("holds before-8,")) << "what a user put there is the user's";
  EXPECT_EQ(text_of("before-8/mine"), "mine");
}

TEST_F(RunFolder, WhatNoRunWroteIsRefusedAndAllStays) {
  for (const std::string name :
       {"thesis.pdf", "operator", "operator.run.old", "my_robot.run", "robot.blackbox.gz",
        "operator.stop.blackbox", "operator.stopx.blackbox", "operator.stop1", "mine.blackbox",
        "before-1", "before-x", "mine.stop", "scene.ply.tmp", "scene.ply.tmpx", "Notes", "pids~"}) {
    for (const auto& other : kOfARun) put(other);
    put(name);
    const auto before = names();
    const std::string said = refusal();
    EXPECT_THAT(said, HasSubstr(raw() + " holds " + name + ",")) << name;
    EXPECT_THAT(said, Not(HasSubstr("\n"))) << name;
    EXPECT_EQ(names(), before) << name;
    EXPECT_EQ(text_of(name), "mine");
    fs::remove(raw() + "/" + name);
  }
}

// Names that anybody could give: a run's only beside its mark, or beside a box's own files.
TEST_F(RunFolder, NotesOfAUserAreNoRuns) {
  put("notes");
  put("scene.toml");
  EXPECT_THAT(refusal(), HasSubstr(raw() + " holds notes,"));
  EXPECT_EQ(names(), (std::set<std::string>{"notes", "scene.toml"}));
  put("robot.log");
  EXPECT_EQ(refusal(), "");
  EXPECT_EQ(names(), std::set<std::string>{kMark});
  put("pids");  // of a run that did not come as far as a log
  EXPECT_EQ(refusal(), "");
  EXPECT_EQ(names(), std::set<std::string>{kMark});
}

TEST_F(RunFolder, AFolderOrALinkUnderARunsNameIsNoRuns) {
  fs::create_directories(raw() + "/robot.run");
  std::ofstream(raw() + "/robot.run/mine") << "mine";
  EXPECT_THAT(refusal(), HasSubstr("holds robot.run,"));
  EXPECT_EQ(text_of("robot.run/mine"), "mine");
  fs::rename(raw() + "/robot.run", report() + "/mine");
  fs::create_symlink(report() + "/mine/mine", raw() + "/operator.log");
  EXPECT_THAT(refusal(), HasSubstr("holds operator.log,"));
  EXPECT_EQ(text_of("../mine/mine"), "mine");
}

// The job records of a box are a folder; it is a run's when nothing else is in it.
TEST_F(RunFolder, AStoreIsARunsUnlessItHoldsAnythingElse) {
  const auto make = [&](const std::string& more) {
    fs::create_directories(raw() + "/robot.run");
    for (const std::string name : {"header", "whole-00000000", "part-00000000-00000005", "end",
                                   "part-00000001-00000001.tmp"})
      std::ofstream(raw() + "/robot.run/" + name) << "of a run";
    if (!more.empty()) std::ofstream(raw() + "/robot.run/" + more) << "mine";
  };
  for (const std::string mine : {"notes.txt", "whole-1", "part-00000002-00000001", "header.old"}) {
    make(mine);
    EXPECT_THAT(refusal(), HasSubstr("holds robot.run,")) << mine;
    EXPECT_EQ(text_of("robot.run/" + mine), "mine");
    fs::remove_all(raw() + "/robot.run");
  }
  make("");
  EXPECT_EQ(refusal(), "");
  EXPECT_EQ(names(), std::set<std::string>{kMark});
}

TEST_F(RunFolder, IsMadeWhereThereIsNone) {
  fs::remove_all(report());
  teletact::make_run_folder(report());
  EXPECT_EQ(names(), std::set<std::string>{kMark});
  teletact::make_run_folder(report());
  EXPECT_EQ(names(), std::set<std::string>{kMark});
}

std::pair<int, std::string> demo(const std::string& words) {
  const std::string command = tests::in_build("teletact") + " demo --quiet " + words + " 2>&1";
  std::FILE* pipe = ::popen(command.c_str(), "r");
  std::string text;
  char part[4096];
  for (std::size_t n = 0; (n = std::fread(part, 1, sizeof part, pipe)) > 0;) text.append(part, n);
  const int status = ::pclose(pipe);
  return {WIFEXITED(status) ? WEXITSTATUS(status) : 128, text};
}

// On both forms of simulated time; on the real clock what takes the files away is the same.
TEST_F(RunFolder, ADemoKeepsWhatIsAUsers) {
  put("thesis.txt");
  for (const std::string clock : {"paced", "virtual", "auto"}) {
    const auto [code, text] = demo("--seconds 0.5 --clock " + clock + " --report " + report());
    EXPECT_EQ(code, 2) << text;
    EXPECT_THAT(text, HasSubstr(raw() + " holds thesis.txt, which no run wrote")) << clock;
    EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 1) << text;
    EXPECT_EQ(names(), std::set<std::string>{"thesis.txt"}) << clock;
    EXPECT_EQ(text_of("thesis.txt"), "mine");
    EXPECT_FALSE(fs::exists(report() + "/report.html")) << "said before anything ran";
  }
}

TEST_F(RunFolder, ADemoAfterADemoLeavesNothingOfTheFirst) {
  const std::string first = "--seconds 0.5 --clock virtual --record --report " + report();
  (void)demo(first);
  EXPECT_TRUE(fs::exists(raw() + "/operator.inputs"));
  EXPECT_TRUE(fs::exists(raw() + "/scene.toml"));
  put("robot.run", "of a run on the real clock");
  const auto [code, text] = demo("--seconds 0.5 --clock paced --report " + report());
  EXPECT_THAT(text, Not(HasSubstr("holds")));
  EXPECT_EQ(names(), (std::set<std::string>{kMark, "operator.log", "operator.run", "operator.view",
                                            "robot.log", "robot.run", "robot.view"}));
  EXPECT_TRUE(fs::is_directory(raw() + "/robot.run")) << "the store of this run, not that file";
  EXPECT_THAT(text_of(kMark), HasSubstr("teletact demo"));
}

}  // namespace
