// What a request from outside must look like. Pure: no socket, no clock.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "tools/console/public_address.hpp"

namespace teletact {

// By which names browsers may address this server, with the port: a page of a stranger whose name
// points at this machine (DNS rebinding) sends its own.
class WebNames {
 public:
  // `known`: where browsers find it through a tunnel or a proxy, besides.
  WebNames(const std::vector<std::string>& names, int port, bool tls,
           std::optional<PublicAddress> known = {});
  [[nodiscard]] bool good_host(std::string_view host) const;
  // The origin of `host` itself, or the public one, and no other; an empty one is none. A proxy
  // may send the name by which it reaches this server as `host`, browsers always their own origin.
  [[nodiscard]] bool good_origin(std::string_view origin, std::string_view host) const;
  [[nodiscard]] bool is_public(std::string_view origin) const;
  // The target of a request without the path of the public address, which a proxy may leave there.
  [[nodiscard]] std::string_view inside(std::string_view target) const;
  [[nodiscard]] const std::optional<PublicAddress>& known() const noexcept { return public_; }

 private:
  [[nodiscard]] bool own_host(std::string_view host) const;

  std::vector<std::string> hosts_;  // lower case, with the port where browsers send it
  std::string scheme_;
  std::optional<PublicAddress> public_;
};

// The segments of a request's path, decoded: of "/a/b.js?x" they are a, b.js; of "/", index.html.
// Empty: refused. A segment has 1 to 64 letters, digits, '.', '_', '-', and no '.' first; so there
// is
// no way up, no hidden file, no absolute path. At most 8 segments.
[[nodiscard]] std::vector<std::string> page_path(std::string_view target);
// Of a file's ending; "application/octet-stream" of one that is not known.
[[nodiscard]] std::string_view content_type(std::string_view name);
// The value of `name` in a Cookie header; empty: not there, or twice with different values.
[[nodiscard]] std::string_view cookie_value(std::string_view header, std::string_view name);
// The body of POST /session: {"code":"32 hex digits"}, nothing else.
[[nodiscard]] std::optional<std::string> code_of(std::string_view body);

// At most N within any second, by times that do not decrease.
template <std::size_t N>
class RateWindow {
 public:
  [[nodiscard]] bool take(std::int64_t now_ns) noexcept {
    if (count_ >= N && now_ns - times_[next_] < 1'000'000'000) return false;
    times_[next_] = now_ns;
    next_ = (next_ + 1) % N;
    if (count_ < N) ++count_;
    return true;
  }

 private:
  std::array<std::int64_t, N> times_{};
  std::size_t next_ = 0, count_ = 0;
};

}  // namespace teletact
