#include "tools/console/public_address.hpp"

#include <algorithm>
#include <charconv>

namespace teletact {

namespace {

constexpr std::size_t kMostBytes = 200;

bool all_of(std::string_view text, std::string_view more) {
  return std::all_of(text.begin(), text.end(), [&](char c) {
    return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || more.find(c) != more.npos;
  });
}

// 0: none that is allowed.
int port_of(std::string_view digits) {
  int port = 0;
  const auto [end, failed] = std::from_chars(digits.data(), digits.data() + digits.size(), port);
  const bool whole = failed == std::errc() && end == digits.data() + digits.size();
  return whole && port >= 1 && port <= 65535 ? port : 0;
}

bool good_path(std::string_view path) {
  if (path.find("//") != path.npos || path.find("/.") != path.npos) return false;
  return all_of(ascii_lower(path), "/._-~@:");
}

bool good_name(std::string_view name) {
  if (name.empty()) return false;
  if (name.front() != '[') return all_of(name, ".-") && name.front() != '.' && name.front() != '-';
  return name.size() > 3 && name.back() == ']' && all_of(name.substr(1, name.size() - 2), ":.");
}

bool own(std::string_view name) {
  return name == "localhost" || name == "127.0.0.1" || name == "[::1]";
}

}  // namespace

std::string ascii_lower(std::string_view text) {
  std::string out(text);
  for (char& c : out)
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  return out;
}

rt::Result<PublicAddress> PublicAddress::parse(std::string_view url) {
  std::string told(url.substr(0, kMostBytes));  // on one line
  std::replace_if(
      told.begin(), told.end(), [](char c) { return c < ' ' || c > '~'; }, '?');
  const rt::Error bad{"console public address '" + told +
                      "': allowed https://NAME[:PORT]/[PATH/], and http:// with localhost"};
  PublicAddress a;
  const std::size_t colon = url.find("://");
  if (url.size() > kMostBytes || colon == url.npos) return bad;
  const std::string scheme = ascii_lower(url.substr(0, colon));
  a.secure = scheme == "https";
  if (!a.secure && scheme != "http") return bad;
  const std::string_view rest = url.substr(colon + 3);
  const std::size_t slash = std::min(rest.find('/'), rest.size());
  const std::string place = ascii_lower(rest.substr(0, slash));
  a.path = rest.substr(slash);
  if (a.path.empty() || a.path.back() != '/') a.path += '/';
  const std::size_t end = place.find(':', place.empty() || place[0] != '[' ? 0 : place.find(']'));
  const std::string name = place.substr(0, end);
  const int usual = a.secure ? 443 : 80;
  const int port = end == place.npos ? usual : port_of(std::string_view(place).substr(end + 1));
  if (!good_name(name) || port == 0 || !good_path(a.path) || (!a.secure && !own(name))) return bad;
  a.host = port == usual ? name : name + ":" + std::to_string(port);
  a.origin = scheme + "://" + a.host;
  return a;
}

}  // namespace teletact
