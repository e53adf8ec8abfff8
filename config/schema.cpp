#include "config/schema.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "config/value_text.hpp"

namespace config {

namespace {

[[noreturn]] void bad_schema(const std::string& key, const std::string& why) {
  throw std::logic_error("config schema: key '" + key + "': " + why);
}

void require_default(const std::string& key, double value, double lo, double hi) {
  if (!(lo <= hi)) bad_schema(key, "empty range");
  if (!std::isfinite(value) || value < lo || value > hi) {
    bad_schema(key, "default " + number_text(value) + " is outside " + range_text(lo, hi));
  }
}

}  // namespace

Section::Field& Section::add(std::string key, std::string doc) {
  if (key.empty()) bad_schema(key, "empty name");
  if (find(key) != nullptr) bad_schema(key, "described twice");
  fields_.push_back(std::make_unique<Field>());
  fields_.back()->key = std::move(key);
  fields_.back()->doc = std::move(doc);
  return *fields_.back();
}

Section& Section::number(std::string key, double& value, double lo, double hi, std::string doc) {
  require_default(key, value, lo, hi);
  Field& f = add(std::move(key), std::move(doc));
  f.value = Number{&value, lo, hi};
  f.initial = value_text(f);
  return *this;
}

Section& Section::integer(std::string key, int& value, int lo, int hi, std::string doc) {
  require_default(key, value, lo, hi);
  Field& f = add(std::move(key), std::move(doc));
  f.value = Integer{&value, lo, hi};
  f.initial = value_text(f);
  return *this;
}

Section& Section::seed(std::string key, std::uint64_t& value, std::string doc) {
  Field& f = add(std::move(key), std::move(doc));
  f.value = Seed{&value};
  f.initial = value_text(f);
  return *this;
}

Section& Section::flag(std::string key, bool& value, std::string doc) {
  Field& f = add(std::move(key), std::move(doc));
  f.value = Flag{&value};
  f.initial = value_text(f);
  return *this;
}

Section& Section::text(std::string key, std::string& value, std::vector<std::string> allowed,
                       std::string doc) {
  if (!allowed.empty() && std::find(allowed.begin(), allowed.end(), value) == allowed.end()) {
    bad_schema(key, "default '" + value + "' is not among the allowed values");
  }
  Field& f = add(std::move(key), std::move(doc));
  f.value = Text{&value, std::move(allowed)};
  f.initial = value_text(f);
  return *this;
}

Section& Section::numbers(std::string key, std::span<double> values, double lo, double hi,
                          std::string doc) {
  for (const double v : values) require_default(key, v, lo, hi);
  Field& f = add(std::move(key), std::move(doc));
  f.value = Numbers{values, lo, hi};
  f.initial = value_text(f);
  return *this;
}

Section& Section::section(std::string key, std::string doc) {
  if (Field* f = find(key); f != nullptr) {
    auto* sub = std::get_if<std::unique_ptr<Section>>(&f->value);
    if (sub == nullptr) bad_schema(key, "described twice");
    if (f->doc.empty()) f->doc = std::move(doc);
    return **sub;
  }
  Field& f = add(std::move(key), std::move(doc));
  f.value = std::make_unique<Section>();
  return *std::get<std::unique_ptr<Section>>(f.value);
}

Section& Section::list(std::string key, std::function<void(Section&)> make, std::string doc) {
  Field& f = add(std::move(key), std::move(doc));
  List list;
  list.make = std::move(make);
  f.value = std::move(list);
  return *this;
}

Section::Field* Section::find(const std::string& key) {
  for (const auto& f : fields_) {
    if (f->key == key) return f.get();
  }
  return nullptr;
}

bool Section::named(const std::string& key) const {
  return std::any_of(fields_.begin(), fields_.end(),
                     [&](const auto& f) { return f->key == key && f->named; });
}

// ---- output ------------------------------------------------------------------------------------

namespace {

using SubSection = std::unique_ptr<Section>;

bool is_value(const Section::Field& f) {
  return !std::holds_alternative<SubSection>(f.value) &&
         !std::holds_alternative<Section::List>(f.value);
}

// A file names this key, or code changed the value after it was described.
bool in_force(const Section::Field& f) { return f.named || value_text(f) != f.initial; }

bool anything_in_force(const Section& s) {
  return std::any_of(s.fields().begin(), s.fields().end(), [](const auto& f) {
    if (is_value(*f)) return in_force(*f);
    if (f->named) return true;
    if (const auto* sub = std::get_if<SubSection>(&f->value)) return anything_in_force(**sub);
    return !std::get<Section::List>(f->value).items.empty();
  });
}

void write_section(const Section& s, const std::string& path, bool active, std::string& out) {
  for (const auto& f : s.fields()) {
    if (!is_value(*f)) continue;
    if (!active || !in_force(*f)) out += "# ";
    out += key_text(f->key) + " = " + value_text(*f) + "\n";
  }
  for (const auto& f : s.fields()) {
    const std::string sub_path = path.empty() ? key_text(f->key) : path + "." + key_text(f->key);
    if (const auto* sub = std::get_if<SubSection>(&f->value)) {
      const bool sub_active = active && (f->named || anything_in_force(**sub));
      out += (sub_active ? "\n[" : "\n# [") + sub_path + "]\n";
      write_section(**sub, sub_path, sub_active, out);
    } else if (const auto* list = std::get_if<Section::List>(&f->value)) {
      for (const auto& item : list->items) {
        out += "\n[[" + sub_path + "]]\n";
        write_section(*item, sub_path, true, out);
      }
    }
  }
}

std::string cell(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (c == '|') out += '\\';
    out += c == '\n' ? ' ' : c;
  }
  return out;
}

void write_rows(const Section& s, const std::string& path, std::string& out) {
  for (const auto& f : s.fields()) {
    const std::string full = path.empty() ? f->key : path + "." + f->key;
    if (const auto* sub = std::get_if<SubSection>(&f->value)) {
      if (!f->doc.empty()) out += "| `[" + full + "]` | | | " + cell(f->doc) + " |\n";
      write_rows(**sub, full, out);
    } else if (const auto* list = std::get_if<Section::List>(&f->value)) {
      out += "| `[[" + full + "]]` | | list of tables | " + cell(f->doc) + " |\n";
      if (!list->items.empty()) write_rows(*list->items.front(), full + "[]", out);
    } else {
      out += "| `" + full + "` | `" + cell(f->initial) + "` | " + cell(allowed_text(*f)) + " | " +
             cell(f->doc) + " |\n";
    }
  }
}

}  // namespace

std::string effective(const Section& root) {
  std::string out;
  write_section(root, "", true, out);
  return out;
}

std::string reference_table(const Section& root) {
  std::string out;
  write_rows(root, "", out);
  return out;
}

}  // namespace config
