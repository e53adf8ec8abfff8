// What a person is told of pictures: words, and the tally of what arrived.
#include "tools/pictures/picture_words.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <memory>

#include "rt/quantile.hpp"
#include "rt/random.hpp"
#include "tools/pictures/link_seen.hpp"

namespace teletact {
namespace {

using drivers::Spared;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

TEST(PictureWords, SayWhatIsLoweredWhyAndWhenItComesBack) {
  EXPECT_THAT(spared_text({}), IsEmpty());
  EXPECT_THAT(
      spared_text({1, Spared::Why::kBusy}),
      AllOf(HasSubstr("1 step coarser"), HasSubstr("fill the road"), HasSubstr("comes back")));
  EXPECT_THAT(
      spared_text({3, Spared::Why::kLate}),
      AllOf(HasSubstr("3 steps coarser"), HasSubstr("round trip"), HasSubstr("comes back")));
  EXPECT_THAT(spared_text({4, Spared::Why::kLate}),
              AllOf(HasSubstr("3 steps coarser"), HasSubstr("24 pictures a second")));
  EXPECT_THAT(spared_text({5, Spared::Why::kBusy}), HasSubstr("20 pictures a second"));
  EXPECT_EQ(age_text(std::nullopt), "no picture yet");
  EXPECT_EQ(age_text(std::chrono::milliseconds{112}), "112 ms old");
  EXPECT_EQ(age_text(std::chrono::milliseconds{1440}), "1.4 s old");
}

TEST(SparedNews, ALineForEachChangeAndNoFlood) {
  SparedNews news;
  constexpr std::int64_t kS = 1000000000;
  EXPECT_THAT(news.look({}, 0), IsEmpty());
  EXPECT_THAT(news.look({1, Spared::Why::kBusy}, kS), HasSubstr("1 step"));
  EXPECT_THAT(news.look({1, Spared::Why::kBusy}, 2 * kS), IsEmpty()) << "it was said";
  EXPECT_THAT(news.look({}, 2 * kS), IsEmpty()) << "too soon";
  EXPECT_THAT(news.look({}, 3 * kS), HasSubstr("as fine and as many")) << "and it is said later";
  int lines = 0;
  for (std::int64_t t = 10 * kS; t < 20 * kS; t += kS / 100)
    lines +=
        news.look({static_cast<std::uint8_t>(t / (kS / 10) % 2), Spared::Why::kLate}, t).empty()
            ? 0
            : 1;
  EXPECT_LE(lines, 5) << "up and down ten times a second";
}

TEST(LinkSeen, TheTallyOfTheOldAndTheNewestIsThatOfAll) {
  rt::Random random(3, 1);
  std::vector<double> ages;
  LinkTally direct;
  const auto seen = std::make_unique<LinkSeen>();
  const auto ring = std::make_unique<tasks::LinkSamples>();
  constexpr int kSamples = 100000;  // more than stay whole
  double bytes = 0;
  for (int i = 0; i < kSamples; ++i) {
    tasks::LinkSample s;
    const double age_ms = std::floor(20 + 300 * random.uniform());
    s.stamp = rt::Time{} + rt::Nanos{i * 10000000LL};
    s.made = s.stamp - rt::Nanos{static_cast<std::int64_t>(age_ms * 1e6)};
    s.bytes = static_cast<std::uint32_t>(random.integer(100, 60000));
    s.picture = random.integer(0, 3) == 0;
    s.spared.rungs = static_cast<std::uint8_t>(random.integer(0, 5));
    if (s.picture) ages.push_back(age_ms), bytes += s.bytes;
    direct.add(s);
    ASSERT_TRUE(ring->try_push(s));
    if (i % 1000 == 0) seen->drain(*ring);
  }
  seen->drain(*ring);
  EXPECT_LT(seen->newest.size(), 2 * LinkSeen::kWhole);
  const LinkTally all = seen->all();
  EXPECT_EQ(all.pictures, ages.size());
  EXPECT_EQ(all.pictures, direct.pictures);
  EXPECT_EQ(all.pictures + all.states, static_cast<std::uint64_t>(kSamples));
  EXPECT_EQ(static_cast<double>(all.picture_bytes), bytes);
  for (const double q : {0.05, 0.5, 0.95, 1.0})
    EXPECT_EQ(LinkTally::quantile_ms(all.picture_ms, q), rt::quantile(ages, q)) << q;
  EXPECT_NEAR(all.spared_share(), 5.0 / 6, 0.02);
  EXPECT_EQ(LinkTally::quantile_ms(LinkTally{}.state_ms, 0.5), -1) << "none arrived";
}

}  // namespace
}  // namespace teletact
