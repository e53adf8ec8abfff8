// A well-formedness check for the SVG and HTML that the tools write: every element closed in order,
// attributes quoted, no stray markup characters. Returns an empty string, or what is wrong where.
#pragma once

#include <cctype>
#include <set>
#include <string>
#include <vector>

namespace support {

inline std::string xml_problem(const std::string& text,
                               const std::set<std::string>& void_elements = {}) {
  std::vector<std::string> open;
  const auto at = [](std::size_t i, const std::string& what) {
    return what + " at byte " + std::to_string(i);
  };
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] == '&') {
      const auto end = text.find(';', i);
      if (end == std::string::npos || end - i > 8) return at(i, "bare &");
      continue;
    }
    if (text[i] == '>') return at(i, "bare >");
    if (text[i] != '<') continue;
    if (text.compare(i, 2, "<!") == 0) {
      i = text.find('>', i);
      if (i == std::string::npos) return "unfinished declaration";
      continue;
    }
    const bool closing = i + 1 < text.size() && text[i + 1] == '/';
    std::size_t k = i + (closing ? 2 : 1);
    std::string name;
    while (k < text.size() && (std::isalnum(static_cast<unsigned char>(text[k])) != 0))
      name += text[k++];
    if (name.empty()) return at(i, "bare <");
    bool self_closed = false;
    while (k < text.size() && text[k] != '>') {
      if (text[k] == '"') {
        const auto end = text.find('"', k + 1);
        if (end == std::string::npos) return at(k, "unfinished attribute");
        if (text.substr(k, end - k).find('<') != std::string::npos)
          return at(k, "< in an attribute");
        k = end;
      } else if (text[k] == '<') {
        return at(k, "< inside a tag");
      }
      self_closed = text[k] == '/';
      ++k;
    }
    if (k >= text.size()) return at(i, "unfinished tag " + name);
    if (closing) {
      if (open.empty() || open.back() != name) {
        return at(i, "</" + name + "> closes " + (open.empty() ? "nothing" : open.back()));
      }
      open.pop_back();
    } else if (!self_closed && void_elements.count(name) == 0) {
      open.push_back(name);
    }
    i = k;
    // Style text is not markup.
    if (!closing && name == "style") {
      i = text.find("</style>", i);
      if (i == std::string::npos) return "unfinished style";
      --i;
    }
  }
  return open.empty() ? "" : "never closed: " + open.back();
}

}  // namespace support
