// What goes from the box to the page, and who sits there. docs/console_protocol.md is the contract.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

namespace teletact {

enum class ViewKind : std::uint8_t {
  kText = 1,
  kPose,
  kMesh,
  kPicture,
  kCostMap,
  kMoving,
  kAnswer,
  kSelection
};
inline constexpr std::size_t kViewKinds = 9;  // by number; 0 is none

// Large, and made again and again: held back from a page that has not said of the last ones that it
// has seen them.
[[nodiscard]] constexpr bool is_bulk(ViewKind kind) noexcept {
  return kind == ViewKind::kMesh || kind == ViewKind::kPicture || kind == ViewKind::kCostMap ||
         kind == ViewKind::kMoving;
}

// Bytes of the longest body of each kind. A longer one is refused where it is published.
inline constexpr std::array<std::size_t, kViewKinds> kMostViewBytes = {
    0, 65536, 1024, 0, std::size_t{2} << 20U, std::size_t{1} << 20U, 262144, 65536, 262144};

// The head of a view; kind, version and sequence are filled in by the server.
struct ViewStamp {
  double time_s = 0;   // box clock since the epoch of the run, when made
  double data_s = -1;  // same clock: the oldest datum in it; below 0: none
  std::uint16_t flags = 0;
};
inline constexpr std::size_t kViewHeadBytes = 24;

enum class ConsoleRole : std::uint8_t { kViewer, kOperator };
[[nodiscard]] constexpr std::string_view role_text(ConsoleRole role) noexcept {
  return role == ConsoleRole::kOperator ? "operator" : "viewer";
}

// A session as others see it. Its number is never given to another one in this process.
struct ConsolePerson {
  std::uint32_t session = 0;  // 0: nobody
  std::string name;           // of its client certificate, else "operator 1", "viewer 2"
  ConsoleRole role = ConsoleRole::kViewer;
  bool view_only = false;  // came by a view link: operates only where the operator hands over
  bool connected = false;  // its WebSocket stands
};

struct RoleEvent {
  enum class Kind : std::uint8_t {
    kJoined,   // its WebSocket stands
    kLeft,     // and no more: what it held is to end now
    kAsked,    // asks for the operator's role
    kOperator  // is the operator from now on; `other` was before (session 0: nobody)
  };
  Kind kind = Kind::kJoined;
  ConsolePerson person, other;
};

}  // namespace teletact
