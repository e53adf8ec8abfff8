// Reading EEPROMs: ESC data sheet II, registers 0x0500 to 0x050F; ETG.1000.4, 6.4. All slaves at
// once: a frame carries a datagram for each, so that eleven boards take the frames of one.
//
//   kReady     0x0502 not busy; errors of before are cleared by a command of zero
//   kCommand   0x0502 read, 0x0504 the word
//   kData      0x0502 to 0x050F: not busy any more, and 4 or 8 bytes, by the width it states
//
// Command and data are never in one frame: a slave takes a write when the frame has ended.
#include <algorithm>
#include <array>
#include <cstdio>

#include "drivers/ethercat/registers.hpp"
#include "drivers/ethercat/scan.hpp"

namespace drivers::ethercat {

namespace {

constexpr int kTriesOfNoAnswer = 3, kTriesOfCounter = 12;
constexpr std::size_t kMostWords = 0x4000;  // 32 KiB: no slave's EEPROM is larger
constexpr rt::Nanos kSiiTimeout = std::chrono::milliseconds{20};
// Asked at least so often: the caller's own thread may have been away for all of that time.
constexpr int kLeastPolls = 8;
constexpr rt::Nanos kSiiPoll = std::chrono::microseconds{50};
constexpr std::size_t kDataBytes = 14;  // 0x0502 to 0x050F
constexpr std::size_t kSlavesAFrame = 50;

enum class Step : std::uint8_t { kReady, kClear, kCommand, kData, kEnd };

struct Reading {
  std::uint16_t station = 0;
  std::size_t first_word = 0, words = 0;  // what is wanted
  bool whole = false;                     // `words` grow with the heads of categories
  Step step = Step::kReady;
  std::vector<std::uint8_t> bytes;
  std::string problem;
  int polls = 0, no_answer = 0, wrong_counter = 0;
  rt::Time asked{};

  [[nodiscard]] std::size_t word() const noexcept { return first_word + bytes.size() / 2; }
  void fail(const char* what) {
    std::array<char, 128> text{};
    std::snprintf(text.data(), text.size(), "SII word 0x%04zX: %s", word(), what);
    problem = text.data();
    step = Step::kEnd;
  }
  void go(Step next, rt::Time now) noexcept {
    step = next;
    polls = 0;
    asked = now;
  }
};

void add_to(FrameExchange& frame, const Reading& s) noexcept {
  const std::uint32_t control = station_address(s.station, reg::kSiiControl);
  std::array<std::uint8_t, 6> command{};
  switch (s.step) {
    case Step::kReady:
      (void)frame.add(Command::kFprd, control, 2);
      return;
    case Step::kClear:
      (void)frame.add(Command::kFpwr, control, 2, std::span(command).first(2));
      return;
    case Step::kCommand:
      store_u16(command, 0, sii_control::kRead);
      store_u32(command, 2, static_cast<std::uint32_t>(s.word()));
      (void)frame.add(Command::kFpwr, control, command.size(), command);
      return;
    case Step::kData:
      (void)frame.add(Command::kFprd, control, kDataBytes);
      return;
    case Step::kEnd:
      return;
  }
}

// Heads of categories say how much more there is.
void grow(Reading& s) {
  while (s.whole && s.bytes.size() >= 2 * (s.words + 2)) {
    const auto head = std::span<const std::uint8_t>(s.bytes).subspan(2 * s.words, 4);
    const std::size_t more = load_u16(head, 2);
    if (load_u16(head) == sii_category::kEnd) {
      s.words += 2;
      s.whole = false;
    } else if (more > kMostWords) {
      return s.fail("a category larger than any EEPROM");
    } else {
      s.words += 2 + more;
    }
    if (s.words >= kMostWords) return s.fail("no end of the categories");
  }
  if (s.whole || s.bytes.size() < 2 * s.words) return;
  s.bytes.resize(2 * s.words);
  s.step = Step::kEnd;
}

void take(Reading& s, const DatagramView& d, RegisterAccess& r) {
  const rt::Time now = r.port().now();
  if (d.counter != 1) {
    r.count_wrong_counter();
    if (++s.wrong_counter >= kTriesOfCounter) s.fail("the slave does not answer");
    return;
  }
  s.wrong_counter = 0;
  if (s.step == Step::kClear) return s.go(Step::kCommand, now);
  if (s.step == Step::kCommand) return s.go(Step::kData, now);
  const unsigned control = load_u16(d.data);
  if ((control & sii_control::kBusy) != 0) {
    if (++s.polls >= kLeastPolls && now >= s.asked + kSiiTimeout)
      s.fail("the EEPROM stays busy: it is damaged, or not there");
    return;
  }
  if (s.step == Step::kReady)
    return s.go((control & sii_control::kErrors) != 0 ? Step::kClear : Step::kCommand, now);
  if ((control & sii_control::kNoAnswer) != 0) {
    if (++s.no_answer >= kTriesOfNoAnswer)
      return s.fail("the EEPROM does not answer: it is damaged, or not there");
    return s.go(Step::kReady, now);
  }
  s.no_answer = 0;
  const std::size_t width = (control & sii_control::kReadsEight) != 0 ? 8 : 4;
  const auto data = d.data.subspan(reg::kSiiData - reg::kSiiControl, width);
  s.bytes.insert(s.bytes.end(), data.begin(), data.end());
  s.go(Step::kCommand, now);
  grow(s);
}

// Until each has its words or a problem.
void run(RegisterAccess& r, std::vector<Reading>& all) {
  std::vector<Reading*> at_work;
  for (;;) {
    at_work.clear();
    bool waits = true;
    for (Reading& s : all) {
      if (s.step == Step::kEnd || at_work.size() >= kSlavesAFrame) continue;
      at_work.push_back(&s);
      waits = waits && s.polls > 0;
    }
    if (at_work.empty()) return;
    if (waits) r.port().sleep_until(r.port().now() + kSiiPoll);
    const bool came = r.exchange([&](FrameExchange& frame) {
      for (const Reading* s : at_work) add_to(frame, *s);
    });
    for (std::size_t i = 0; i < at_work.size(); ++i) {
      if (came)
        take(*at_work[i], r.reply(i), r);
      else
        at_work[i]->fail(r.why());
    }
  }
}

}  // namespace

rt::Result<std::vector<std::uint8_t>> read_sii_words(RegisterAccess& r, std::uint16_t station,
                                                     std::size_t first_word, std::size_t words) {
  std::vector<Reading> one(1);
  one[0].station = station;
  one[0].first_word = first_word;
  one[0].words = words;
  if (words > 0) run(r, one);
  if (!one[0].problem.empty()) return rt::Error{one[0].problem};
  return std::move(one[0].bytes);
}

std::vector<rt::Result<std::vector<std::uint8_t>>> read_sii_images(
    RegisterAccess& r, std::span<const std::uint16_t> stations) {
  std::vector<Reading> all(stations.size());
  for (std::size_t i = 0; i < all.size(); ++i) {
    all[i].station = stations[i];
    all[i].words = sii_word::kCategories;
    all[i].whole = true;
  }
  run(r, all);
  std::vector<rt::Result<std::vector<std::uint8_t>>> out;
  for (Reading& s : all) {
    if (s.problem.empty())
      out.emplace_back(std::move(s.bytes));
    else
      out.emplace_back(rt::Error{s.problem});
  }
  return out;
}

}  // namespace drivers::ethercat
