// [link.network] as text: what is taken, and one clear error for each key.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "drivers/emulator/network_config.hpp"

namespace {

using drivers::NetworkConfig;
using drivers::Way;

// The error, from the reader or from what holds keys against each other; empty: taken.
std::string refusal(const std::string& text) {
  NetworkConfig c;
  config::Section root;
  c.describe(root.section("link").section("network"));
  auto ok = config::load_text("[link.network]\n" + text, "scene.toml", root);
  return ok ? c.wrong() : ok.error();
}

TEST(NetworkConfig, AWholeOneIsRead) {
  NetworkConfig c;
  config::Section root;
  c.describe(root.section("link").section("network"));
  const auto ok = config::load_text(R"(
[link.network]
rate_Mbit_per_s = 10
queue_kB = 150
delay_ms = 75
jitter_ms = 20
seed = 7
flaps_per_minute = 10
flap_down_ms = 500
flap_from_s = 6
corrupt_per_MB = 2
corrupt_from_s = 3
[[link.network.rate_change]]
at_s = 20
rate_Mbit_per_s = 4
[[link.network.rate_change]]
at_s = 40
[[link.network.stall]]
at_s = 4
every_s = 4
[[link.network.cut]]
at_s = 60
way = "to_robot"
)",
                                    "scene.toml", root);
  ASSERT_TRUE(ok) << ok.error();
  EXPECT_EQ(c.wrong(), "");
  EXPECT_TRUE(c.any());
  ASSERT_EQ(c.rate_changes.size(), 2U);
  EXPECT_EQ(c.rate_changes[0].rate_Mbit_per_s, 4);
  EXPECT_EQ(c.rate_changes[1].rate_Mbit_per_s, 10);
  ASSERT_EQ(c.stalls.size(), 1U);
  EXPECT_EQ(c.stalls[0].for_ms, 400);
  ASSERT_EQ(c.cuts.size(), 1U);
  EXPECT_TRUE(c.cuts[0].of(Way::kToRobot));
  EXPECT_FALSE(c.cuts[0].of(Way::kToOperator));
  EXPECT_EQ(c.flaps_per_minute, 10);
  EXPECT_EQ(c.corrupt_per_MB, 2);
  EXPECT_EQ(c.seed, 7U);

  // What is in force is a text that gives the same again: a run saves its scene so.
  NetworkConfig again;
  config::Section root_again;
  again.describe(root_again.section("link").section("network"));
  const auto same = config::load_text(config::effective(root), "effective", root_again);
  ASSERT_TRUE(same) << same.error();
  EXPECT_EQ(config::effective(root_again), config::effective(root));
  ASSERT_EQ(again.cuts.size(), 1U);
  EXPECT_EQ(again.cuts[0].way, "to_robot");
}

TEST(NetworkConfig, NothingNamedIsNoNetwork) {
  EXPECT_FALSE(NetworkConfig{}.any());
  EXPECT_EQ(NetworkConfig{}.wrong(), "");
  // What only tunes a network that is not there is none.
  NetworkConfig c;
  c.seed = 3;
  c.queue_kB = 10;
  c.flap_down_ms = 100;
  EXPECT_FALSE(c.any());
}

TEST(NetworkConfig, OneClearErrorForEachKey) {
  const std::pair<const char*, const char*> wrong[] = {
      {"rate_Mbit_per_s = -1", "rate_Mbit_per_s"},
      {"queue_kB = 0", "queue_kB"},
      {"delay_ms = 3000", "delay_ms"},
      {"jitter_ms = -5", "jitter_ms"},
      {"seed = -1", "seed"},
      {"flaps_per_minute = 1000", "flaps_per_minute"},
      {"flap_down_ms = 0", "flap_down_ms"},
      {"flap_from_s = -1", "flap_from_s"},
      {"corrupt_per_MB = 1e6", "corrupt_per_MB"},
      {"corrupt_from_s = \"now\"", "corrupt_from_s"},
      {"loss = 0.1", "loss"},
      {"stall = [{at_s = -1}]", "at_s"},
      {"stall = [{for_ms = 0}]", "for_ms"},
      {"stall = [{every_s = -1}]", "every_s"},
      {"cut = [{way = \"left\"}]", "way"},
      {"cut = [{at_s = -2}]", "at_s"},
      {"rate_Mbit_per_s = 1\nrate_change = [{rate_Mbit_per_s = 0}]", "rate_Mbit_per_s"},
      {"rate_Mbit_per_s = 1\nrate_change = [{at_s = -1}]", "at_s"},
      // Keys against each other.
      {"rate_change = [{at_s = 1}]", "link.network.rate_Mbit_per_s"},
      {"rate_Mbit_per_s = 1\nrate_change = [{at_s = 2}, {at_s = 2}]",
       "link.network.rate_change.at_s"},
      {"stall = [{for_ms = 950, every_s = 1}]", "link.network.stall"},
      {"stall = [{for_ms = 500, every_s = 1}, {for_ms = 900, every_s = 2}]", "link.network.stall"},
      {"flaps_per_minute = 60\nflap_down_ms = 500", "link.network.flap_down_ms"},
  };
  for (const auto& [text, key] : wrong) {
    const std::string error = refusal(text);
    EXPECT_THAT(error, testing::HasSubstr(key)) << text;
    EXPECT_EQ(error.find('\n'), std::string::npos) << error;
    if (std::string(text) != "loss = 0.1") {
      EXPECT_THAT(error, testing::HasSubstr("allowed")) << text;
    }
  }
  EXPECT_EQ(refusal("stall = [{for_ms = 900, every_s = 1}]"), "");
  EXPECT_EQ(refusal("stall = [{for_ms = 2000}]"), "") << "once may take longer than what repeats";
}

}  // namespace
