// The readers of what a page, or whoever poses as one, sends to the console's server: the envelope
// of an intent, the body that brings a code, the path of a file, the cookie; and the public address
// that a person states.
#include <stdexcept>

#include "tools/console/intent_envelope.hpp"
#include "tools/console/web_rules.hpp"
#include "tools/measure/fuzz_readers.hpp"

namespace teletact {
namespace {

rt::Result<bool> read_intent(const std::string& text) {
  const auto e = read_envelope(text);
  if (!e) return rt::Error{e.error()};
  const IntentEnvelope& v = e.value();
  // What the envelope promises, whatever came in.
  if (v.id < 0 || v.act.empty() || v.act.size() > 24 || !v.intent.is_object())
    throw std::logic_error("an envelope that breaks its promise");
  return true;
}

rt::Result<bool> read_path(const std::string& target) {
  const auto segments = page_path(target);
  for (const std::string& s : segments)
    if (s.empty() || s.front() == '.' || s.find_first_of(std::string("/\\%\0", 4)) != s.npos)
      throw std::logic_error("a segment that leads elsewhere");
  if (segments.empty()) return rt::Error{"no path of a page"};
  return !content_type(segments.back()).empty();
}

rt::Result<bool> read_public(const std::string& url) {
  const auto a = PublicAddress::parse(url);
  if (!a) return rt::Error{a.error()};
  // It goes into headers and a cookie.
  const std::string all = a.value().origin + a.value().path;
  if (a.value().path.front() != '/' || a.value().path.back() != '/' ||
      all.find_first_of(std::string(" ;,\r\n\0\"", 7)) != all.npos)
    throw std::logic_error("an address that breaks a header");
  return true;
}

}  // namespace

void FuzzReaders::add_console() {
  readers_.push_back(
      {"console_intent",
       {R"({"id":1,"act":"token","holds":["engage","drive"]})",
        R"({"id":20,"act":"hand","p":[0.1,-2e-3,1],"normal":[0,0,1],"press":true,"button":false})",
        R"({"id":300,"act":"draw","obstacle":{"id":4,"kind":"box","centre":[1,2],"half":[1]}})",
        R"({"id":4000,"act":"note","text":"a \"mark\" é \ud83d\ude00"})"},
       read_intent,
       {},
       false});
  readers_.push_back({"console_code",
                      {R"({"code":"00112233445566778899aabbccddeeff"})"},
                      [](const std::string& b) -> rt::Result<bool> {
                        const auto code = code_of(b);
                        if (!code) return rt::Error{"no code"};
                        return code->size() == 32;
                      },
                      {},
                      false});
  readers_.push_back(
      {"console_path", {"/", "/assets/index-1a2b3c.js?v=1", "/a/%62/c.css"}, read_path, {}, false});
  readers_.push_back({"console_public",
                      {"https://lab.example:8443/robots/rover/", "http://[::1]:9000"},
                      read_public,
                      {},
                      false});
  readers_.push_back({"console_cookie",
                      {"teletact_8080=00112233445566778899aabbccddeeff; theme=dark"},
                      [](const std::string& b) -> rt::Result<bool> {
                        if (cookie_value(b, "teletact_8080").empty()) return rt::Error{"no cookie"};
                        return true;
                      },
                      {},
                      false});
}

}  // namespace teletact
