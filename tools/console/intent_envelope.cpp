#include "tools/console/intent_envelope.hpp"

#include <algorithm>
#include <utility>
#include <vector>

namespace teletact {

namespace {

constexpr int kMostDepth = 6;
constexpr std::int64_t kMostId = (std::int64_t{1} << 53) - 1;

// Before the parser sees it: brackets outside of strings.
bool too_deep(std::string_view text) {
  int depth = 0;
  bool in_string = false;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    if (in_string) {
      if (c == '\\') {
        ++i;
      } else if (c == '"') {
        in_string = false;
      }
      continue;
    }
    if (c == '"') in_string = true;
    if (c == '{' || c == '[') ++depth;
    if (c == '}' || c == ']') --depth;
    if (depth > kMostDepth) return true;
  }
  return false;
}

bool good_act(const std::string& act) {
  if (act.empty() || act.size() > 24) return false;
  return std::all_of(act.begin(), act.end(),
                     [](char c) { return (c >= 'a' && c <= 'z') || c == '_'; });
}

}  // namespace

rt::Result<IntentEnvelope> read_envelope(std::string_view text) {
  if (text.size() > kMostIntentBytes) return rt::Error{"intent: longer than 4096 bytes"};
  if (too_deep(text)) return rt::Error{"intent: nested too deep"};
  std::vector<std::string> keys;
  bool twice = false;
  const auto watch = [&](int depth, nlohmann::json::parse_event_t event, nlohmann::json& value) {
    if (event != nlohmann::json::parse_event_t::key || depth != 1) return true;
    auto key = value.get<std::string>();
    twice = twice || std::find(keys.begin(), keys.end(), key) != keys.end();
    keys.push_back(std::move(key));
    return true;
  };
  IntentEnvelope e;
  e.intent = nlohmann::json::parse(text, watch, false);
  if (e.intent.is_discarded()) return rt::Error{"intent: not JSON"};
  if (!e.intent.is_object()) return rt::Error{"intent: not an object"};
  if (twice) return rt::Error{"intent: a key stands in it twice"};
  const auto id = e.intent.find("id"), act = e.intent.find("act");
  if (id == e.intent.end() || !id->is_number_integer() || *id < 0 || *id > kMostId)
    return rt::Error{"intent: id: a whole number from 0 is wanted"};
  if (act == e.intent.end() || !act->is_string()) return rt::Error{"intent: act: a word is wanted"};
  e.id = id->get<std::int64_t>();
  e.act = act->get<std::string>();
  if (!good_act(e.act)) return rt::Error{"intent: act: 1 to 24 letters a to z and '_' are wanted"};
  return e;
}

}  // namespace teletact
