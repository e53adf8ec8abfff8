// Frames on a road's connection, inside TLS: an 8-byte header, then the body; little-endian.
//
//   u16 magic "RD"   u8 version   u8 kind   u32 length of the body
//
//   greet    who dials, first: u8 connection (0 control, 1 bulk), 16 bytes token (control: zeros)
//   welcome  who listens, its answer: 16 bytes token, that binds the bulk connection to this
//            session
//   refusal  who listens, instead: 1 to 200 printable ASCII characters, then the connection is
//            closed
//   message  then, both ways: one message of the link (drivers/link/wire.hpp)
//
// A length is held against the cap of its kind before anything is stored, and no message is allowed
// before allow_messages(): who is not let in can make the reader keep 209 bytes at most.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace drivers {

inline constexpr std::uint8_t kRoadVersion = 1;
inline constexpr std::size_t kRoadHeader = 8, kRoadTokenBytes = 16, kRoadMaxRefusal = 200;

enum class RoadKind : std::uint8_t { kGreet = 1, kWelcome, kRefusal, kMessage };
enum class RoadConnectionKind : std::uint8_t { kControl, kBulk };
using RoadToken = std::array<std::uint8_t, kRoadTokenBytes>;

struct RoadGreet {
  RoadConnectionKind connection = RoadConnectionKind::kControl;
  RoadToken token{};
};

enum class RoadFrameStatus : std::uint8_t {
  kOk,
  kBadMagic,
  kBadVersion,
  kBadKind,
  kEmpty,    // no frame is without a body
  kTooLong,  // longer than its kind may be, or a message before any is allowed
  kStopped,  // the taker said so
};
[[nodiscard]] const char* to_text(RoadFrameStatus s) noexcept;

// Appends the header of a frame, or a whole one, to `out`.
void append_road_header(RoadKind kind, std::size_t length, std::vector<std::uint8_t>& out);
void append_road_frame(RoadKind kind, std::span<const std::uint8_t> body,
                       std::vector<std::uint8_t>& out);
void append_greet(const RoadGreet& greet, std::vector<std::uint8_t>& out);
void append_refusal(std::string_view text, std::vector<std::uint8_t>& out);  // made printable, cut

// Bodies; false: not one.
[[nodiscard]] bool read_greet(std::span<const std::uint8_t> body, RoadGreet& out) noexcept;
[[nodiscard]] bool read_welcome(std::span<const std::uint8_t> body, RoadToken& out) noexcept;
[[nodiscard]] bool read_refusal(std::span<const std::uint8_t> body, std::string& out);

// Cuts a stream into frames. After any status but kOk it must not be fed again.
class RoadFrameReader {
 public:
  // One whole frame; the body lies there until it returns. False: stop.
  using Take = std::function<bool(RoadKind kind, std::span<const std::uint8_t> body)>;

  // Of the longest message from now on; may be called by the taker.
  void allow_messages(std::size_t cap) noexcept { message_cap_ = cap; }
  [[nodiscard]] RoadFrameStatus feed(std::span<const std::uint8_t> bytes, const Take& take);
  // Bytes of a frame that is not whole yet.
  [[nodiscard]] std::size_t held() const noexcept { return held_.size(); }

 private:
  [[nodiscard]] RoadFrameStatus look(std::span<const std::uint8_t> header) noexcept;

  std::size_t message_cap_ = 0;
  RoadKind kind_ = RoadKind::kGreet;
  std::size_t length_ = 0;
  std::vector<std::uint8_t> held_;
};

}  // namespace drivers
