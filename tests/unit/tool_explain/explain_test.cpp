// What a scene asks for is built, and nothing else: each effect asked for alone, and every shipped
// scene.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <set>
#include <sstream>

#include "tools/host/effect_costs.hpp"
#include "tools/scene/effect_catalogue.hpp"
#include "tools/teletact/commands.hpp"

namespace teletact {
namespace {

namespace fs = std::filesystem;

rt::Startup& startup() {
  static rt::Startup s;
  return s;
}

std::string text_of(const std::string& path) {
  std::ifstream in(path);
  std::ostringstream out;
  out << in.rdbuf();
  return out.str();
}

// The empty room with more in it.
class BareScene {
 public:
  explicit BareScene(const std::string& more) {
    path_ = fs::temp_directory_path() / ("explain_" + std::to_string(getpid()) + ".toml");
    std::ofstream(path_) << text_of(find_config("scenes", "empty_room")) << "\n" << more;
    scene_ = load_scene(path_.string(), {});
  }
  ~BareScene() { fs::remove(path_); }
  BareScene(const BareScene&) = delete;
  BareScene& operator=(const BareScene&) = delete;
  [[nodiscard]] Scene& scene() { return *scene_; }

 private:
  fs::path path_;
  std::unique_ptr<Scene> scene_;
};

std::vector<std::string> names_of(const Explained& e) {
  std::vector<std::string> names;
  for (const ExplainedEffect& effect : e.asked) names.emplace_back(effect.row->name);
  return names;
}

TEST(Explain, ASceneThatAsksForNothingGetsNothing) {
  BareScene bare("");
  const Explained e = explain_effects(startup().token(), bare.scene());
  EXPECT_THAT(names_of(e), testing::IsEmpty());
  EXPECT_EQ(e.not_asked.size(), effect_catalogue().size());
}

TEST(Explain, EachEffectIsBuiltAloneWhereItAloneIsAskedFor) {
  for (const EffectRow& row : effect_catalogue()) {
    SCOPED_TRACE(row.key);
    BareScene scene(row.ask);
    const Explained e = explain_effects(startup().token(), scene.scene());
    // Joints are of an arm.
    std::vector<std::string> expected{row.name};
    if (std::string(row.name).rfind("robot: joints", 0) == 0)
      expected.insert(expected.begin(), "robot: an arm before the camera");
    EXPECT_EQ(names_of(e), expected);
    EXPECT_EQ(e.asked.size() + e.not_asked.size(), effect_catalogue().size());
    // The last word of the key is in the file that asks.
    const std::string key = row.key;
    EXPECT_NE(std::string(row.ask).find(key.substr(key.rfind('.') + 1)), std::string::npos);
  }
}

// Of a shipped scene: a row is built when, and only when, the file names its key.
TEST(Explain, AShippedSceneBuildsWhatItsFileNames) {
  std::set<std::string> seen;
  for (const auto& entry :
       fs::directory_iterator(fs::path(find_config("scenes", "empty_room")).parent_path())) {
    if (entry.path().extension() != ".toml") continue;
    const std::string name = entry.path().stem().string();
    SCOPED_TRACE(name);
    const auto scene = load_scene(entry.path().string(), {});
    const Explained e = explain_effects(startup().token(), *scene);
    for (const ExplainedEffect& effect : e.asked) {
      const std::string key = effect.row->key;
      const std::string word = key.substr(key.rfind('.') + 1);
      EXPECT_NE(text_of(entry.path().string()).find(word), std::string::npos) << key;
    }
    for (const EffectRow* row : e.not_asked) {
      // Walks the schema down to the key: nobody named it, or it is there with a value that asks
      // for nothing.
      std::istringstream path(row->key);
      const config::Section* at = &scene->schema;
      std::string word;
      bool named = false;
      while (std::getline(path, word, '.')) {
        const config::Section::Field* found = nullptr;
        for (const auto& field : at->fields())
          if (field->key == word) found = field.get();
        ASSERT_NE(found, nullptr) << row->key << " is no key of a scene";
        named = found->named;
        if (const auto* list = std::get_if<config::Section::List>(&found->value))
          named = !list->items.empty();
        if (const auto* down = std::get_if<std::unique_ptr<config::Section>>(&found->value))
          at = down->get();
      }
      EXPECT_FALSE(named) << row->key << " is named and builds nothing";
    }
    seen.insert(name);
  }
  EXPECT_GE(seen.size(), 8U);
}

TEST(Explain, ItSaysWhichKeyAsksWithItsValue) {
  BareScene scene("[robot.plant]\nslip_ratio = 0.07\n");
  const Explained e = explain_effects(startup().token(), scene.scene());
  ASSERT_EQ(e.asked.size(), 1U);
  EXPECT_STREQ(e.asked[0].row->key, "robot.plant.slip_ratio");
  EXPECT_EQ(e.asked[0].value, "0.07");
}

// Costs are of the machine that measured them, and most are not told from none.
TEST(Explain, ItSaysOnWhichMachineCostsWereMeasuredAndHowManyAreTold) {
  std::string words[] = {"explain", "empty_room"};
  char* argv[] = {words[0].data(), words[1].data(), nullptr};
  testing::internal::CaptureStdout();
  EXPECT_EQ(cmd_explain(2, argv), 0);
  const std::string said = testing::internal::GetCapturedStdout();
  const auto costs = load_effect_costs(find_config("limits", "effect_costs"));
  ASSERT_TRUE(costs) << costs.error();
  std::size_t told = 0;
  for (const EffectCost& c : costs.value().rows) told += std::abs(c.us) > c.floor_us ? 1 : 0;
  EXPECT_THAT(said, testing::HasSubstr("above it: " + std::to_string(told) + " of " +
                                       std::to_string(costs.value().rows.size()) + " rows"));
  EXPECT_THAT(said, testing::HasSubstr(costs.value().host + ".\n"));
  EXPECT_THAT(text_of(find_config("limits", "effect_costs")),
              testing::Not(testing::HasSubstr("\n# Alone")))
      << "a row of another machine: say so";
}

}  // namespace
}  // namespace teletact
