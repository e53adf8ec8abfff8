// Reading an EEPROM: ESC data sheet II, registers 0x0500 to 0x050F; ETG.1000.4, 6.4.
#include <algorithm>
#include <array>
#include <cstdio>

#include "drivers/ethercat/registers.hpp"
#include "drivers/ethercat/scan.hpp"

namespace drivers::ethercat {

namespace {

constexpr int kTriesOfNoAnswer = 3;
constexpr std::size_t kMostWords = 0x4000;  // 32 KiB: no slave's EEPROM is larger
constexpr rt::Nanos kSiiTimeout = std::chrono::milliseconds{20};
// Asked at least so often: the caller's own thread may have been away for all of that time.
constexpr int kLeastPolls = 8;
constexpr rt::Nanos kSiiPoll = std::chrono::microseconds{50};

rt::Error sii_problem(std::uint16_t station, std::size_t word, const char* what) {
  std::array<char, 128> text{};
  std::snprintf(text.data(), text.size(), "station 0x%04X, SII word 0x%04zX: %s", station, word,
                what);
  return {text.data()};
}

// Waits until bit 15 is clear. The control word; nullopt: no answer, or busy for too long.
std::optional<std::uint16_t> wait_ready(RegisterAccess& r, std::uint16_t station) {
  const rt::Time end = r.port().now() + kSiiTimeout;
  for (int polls = 1;; ++polls) {
    const auto control = r.read_u16(station, reg::kSiiControl);
    if (!control || (*control & sii_control::kBusy) == 0) return control;
    if (polls >= kLeastPolls && r.port().now() >= end) return std::nullopt;
    r.port().sleep_until(r.port().now() + kSiiPoll);
  }
}

// 4 or 8 bytes from `word` on, by the width that the slave states; 0: failed.
std::size_t read_once(RegisterAccess& r, std::uint16_t station, std::size_t word,
                      std::array<std::uint8_t, 8>& out) {
  for (int attempt = 0; attempt < kTriesOfNoAnswer; ++attempt) {
    auto control = wait_ready(r, station);
    if (!control) return 0;
    if ((*control & sii_control::kErrors) != 0)
      (void)r.write_u16(station, reg::kSiiControl, 0);  // clears what stands from before
    std::array<std::uint8_t, 6> command{};
    store_u16(command, 0, sii_control::kRead);
    store_u32(command, 2, static_cast<std::uint32_t>(word));
    if (!r.write(station, reg::kSiiControl, command)) return 0;
    control = wait_ready(r, station);
    if (!control) return 0;
    if ((*control & sii_control::kNoAnswer) != 0) continue;
    const std::size_t width = (*control & sii_control::kReadsEight) != 0 ? 8 : 4;
    if (!r.read(station, reg::kSiiData, std::span(out).first(width))) return 0;
    return width;
  }
  return 0;
}

}  // namespace

rt::Result<std::vector<std::uint8_t>> read_sii_words(RegisterAccess& r, std::uint16_t station,
                                                     std::size_t first_word, std::size_t words) {
  std::vector<std::uint8_t> out;
  out.reserve(2 * words + 8);
  std::array<std::uint8_t, 8> piece{};
  while (out.size() < 2 * words) {
    const std::size_t word = first_word + out.size() / 2;
    const std::size_t width = read_once(r, station, word, piece);
    if (width == 0) return sii_problem(station, word, "can not be read");
    out.insert(out.end(), piece.begin(), piece.begin() + static_cast<std::ptrdiff_t>(width));
  }
  out.resize(2 * words);
  return out;
}

rt::Result<std::vector<std::uint8_t>> read_sii_image(RegisterAccess& r, std::uint16_t station) {
  auto image = read_sii_words(r, station, 0, sii_word::kCategories);
  while (image) {
    const std::size_t at = image.value().size() / 2;
    if (at >= kMostWords) return sii_problem(station, at, "no end of the categories");
    const auto head = read_sii_words(r, station, at, 2);
    if (!head) return head;
    auto& all = image.value();
    all.insert(all.end(), head.value().begin(), head.value().end());
    if (load_u16(head.value()) == sii_category::kEnd) return image;
    const std::size_t words = load_u16(head.value(), 2);
    if (words > kMostWords) return sii_problem(station, at, "a category larger than any EEPROM");
    const auto data = read_sii_words(r, station, at + 2, words);
    if (!data) return data;
    all.insert(all.end(), data.value().begin(), data.value().end());
  }
  return image;
}

}  // namespace drivers::ethercat
