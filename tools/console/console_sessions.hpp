// Who may do what: one-time codes, sessions, and one operator at a time.
//
//   code      128 random bits, good once and for code_life. Of two sorts: the box's own makes a
// session
//             that may operate, a view link's one that may only look.
//   session   the secret of a cookie. Kept here are hashes alone, of codes too.
//   operator  the first session of the box's own code. Another becomes it when the operator hands
//             over (give), or takes it: where there is no operator, where it has been away for
//             absence_limit, or asked_limit after asking without an answer. View-only sessions can
//             be handed the role, and can not take it.
//
// Pure: time and random bytes are arguments. One thread.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "rt/time.hpp"
#include "tools/console/console_views.hpp"

namespace teletact {

using ConsoleSecret = std::array<std::uint8_t, 16>;
using SecretHash = std::array<std::uint8_t, 32>;
[[nodiscard]] std::string secret_text(const ConsoleSecret& secret);  // 32 hex digits

class ConsoleSessions {
 public:
  struct Limits {
    rt::Nanos code_life = std::chrono::hours{1}, session_life = std::chrono::hours{12};
    rt::Nanos absence = std::chrono::seconds{3}, asked = std::chrono::seconds{10};
  };
  static constexpr std::size_t kMostCodes = 4, kMostSessions = 32;
  // Whoever asked is forgotten then.
  static constexpr rt::Nanos kAskingLife = std::chrono::seconds{60};

  explicit ConsoleSessions(const Limits& limits) noexcept : limits_(limits) {}

  // From now on the code is good; of each sort the oldest one beyond kMostCodes is not any more.
  void add_code(const ConsoleSecret& code, bool view_only, std::int64_t now_ns);
  // The number of the new session, whose secret is `fresh`; 0: no such code (any more), or no room.
  // `before`: the session that this browser had, which the new one replaces. `name`: of the
  // browser's certificate, may be empty.
  [[nodiscard]] std::uint32_t exchange(std::string_view code, std::uint32_t before,
                                       const ConsoleSecret& fresh, const std::string& name,
                                       std::int64_t now_ns);
  // Of the secret that a cookie brings; 0: none.
  [[nodiscard]] std::uint32_t find(std::string_view secret, std::int64_t now_ns);
  void connected(std::uint32_t session, std::int64_t now_ns);
  void disconnected(std::uint32_t session, std::int64_t now_ns);
  void drop(std::uint32_t session, std::int64_t now_ns);

  // Each: empty, or why not, for a person.
  [[nodiscard]] std::string ask(std::uint32_t session, std::int64_t now_ns);
  [[nodiscard]] std::string give(std::uint32_t session, std::int64_t now_ns);
  [[nodiscard]] std::string take(std::uint32_t session, std::int64_t now_ns);

  [[nodiscard]] ConsolePerson person(std::uint32_t session) const;  // session 0: none such
  [[nodiscard]] std::vector<ConsolePerson> people() const;
  // What has happened since the last call.
  [[nodiscard]] std::vector<RoleEvent> take_events();

 private:
  struct Code {
    SecretHash hash;
    bool view_only;
    std::int64_t until_ns;
  };
  struct Session {
    SecretHash hash;
    ConsolePerson person;
    std::int64_t since_ns;  // connected or not
  };
  [[nodiscard]] Session* at(std::uint32_t session) noexcept;
  [[nodiscard]] const Session* at(std::uint32_t session) const noexcept;
  [[nodiscard]] Session* the_operator() noexcept;
  [[nodiscard]] bool away(const Session& s, std::int64_t now_ns) const noexcept;
  [[nodiscard]] bool make_room(std::int64_t now_ns);
  void make_operator(Session& s);
  void forget_old(std::int64_t now_ns);

  Limits limits_;
  std::vector<Code> codes_;
  std::vector<Session> sessions_;
  std::uint32_t last_ = 0, asker_ = 0;
  std::int64_t asked_ns_ = 0;
  std::vector<RoleEvent> events_;
};

}  // namespace teletact
