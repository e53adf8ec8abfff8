// What a console's server has seen since it started.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace teletact {

enum class Refusal : std::uint8_t {
  kHost,         // not a name of this server
  kOrigin,       // a page of another origin
  kPath,         // leads out of the page's folder, or is none
  kRequest,      // malformed, too long, a method or type that is not taken
  kLate,         // a request that did not come whole in time
  kCode,         // used, expired or made up
  kSession,      // no session, or an expired one
  kRole,         // the role may not do that
  kCrowded,      // too many connections or viewers
  kRate,         // too fast
  kEnvelope,     // an intent that is none
  kSlow,         // does not read
  kCertificate,  // TLS did not come about
  kCount
};
inline constexpr std::size_t kRefusals = static_cast<std::size_t>(Refusal::kCount);

struct ConsoleCounts {
  std::uint64_t views_sent = 0, views_replaced = 0, views_refused = 0;
  std::uint64_t bytes_sent = 0;
  std::uint64_t acts = 0, stops = 0;
  std::uint64_t connections = 0, sessions = 0, reconnects = 0;
  std::array<std::uint64_t, kRefusals> refused{};
  std::uint64_t mesh_blocks = 0, mesh_bytes = 0;  // kept now
  std::int64_t cpu_ns = 0;                        // of the server's thread
  [[nodiscard]] std::uint64_t of(Refusal r) const noexcept {
    return refused[static_cast<std::size_t>(r)];
  }
};

}  // namespace teletact
