// Configuration as data: each module describes its own struct to a Section; the struct's initial
// values are the defaults. A file may name any described key; an unknown key, a wrong type or a
// value out of range is one error that names file, key, value and allowed range.
//
//   struct HapticConfig {
//     double stiffness_N_per_m = 1000.0;
//     void describe(config::Section& s) {
//       s.number("stiffness_N_per_m", stiffness_N_per_m, 1, 14500, "spring at the device");
//     }
//   };
//
// A Section keeps pointers into the described structs: they must outlive it and not move.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <variant>
#include <vector>

#include "rt/result.hpp"

namespace config {

class Section {
 public:
  Section& number(std::string key, double& value, double lo, double hi, std::string doc);
  Section& integer(std::string key, int& value, int lo, int hi, std::string doc);
  Section& seed(std::string key, std::uint64_t& value, std::string doc);
  Section& flag(std::string key, bool& value, std::string doc);
  // `allowed` empty: any text.
  Section& text(std::string key, std::string& value, std::vector<std::string> allowed,
                std::string doc);
  // Fixed length list of numbers, e.g. a vector [x, y, z].
  Section& numbers(std::string key, std::span<double> values, double lo, double hi,
                   std::string doc);
  // A sub-table. The same key gives the same section.
  Section& section(std::string key, std::string doc = "");
  // An array of tables: `make` is called for each element of the file, appends one default item to
  // the caller's container and describes it. Use a std::deque or std::list: pointers must stay.
  Section& list(std::string key, std::function<void(Section&)> make, std::string doc);

  struct Number {
    double* value;
    double lo, hi;
  };
  struct Integer {
    int* value;
    int lo, hi;
  };
  struct Seed {
    std::uint64_t* value;
  };
  struct Flag {
    bool* value;
  };
  struct Text {
    std::string* value;
    std::vector<std::string> allowed;
  };
  struct Numbers {
    std::span<double> values;
    double lo, hi;
  };
  struct List {
    std::function<void(Section&)> make;
    std::vector<std::unique_ptr<Section>> items;
  };
  struct Field {
    std::string key, doc;
    std::variant<Number, Integer, Seed, Flag, Text, Numbers, List, std::unique_ptr<Section>> value;
    bool named = false;   // the file named it
    std::string initial;  // the value when it was described, as TOML
  };
  [[nodiscard]] const std::vector<std::unique_ptr<Field>>& fields() const { return fields_; }
  [[nodiscard]] std::vector<std::unique_ptr<Field>>& fields() { return fields_; }
  [[nodiscard]] Field* find(const std::string& key);
  // True if the file named this key (used by opt-in effects: what a scene does not name is not
  // built).
  [[nodiscard]] bool named(const std::string& key) const;

 private:
  Field& add(std::string key, std::string doc);
  std::vector<std::unique_ptr<Field>> fields_;
};

// Reads `path` into the described structs. On an error nothing the caller relies on is promised and
// the message says file, key, value and range.
[[nodiscard]] rt::Result<bool> load_file(const std::string& path, Section& root);
// The same for text; `name` stands for the file in messages.
[[nodiscard]] rt::Result<bool> load_text(const std::string& text, const std::string& name,
                                         Section& root);
// One command-line override "a.b.key=value", the value in TOML syntax.
[[nodiscard]] rt::Result<bool> load_override(const std::string& assignment, Section& root);
// The values in force, as TOML that load_text() accepts.
[[nodiscard]] std::string effective(const Section& root);
// Markdown table rows: key, default, range, meaning.
[[nodiscard]] std::string reference_table(const Section& root);

}  // namespace config
