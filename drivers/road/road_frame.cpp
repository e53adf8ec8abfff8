#include "drivers/road/road_frame.hpp"

#include <algorithm>

namespace drivers {

namespace {

constexpr std::uint8_t kMagic[2] = {'R', 'D'};
constexpr std::size_t kGreetBytes = 1 + kRoadTokenBytes;

bool printable(std::uint8_t c) noexcept { return c >= 0x20 && c < 0x7f; }

}  // namespace

const char* to_text(RoadFrameStatus s) noexcept {
  switch (s) {
    case RoadFrameStatus::kOk:
      return "ok";
    case RoadFrameStatus::kBadMagic:
      return "no frame begins here";
    case RoadFrameStatus::kBadVersion:
      return "a frame of another version: install the same teletact on both boxes";
    case RoadFrameStatus::kBadKind:
      return "a frame of an unknown kind";
    case RoadFrameStatus::kEmpty:
      return "a frame without a body";
    case RoadFrameStatus::kTooLong:
      return "a frame longer than its kind may be";
    case RoadFrameStatus::kStopped:
      break;
  }
  return "stopped";
}

void append_road_header(RoadKind kind, std::size_t length, std::vector<std::uint8_t>& out) {
  out.insert(out.end(), {kMagic[0], kMagic[1], kRoadVersion, static_cast<std::uint8_t>(kind)});
  for (unsigned i = 0; i < 4; ++i) out.push_back(static_cast<std::uint8_t>(length >> (8 * i)));
}

void append_road_frame(RoadKind kind, std::span<const std::uint8_t> body,
                       std::vector<std::uint8_t>& out) {
  append_road_header(kind, body.size(), out);
  out.insert(out.end(), body.begin(), body.end());
}

void append_greet(const RoadGreet& greet, std::vector<std::uint8_t>& out) {
  append_road_header(RoadKind::kGreet, kGreetBytes, out);
  out.push_back(static_cast<std::uint8_t>(greet.connection));
  out.insert(out.end(), greet.token.begin(), greet.token.end());
}

void append_refusal(std::string_view text, std::vector<std::uint8_t>& out) {
  const std::string_view cut = text.empty() ? "refused" : text.substr(0, kRoadMaxRefusal);
  append_road_header(RoadKind::kRefusal, cut.size(), out);
  for (const char c : cut) {
    const auto byte = static_cast<std::uint8_t>(c);
    out.push_back(printable(byte) ? byte : std::uint8_t{'?'});
  }
}

bool read_greet(std::span<const std::uint8_t> body, RoadGreet& out) noexcept {
  if (body.size() != kGreetBytes || body[0] > 1) return false;
  out.connection = static_cast<RoadConnectionKind>(body[0]);
  std::copy(body.begin() + 1, body.end(), out.token.begin());
  return true;
}

bool read_welcome(std::span<const std::uint8_t> body, RoadToken& out) noexcept {
  if (body.size() != out.size()) return false;
  std::copy(body.begin(), body.end(), out.begin());
  return true;
}

bool read_refusal(std::span<const std::uint8_t> body, std::string& out) {
  if (body.empty() || body.size() > kRoadMaxRefusal) return false;
  if (!std::all_of(body.begin(), body.end(), printable)) return false;
  out.assign(body.begin(), body.end());
  return true;
}

// The header says what follows, and whether that may be.
RoadFrameStatus RoadFrameReader::look(std::span<const std::uint8_t> header) noexcept {
  if (header[0] != kMagic[0] || header[1] != kMagic[1]) return RoadFrameStatus::kBadMagic;
  if (header[2] != kRoadVersion) return RoadFrameStatus::kBadVersion;
  length_ = 0;
  for (unsigned i = 0; i < 4; ++i) length_ |= std::size_t{header[4 + i]} << (8 * i);
  std::size_t cap = 0;
  kind_ = static_cast<RoadKind>(header[3]);
  switch (kind_) {
    case RoadKind::kGreet:
      cap = kGreetBytes;
      break;
    case RoadKind::kWelcome:
      cap = kRoadTokenBytes;
      break;
    case RoadKind::kRefusal:
      cap = kRoadMaxRefusal;
      break;
    case RoadKind::kMessage:
      cap = message_cap_;
      break;
    default:
      return RoadFrameStatus::kBadKind;
  }
  if (length_ > cap || (kind_ == RoadKind::kMessage && cap == 0)) return RoadFrameStatus::kTooLong;
  return length_ == 0 ? RoadFrameStatus::kEmpty : RoadFrameStatus::kOk;
}

RoadFrameStatus RoadFrameReader::feed(std::span<const std::uint8_t> bytes, const Take& take) {
  while (!bytes.empty()) {
    if (held_.size() < kRoadHeader) {
      const auto part = bytes.first(std::min(bytes.size(), kRoadHeader - held_.size()));
      held_.insert(held_.end(), part.begin(), part.end());
      bytes = bytes.subspan(part.size());
      if (held_.size() < kRoadHeader) return RoadFrameStatus::kOk;
      if (const auto status = look(held_); status != RoadFrameStatus::kOk) return status;
    }
    const std::size_t missing = kRoadHeader + length_ - held_.size();
    if (held_.size() == kRoadHeader && bytes.size() >= missing) {
      // The whole body is here: no copy.
      held_.clear();
      if (!take(kind_, bytes.first(missing))) return RoadFrameStatus::kStopped;
      bytes = bytes.subspan(missing);
      continue;
    }
    const auto part = bytes.first(std::min(bytes.size(), missing));
    held_.insert(held_.end(), part.begin(), part.end());
    bytes = bytes.subspan(part.size());
    if (part.size() < missing) return RoadFrameStatus::kOk;
    const bool more = take(kind_, std::span<const std::uint8_t>(held_).subspan(kRoadHeader));
    held_.clear();
    if (!more) return RoadFrameStatus::kStopped;
  }
  return RoadFrameStatus::kOk;
}

}  // namespace drivers
