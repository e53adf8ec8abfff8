// A pcap file of EtherCAT frames, read twice: by the test's own reader and by tshark.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <fstream>
#include <map>
#include <span>
#include <sstream>
#include <string>
#include <vector>

#include "drivers/ethercat/bytes.hpp"

namespace tests {

namespace ec = drivers::ethercat;

inline std::string output_of(const std::string& command) {
  std::string out;
  std::FILE* pipe = ::popen((command + " 2>/dev/null").c_str(), "r");
  if (pipe == nullptr) return out;
  std::array<char, 4096> piece{};
  while (std::fgets(piece.data(), piece.size(), pipe) != nullptr) out += piece.data();
  ::pclose(pipe);
  return out;
}

// The same file by a reader of the test's own, from the words of ETG.1000.4, 5.2 to 5.4: what
// tshark must count, and what it does not look at: lengths, bits that are reserved, the more-bit,
// commands, counters of frames that no slave has had yet.
struct Seen {
  std::uint64_t frames = 0, replies = 0;
  std::map<int, int> commands;    // by code, of every datagram
  std::vector<int> counters;      // of every datagram
  std::vector<int> process_data;  // counters of the logical datagrams that came back
  std::vector<std::string> wrong;
  int wrong_sent = 0;  // of these
};

inline std::string look_at_datagrams(std::span<const std::uint8_t> f, std::size_t end, bool back,
                                     Seen& s) {
  std::size_t at = 16;
  for (bool more = true; more;) {
    if (at + 12 > end) return "a datagram is cut";
    const int command = f[at];
    const unsigned word = ec::load_u16(f, at + 6);
    const std::size_t bytes = word & 0x07FFU;
    if ((word & 0x3800U) != 0) return "bits 11 to 13 of a length";
    if ((word & 0x4000U) != 0) return "a circulating frame";
    if (at + 12 + bytes > end) return "a datagram is cut";
    if (command > 14) return "unknown command " + std::to_string(command);
    const int counter = ec::load_u16(f, at + 10 + bytes);
    if (!back && counter != 0) return "a counter before the first slave";
    if (!back && ec::load_u16(f, at + 8) != 0) return "an event before the first slave";
    // Each slave that it passed has counted the position up and, of AL status, answers.
    if (back && command == 7 && ec::load_u16(f, at + 4) == 0x0130 &&
        ec::load_u16(f, at + 2) != counter)
      return "not every slave that was passed answers a broadcast";
    ++s.commands[command];
    s.counters.push_back(counter);
    if (back && command >= 10 && command <= 12) s.process_data.push_back(counter);
    more = (word & 0x8000U) != 0;
    at += 12 + bytes;
  }
  return at == end ? "" : "bytes behind the last datagram";
}

inline std::string look_at_frame(std::span<const std::uint8_t> f, bool back, Seen& s) {
  if (f.size() < 16 || f.size() > 1514) return "length of the frame";
  const unsigned head = ec::load_u16(f, 14);
  if (f[12] != 0x88 || f[13] != 0xA4 || head >> 12U != 1) return "type";
  if ((head & 0x0800U) != 0) return "bit 11 of the EtherCAT head";
  const std::size_t end = 16 + (head & 0x07FFU);
  if (end == 16 || end > f.size()) return "EtherCAT length";
  for (std::size_t i = end; i < f.size(); ++i)
    if (f[i] != 0 || f.size() > 60) return "what is behind the datagrams";
  return look_at_datagrams(f, end, back, s);
}

inline Seen read_back(const std::string& file) {
  std::ifstream in(file, std::ios::binary);
  const std::vector<char> bytes((std::istreambuf_iterator<char>(in)), {});
  const std::vector<std::uint8_t> all(bytes.begin(), bytes.end());
  Seen s;
  for (std::size_t at = 24; at + 16 <= all.size();) {
    const std::size_t n = ec::load_u32(all, at + 8);
    const auto frame = std::span(all).subspan(at + 16, n);
    const bool back = n > 6 && (frame[6] & 2U) != 0;  // the first slave has marked it
    if (const std::string why = look_at_frame(frame, back, s); !why.empty()) {
      s.wrong.push_back("frame " + std::to_string(s.frames + 1) + ": " + why);
      s.wrong_sent += back ? 0 : 1;
    }
    ++s.frames;
    s.replies += back ? 1 : 0;
    at += 16 + n;
  }
  return s;
}

inline bool tshark_is_there() { return !output_of("tshark --version").empty(); }

inline constexpr const char* kNoTshark =
    "tshark is not installed (Debian package tshark): frames only read by this test's own reader";
inline constexpr const char* kMalformed = "-Y '_ws.malformed || (eth.type == 0x88a4 && !ecat)'";

inline void add_numbers(const std::string& list, std::vector<int>& to) {
  std::istringstream fields(list);
  for (std::string f; std::getline(fields, f, ',');)
    to.push_back(static_cast<int>(std::stoul(f, nullptr, 0)));
}

// What tshark says of the file against what the test's own reader says.
inline void tshark_agrees(const std::string& file, const Seen& s) {
  const std::string base = "tshark -r " + file + " --disable-protocol ecat_mailbox ";
  EXPECT_EQ(output_of(base + kMalformed), "");
  std::istringstream lines(output_of(
      base + "-T fields -E separator=/t -E occurrence=a -E aggregator=, -e ecat.cmd -e ecat.cnt"));
  std::vector<int> commands, counters;
  std::uint64_t frames = 0;
  for (std::string line; std::getline(lines, line); ++frames) {
    const auto tab = line.find('\t');
    add_numbers(line.substr(0, tab), commands);
    add_numbers(line.substr(std::min(tab, line.size() - 1) + 1), counters);
  }
  std::map<int, int> seen;
  for (const int c : commands) ++seen[c];
  EXPECT_EQ(frames, s.frames);
  EXPECT_EQ(seen, s.commands);
  EXPECT_EQ(counters, s.counters);
}

// The counters that the replies to the last cycles have to have had.
inline void counters_are(const Seen& s, const std::vector<int>& expected) {
  ASSERT_GE(s.process_data.size(), expected.size());
  EXPECT_EQ(std::vector<int>(s.process_data.end() - static_cast<std::ptrdiff_t>(expected.size()),
                             s.process_data.end()),
            expected);
}

}  // namespace tests
