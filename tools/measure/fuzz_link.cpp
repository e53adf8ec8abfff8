// The reader of what the boxes say to each other, in a stream of bytes (drivers/link): the headers
// that cut it into messages, and every body. Held, or it is an exception and so a fault: a piece of
// the stream is kept only while it may still become a message below its cap, and what is taken
// encodes again to the same bytes.
#include <algorithm>
#include <cstring>
#include <memory>
#include <stdexcept>

#include "drivers/link/frame_codec.hpp"
#include "drivers/link/stream_reader.hpp"
#include "drivers/link/wire.hpp"
#include "rt/hash.hpp"
#include "tools/measure/fuzz_readers.hpp"

namespace teletact {
namespace {

using drivers::kHeaderSize;
using drivers::MessageId;
using drivers::WireStatus;
using Bytes = std::vector<std::uint8_t>;
using View = std::span<const std::uint8_t>;

constexpr int kWidth = 32, kHeight = 24;
// In a header: the id and the length. In a frame's body: sizes, and the check at the header's end.
constexpr std::size_t kIdAt = 6, kLengthAt = 8, kFrameCheckAt = drivers::kWireHeader - 8;

void hold(bool holds, const char* what) {
  if (!holds) throw std::logic_error(what);
}

struct Held {
  std::unique_ptr<drivers::EncodedFrame> frame = std::make_unique<drivers::EncodedFrame>();
  Bytes again = Bytes(kHeaderSize + drivers::kMaxBody);  // what was taken, encoded
  void same(std::size_t n, View as) const {
    hold(n == as.size() && std::equal(as.begin(), as.end(), again.begin()),
         "what was taken encodes to other bytes");
  }
};

template <class M>
bool take_as(View body, Held& held) {
  M m;
  if (!decode(body, m)) return false;
  held.same(encode(m, held.again), body);
  return true;
}

bool take_body(MessageId id, View body, Held& held) {
  switch (id) {
    case MessageId::kHello:
    case MessageId::kBye:
    case MessageId::kAlive:
      return body.empty();
    case MessageId::kClockRequest:
      return take_as<drivers::ClockRequest>(body, held);
    case MessageId::kClockReply:
      return take_as<drivers::ClockReply>(body, held);
    case MessageId::kRobotState:
      return take_as<drivers::RobotState>(body, held);
    case MessageId::kRobotGoal:
      return take_as<drivers::RobotGoal>(body, held);
    case MessageId::kFrameReport:
      return take_as<drivers::FrameReport>(body, held);
    case MessageId::kCommandReport:
      return take_as<drivers::CommandReport>(body, held);
    case MessageId::kFrame:
      if (read_wire(body, *held.frame) != drivers::FrameStatus::kOk) return false;
      held.same(write_wire(*held.frame, held.again, held.frame->spared), body);
      return true;
  }
  throw std::logic_error("a message of no kind was let through");
}

// Empty, or what is wrong with it.
std::string take_message(View message, Held& held) {
  drivers::Header h;
  hold(read_header(message, h) == WireStatus::kOk && message.size() == kHeaderSize + h.length,
       "what was cut out is no message");
  const View body = message.subspan(kHeaderSize);
  hold(body.size() <= (h.id == MessageId::kFrame ? drivers::kMaxBody : drivers::kMaxControlBody),
       "a message beyond its cap");
  if (drivers::crc32c(body) != h.crc) return to_text(WireStatus::kBadCrc);
  if (!take_body(h.id, body, held)) return "a body that is none";
  held.same(write_message(h, body, held.again), message);
  return {};
}

// As it comes from a socket, in pieces whose sizes differ.
rt::Result<bool> read_messages(const std::string& stream, Held& held) {
  drivers::StreamReader reader;
  std::string problem;
  std::size_t taken = 0, fed = 0;
  const auto take = [&](View message) {
    taken += message.size();
    problem = take_message(message, held);
    return problem.empty();
  };
  const View all(reinterpret_cast<const std::uint8_t*>(stream.data()), stream.size());
  for (std::size_t piece = 1; fed < all.size();) {
    piece = std::min(1 + (7 * piece + 3) % 311, all.size() - fed);
    const WireStatus status = reader.feed(all.subspan(fed, piece), take);
    fed += piece;
    if (status != WireStatus::kOk) return rt::Error{to_text(status)};
    if (reader.stopped()) return rt::Error{problem};
    const View rest = all.subspan(taken, fed - taken);
    hold(reader.held() == rest.size(), "more is kept than what is no message yet");
    drivers::Header h;
    const WireStatus begun = read_header(rest, h);
    hold(begun == WireStatus::kIncomplete ||
             (begun == WireStatus::kOk && rest.size() < kHeaderSize + h.length),
         "what can be no message is kept");
  }
  if (reader.held() > 0) return rt::Error{"ends within a message"};
  return true;
}

template <class T>
T number_at(const std::string& b, std::size_t at) {
  T v{};
  std::memcpy(&v, b.data() + at, sizeof v);
  return v;
}

// The checks of every message, as far as the lengths lead.
void seal_messages(std::string& b) {
  for (std::size_t at = 0; at + kHeaderSize <= b.size();) {
    const std::size_t length = number_at<std::uint32_t>(b, at + kLengthAt);
    if (length > b.size() - at - kHeaderSize) return;
    char* const body = b.data() + at + kHeaderSize;
    if (number_at<std::uint16_t>(b, at + kIdAt) == static_cast<std::uint16_t>(MessageId::kFrame) &&
        length >= drivers::kWireHeader) {
      rt::Hash64 hash;
      hash.bytes(body, kFrameCheckAt);
      hash.bytes(body + drivers::kWireHeader, length - drivers::kWireHeader);
      const std::uint64_t check = hash.digest();
      std::memcpy(body + kFrameCheckAt, &check, sizeof check);
    }
    drivers::Header h;
    const View header(reinterpret_cast<const std::uint8_t*>(b.data() + at), kHeaderSize);
    if (read_header(header, h) != WireStatus::kOk) return;
    h.crc = drivers::crc32c({reinterpret_cast<const std::uint8_t*>(body), length});
    std::array<std::uint8_t, kHeaderSize> sealed{};
    write_header(h, sealed);
    std::memcpy(b.data() + at, sealed.data(), sealed.size());
    at += kHeaderSize + length;
  }
}

std::string message_of(MessageId id, View body) {
  drivers::Header h;
  h.id = id;
  h.seq = 7;
  h.stamp_ns = 1'234'567'890;
  if (id == MessageId::kHello) h.schema = drivers::schema_hash("moving");
  Bytes out(kHeaderSize + body.size());
  out.resize(write_message(h, body, out));
  return {out.begin(), out.end()};
}

template <class M>
std::string message_of(MessageId id, const M& m) {
  std::array<std::uint8_t, drivers::kMaxControlBody> body{};
  return message_of(id, View(body).first(encode(m, body)));
}

// A picture as a robot sends it: depth, colour where it has some, joints where it has an arm.
std::string frame_message(bool whole, Held& held) {
  rt::Startup startup;
  drivers::FrameCodecScratch scratch(startup.token(), {});
  const auto picture = std::make_unique<perception::RgbdFrame>();
  picture->exposure = rt::time_from_ns(2'000'000'000);
  picture->seq = 11;
  picture->intrinsics = {30, 31, 15.5, 11.5, kWidth, kHeight};
  picture->has_colour = whole;
  for (std::size_t i = 0; i < std::size_t{kWidth} * kHeight; ++i) {
    picture->depth_mm[i] = static_cast<std::uint16_t>(i % 7 == 0 ? 0 : 900 + 3 * (i / kWidth));
    picture->colour[i] = {static_cast<std::uint8_t>(i), 90, 30};
  }
  if (whole) {
    picture->joints.count = 5;
    picture->joints.error = 0.01F;
    picture->joints.position.fill(0.3F);
  }
  if (encode(*picture, rt::Box::kRobot, whole, scratch, *held.frame) != drivers::FrameStatus::kOk)
    throw std::runtime_error("a picture could not be encoded");
  Bytes body(wire_size(*held.frame));
  const drivers::Spared spared =
      whole ? drivers::Spared{2, drivers::Spared::Why::kLate} : drivers::Spared{};
  body.resize(write_wire(*held.frame, body, spared));
  return message_of(MessageId::kFrame, View(body));
}

}  // namespace

void FuzzReaders::add_link() {
  const auto held = std::make_shared<Held>();
  const std::string hello = message_of(MessageId::kHello, View()),
                    alive = message_of(MessageId::kAlive, View()),
                    bye = message_of(MessageId::kBye, View());
  drivers::RobotState state;
  state.seq = 5, state.taken = rt::time_from_ns(3'000'000), state.x_m = 1.5, state.yaw_rad = -0.2;
  state.vx = 0.3, state.goal_seq = 4, state.mode = 2, state.moving = 1, state.pauses = 1;
  drivers::RobotGoal goal;
  goal.seq = 6, goal.made = rt::time_from_ns(4'000'000), goal.x_m = 2, goal.engaged = 1;
  goal.valid_until = rt::time_from_ns(404'000'000), goal.speed_limit_m_per_s = 0.5;
  const std::string of_state = message_of(MessageId::kRobotState, state),
                    of_goal = message_of(MessageId::kRobotGoal, goal),
                    asked = message_of(MessageId::kClockRequest, drivers::ClockRequest{1000}),
                    answered = message_of(MessageId::kClockReply, drivers::ClockReply{1000, 7, 9}),
                    seen = message_of(MessageId::kFrameReport, drivers::FrameReport{12, 1}),
                    refused = message_of(MessageId::kCommandReport,
                                         drivers::CommandReport{1, 2, 3, 4, 5, 5}),
                    small = frame_message(false, *held), whole = frame_message(true, *held);
  // Each alone, and the two directions of a road.
  readers_.push_back({"link_messages",
                      {of_state, of_goal, asked, answered, seen, refused, small, whole,
                       hello + asked + of_goal + alive + seen + answered + of_goal + bye,
                       hello + answered + of_state + small + alive + of_state + refused + whole},
                      [held](const std::string& b) { return read_messages(b, *held); },
                      seal_messages,
                      false});
}

}  // namespace teletact
