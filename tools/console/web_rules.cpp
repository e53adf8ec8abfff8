#include "tools/console/web_rules.hpp"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <utility>

namespace teletact {

namespace {

constexpr std::size_t kMostSegments = 8, kMostSegment = 64;

int hex_digit(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  if (c >= 'A' && c <= 'F') return c - 'A' + 10;
  return -1;
}

// False: a '%' that stands for nothing.
bool decode_percent(std::string_view text, std::string& out) {
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] != '%') {
      out += text[i];
      continue;
    }
    if (i + 2 >= text.size()) return false;
    const int high = hex_digit(text[i + 1]), low = hex_digit(text[i + 2]);
    if (high < 0 || low < 0) return false;
    out += static_cast<char>(16 * high + low);
    i += 2;
  }
  return true;
}

bool good_segment(std::string_view s) {
  if (s.empty() || s.size() > kMostSegment || s.front() == '.') return false;
  return std::all_of(s.begin(), s.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '.' ||
           c == '_' || c == '-';
  });
}

}  // namespace

WebNames::WebNames(const std::vector<std::string>& names, int port, bool tls,
                   std::optional<PublicAddress> known)
    : scheme_(tls ? "https://" : "http://"), public_(std::move(known)) {
  for (const std::string& name : names) {
    const bool six = name.find(':') != std::string::npos && name.front() != '[';
    const std::string host = ascii_lower(six ? "[" + name + "]" : name);
    hosts_.push_back(host + ":" + std::to_string(port));
    if (port == (tls ? 443 : 80)) hosts_.push_back(host);  // browsers leave it out
  }
}

bool WebNames::own_host(std::string_view host) const {
  return std::find(hosts_.begin(), hosts_.end(), ascii_lower(host)) != hosts_.end();
}

bool WebNames::good_host(std::string_view host) const {
  return own_host(host) || (public_ && ascii_lower(host) == public_->host);
}

bool WebNames::is_public(std::string_view origin) const {
  return public_ && ascii_lower(origin) == public_->origin;
}

bool WebNames::good_origin(std::string_view origin, std::string_view host) const {
  if (own_host(host) && ascii_lower(origin) == scheme_ + ascii_lower(host)) return true;
  return good_host(host) && is_public(origin);
}

std::string_view WebNames::inside(std::string_view target) const {
  if (public_ && target.substr(0, public_->path.size()) == public_->path)
    target.remove_prefix(public_->path.size() - 1);
  return target;
}

std::vector<std::string> page_path(std::string_view target) {
  target = target.substr(0, target.find_first_of("?#"));
  std::string path;
  if (target.empty() || target.front() != '/' || !decode_percent(target.substr(1), path)) return {};
  if (path.empty()) return {"index.html"};
  std::vector<std::string> segments;
  for (std::size_t at = 0; at <= path.size();) {
    const std::size_t end = std::min(path.find('/', at), path.size());
    segments.push_back(path.substr(at, end - at));
    if (!good_segment(segments.back()) || segments.size() > kMostSegments) return {};
    at = end + 1;
  }
  return segments;
}

std::string_view content_type(std::string_view name) {
  static constexpr std::pair<std::string_view, std::string_view> kTypes[] = {
      {"html", "text/html; charset=utf-8"},
      {"js", "text/javascript; charset=utf-8"},
      {"mjs", "text/javascript; charset=utf-8"},
      {"css", "text/css; charset=utf-8"},
      {"json", "application/json"},
      {"map", "application/json"},
      {"webmanifest", "application/manifest+json"},
      {"txt", "text/plain; charset=utf-8"},
      {"svg", "image/svg+xml"},
      {"png", "image/png"},
      {"jpg", "image/jpeg"},
      {"webp", "image/webp"},
      {"ico", "image/x-icon"},
      {"woff2", "font/woff2"},
      {"wasm", "application/wasm"},
      {"glb", "model/gltf-binary"}};
  const std::size_t dot = name.rfind('.');
  if (dot != std::string_view::npos) {
    const std::string ending = ascii_lower(name.substr(dot + 1));
    for (const auto& [known, type] : kTypes)
      if (ending == known) return type;
  }
  return "application/octet-stream";
}

std::string_view cookie_value(std::string_view header, std::string_view name) {
  std::string_view found;
  while (!header.empty()) {
    std::string_view pair = header.substr(0, header.find(';'));
    header.remove_prefix(std::min(header.size(), pair.size() + 1));
    while (!pair.empty() && pair.front() == ' ') pair.remove_prefix(1);
    const std::size_t equals = pair.find('=');
    if (equals == std::string_view::npos || pair.substr(0, equals) != name) continue;
    const std::string_view value = pair.substr(equals + 1);
    if (!found.empty() && found != value) return {};
    found = value;
  }
  return found;
}

std::optional<std::string> code_of(std::string_view body) {
  const auto json = nlohmann::json::parse(body, nullptr, false);
  if (!json.is_object() || json.size() != 1 || !json.contains("code") || !json["code"].is_string())
    return {};
  auto code = json["code"].get<std::string>();
  const bool hex = code.size() == 32 && code.find_first_not_of("0123456789abcdef") == code.npos;
  if (!hex) return {};
  return code;
}

}  // namespace teletact
