// TOML into a described schema. Strict: every key of the file must be described, every value must
// have the described type and lie in its range. All keys are looked at; of several errors the one
// that stands first in the file is reported.
#include <toml++/toml.h>
#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "config/schema.hpp"
#include "config/value_text.hpp"

namespace config {

namespace {

// A configuration is written by hand; these only bound what a wrong file can do to the parser.
constexpr std::size_t kMaxBytes = 1U << 20U;
constexpr std::size_t kMaxLineBytes = 8192;

std::string one_line(std::string_view text, std::size_t limit) {
  std::string out;
  for (const char c : text) {
    const auto u = static_cast<unsigned char>(c);
    out += (u < 0x20 || u == 0x7f) ? ' ' : c;
  }
  if (out.size() > limit) out = out.substr(0, limit) + "...";
  return out;
}

std::string place(const std::string& name, toml::source_index line) {
  std::string out = name;
  if (line > 0) out.append(":").append(std::to_string(line));
  return out;
}

std::string shown(const toml::node& node) {
  if (const auto* s = node.as_string()) return one_line(quoted_text(s->get()), 60);
  if (const auto* d = node.as_floating_point()) return number_text(d->get());
  if (node.is_table()) return "a table";
  std::ostringstream os;
  os << toml::node_view<const toml::node>(node);
  return one_line(os.str(), 60);
}

std::size_t edit_distance(const std::string& a, const std::string& b) {
  std::vector<std::size_t> row(b.size() + 1);
  for (std::size_t j = 0; j <= b.size(); ++j) row[j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t keep = diagonal + (a[i - 1] == b[j - 1] ? 0U : 1U);
      diagonal = row[j];
      row[j] = std::min({keep, row[j] + 1, row[j - 1] + 1});
    }
  }
  return row[b.size()];
}

// Edits from one to the other; a beginning in common says more than what follows differs.
std::size_t distance(const std::string& key, const std::string& known) {
  std::size_t same = 0;
  while (same < std::min(key.size(), known.size()) && key[same] == known[same]) ++same;
  const std::size_t edits = edit_distance(key, known);
  return same >= 4 ? std::min(edits, std::min(key.size(), known.size()) - same + 1) : edits;
}

struct Near {
  std::size_t distance = SIZE_MAX;
  std::string key;  // from the root
};

void nearest_in(const Section& s, const std::string& path, const std::string& key, bool deep,
                Near& best) {
  for (const auto& f : s.fields()) {
    const std::string full = path.empty() ? f->key : path + "." + f->key;
    const std::size_t d = distance(key, f->key);
    if (d < best.distance) best = {d, full};
    const auto* section = std::get_if<std::unique_ptr<Section>>(&f->value);
    if (deep && section != nullptr) nearest_in(**section, full, key, true, best);
  }
}

// What was meant: a key of the same table, else of any, that is like it; else what the table has.
std::string what_is_known(const Section& root, const Section& s, const std::string& path,
                          const std::string& key) {
  constexpr std::size_t kMostShown = 12;
  const std::string name = key.substr(0, 200);
  const std::size_t like = std::max<std::size_t>(2, name.size() / 3);
  Near best;
  nearest_in(s, path, name, false, best);
  if (best.distance > like) nearest_in(root, "", name, true, best);
  if (best.distance <= like) return "unknown key; the nearest known key is '" + best.key + "'";
  if (s.fields().empty()) return "unknown key; no key is known here";
  std::string list = "unknown key; known here: ";
  for (std::size_t i = 0; i < std::min(kMostShown, s.fields().size()); ++i)
    list += (i > 0 ? ", " : "") + s.fields()[i]->key;
  return s.fields().size() > kMostShown ? list + ", ..." : list;
}

class Reader {
 public:
  explicit Reader(std::string name) : name_(std::move(name)) {}

  void table(const toml::table& t, Section& s, const std::string& path) {
    if (path.empty()) root_ = &s;
    for (const auto& [key, node] : t) {
      const std::string k(key.str());
      const std::string full = path.empty() ? k : path + "." + k;
      Section::Field* f = s.find(k);
      if (f == nullptr) {
        fail(key.source(), full, shown(node), what_is_known(root_ ? *root_ : s, s, path, k));
        continue;
      }
      f->named = true;
      std::visit([&, &entry = node](auto& v) { read(entry, v, *f, full); }, f->value);
    }
  }

  [[nodiscard]] rt::Result<bool> result() const {
    if (message_.empty()) return true;
    return rt::Error{message_};
  }

 private:
  void fail(const toml::source_region& where, const std::string& key, const std::string& value,
            const std::string& why) {
    const auto line = where.begin.line;
    if (!message_.empty() && line >= line_) return;
    line_ = line;
    message_ = place(name_, line) + ": key '" + one_line(key, 200) + "' = " + value + ": " + why;
  }
  void refuse(const toml::node& node, const Section::Field& f, const std::string& full) {
    fail(node.source(), full, shown(node), "allowed " + allowed_text(f));
  }

  static bool to_number(const toml::node& node, double& out) {
    if (const auto* d = node.as_floating_point()) {
      out = d->get();
    } else if (const auto* i = node.as_integer()) {
      out = static_cast<double>(i->get());
    } else {
      return false;
    }
    return std::isfinite(out);
  }

  void read(const toml::node& node, Section::Number& v, const Section::Field& f,
            const std::string& full) {
    double value = 0;
    if (!to_number(node, value) || value < v.lo || value > v.hi) return refuse(node, f, full);
    *v.value = value;
  }
  void read(const toml::node& node, Section::Integer& v, const Section::Field& f,
            const std::string& full) {
    const auto* i = node.as_integer();
    if (i == nullptr || i->get() < v.lo || i->get() > v.hi) return refuse(node, f, full);
    *v.value = static_cast<int>(i->get());
  }
  void read(const toml::node& node, Section::Seed& v, const Section::Field& f,
            const std::string& full) {
    if (const auto* i = node.as_integer(); i != nullptr && i->get() >= 0) {
      *v.value = static_cast<std::uint64_t>(i->get());
      return;
    }
    if (const auto* s = node.as_string(); s != nullptr) {
      const std::string& text = s->get();
      std::uint64_t value = 0;
      const auto r = std::from_chars(text.data(), text.data() + text.size(), value);
      if (r.ec == std::errc{} && r.ptr == text.data() + text.size()) {
        *v.value = value;
        return;
      }
    }
    refuse(node, f, full);
  }
  void read(const toml::node& node, Section::Flag& v, const Section::Field& f,
            const std::string& full) {
    const auto* b = node.as_boolean();
    if (b == nullptr) return refuse(node, f, full);
    *v.value = b->get();
  }
  void read(const toml::node& node, Section::Text& v, const Section::Field& f,
            const std::string& full) {
    const auto* s = node.as_string();
    if (s == nullptr) return refuse(node, f, full);
    if (!v.allowed.empty() &&
        std::find(v.allowed.begin(), v.allowed.end(), s->get()) == v.allowed.end()) {
      return refuse(node, f, full);
    }
    *v.value = s->get();
  }
  void read(const toml::node& node, Section::Numbers& v, const Section::Field& f,
            const std::string& full) {
    const auto* a = node.as_array();
    if (a == nullptr || a->size() != v.values.size()) return refuse(node, f, full);
    for (std::size_t i = 0; i < v.values.size(); ++i) {
      double value = 0;
      const toml::node* item = a->get(i);
      if (!to_number(*item, value) || value < v.lo || value > v.hi) {
        return refuse(*item, f, full + "[" + std::to_string(i) + "]");
      }
      v.values[i] = value;
    }
  }
  void read(const toml::node& node, std::unique_ptr<Section>& v, const Section::Field& f,
            const std::string& full) {
    const auto* t = node.as_table();
    if (t == nullptr) return refuse(node, f, full);
    table(*t, *v, full);
  }
  void read(const toml::node& node, Section::List& v, const Section::Field& f,
            const std::string& full) {
    const auto* a = node.as_array();
    if (a == nullptr) return refuse(node, f, full);
    for (std::size_t i = 0; i < a->size(); ++i) {
      const toml::node* item = a->get(i);
      const std::string item_path = full + "[" + std::to_string(v.items.size()) + "]";
      const auto* t = item->as_table();
      if (t == nullptr) {
        refuse(*item, f, item_path);
        continue;
      }
      v.items.push_back(std::make_unique<Section>());
      v.make(*v.items.back());
      table(*t, *v.items.back(), item_path);
    }
  }

  std::string name_, message_;
  const Section* root_ = nullptr;
  toml::source_index line_ = 0;
};

rt::Result<bool> check_size(const std::string& text, const std::string& name) {
  if (text.size() > kMaxBytes) {
    return rt::Error{name + ": " + std::to_string(text.size()) + " bytes: allowed 0.." +
                     std::to_string(kMaxBytes)};
  }
  std::size_t line = 1;
  for (std::size_t begin = 0; begin < text.size(); ++line) {
    const std::size_t end = std::min(text.find('\n', begin), text.size());
    if (end - begin > kMaxLineBytes) {
      return rt::Error{name + ":" + std::to_string(line) + ": line of " +
                       std::to_string(end - begin) + " bytes: allowed 0.." +
                       std::to_string(kMaxLineBytes)};
    }
    begin = end + 1;
  }
  return true;
}

}  // namespace

rt::Result<bool> load_text(const std::string& text, const std::string& name, Section& root) {
  if (auto size = check_size(text, name); !size) return size;
  toml::table parsed;
  try {
    parsed = toml::parse(std::string_view(text));
  } catch (const toml::parse_error& e) {
    const auto line = e.source().begin.line;
    return rt::Error{place(name, line) + ": not TOML: " + one_line(e.description(), 300)};
  }
  Reader reader(name);
  reader.table(parsed, root, "");
  return reader.result();
}

rt::Result<bool> load_file(const std::string& path, Section& root) {
  std::error_code ignored;
  if (std::filesystem::is_directory(path, ignored)) {
    return rt::Error{path + ": is a folder, not a file"};
  }
  std::ifstream in(path, std::ios::binary);
  if (!in) return rt::Error{path + ": can not be opened for reading"};
  std::ostringstream text;
  text << in.rdbuf();
  if (in.bad()) return rt::Error{path + ": can not be read"};
  return load_text(text.str(), path, root);
}

rt::Result<bool> load_override(const std::string& assignment, Section& root) {
  const std::string name = "command line";
  const auto equals = assignment.find('=');
  if (equals == std::string::npos || assignment.find_first_of("\n\r") != std::string::npos ||
      assignment.find_first_not_of(" \t") == assignment.find('[')) {
    return rt::Error{name + ": '" + one_line(assignment, 120) +
                     "': allowed one assignment KEY=VALUE, the value in TOML syntax"};
  }
  auto result = load_text(assignment, name, root);
  if (!result && result.error().find("not TOML") != std::string::npos) {
    return rt::Error{name + ": '" + one_line(assignment, 120) +
                     "': the value must be TOML (text in quotes, numbers bare)"};
  }
  return result;
}

}  // namespace config
