#include "tools/files/csv.hpp"

#include <cctype>
#include <charconv>
#include <cmath>
#include <fstream>
#include <optional>
#include <sstream>

namespace teletact {

namespace {

std::string trimmed(const std::string& s) {
  std::size_t a = 0, b = s.size();
  while (a < b && std::isspace(static_cast<unsigned char>(s[a])) != 0) ++a;
  while (b > a && std::isspace(static_cast<unsigned char>(s[b - 1])) != 0) --b;
  return s.substr(a, b - a);
}

std::optional<double> to_number(const std::string& cell) {
  double value = 0;
  const char* first = cell.data();
  const char* last = first + cell.size();
  if (first != last && *first == '+') ++first;
  const auto [end, error] = std::from_chars(first, last, value);
  if (error != std::errc{} || end != last) return std::nullopt;
  return value;
}

}  // namespace

int CsvTable::column(const std::string& column_name) const {
  for (std::size_t i = 0; i < header.size(); ++i) {
    if (header[i] == column_name) return static_cast<int>(i);
  }
  return -1;
}

rt::Result<double> CsvTable::number(std::size_t row, std::size_t col) const {
  const std::string& cell = rows[row][col];
  const auto value = to_number(cell);
  if (!value || !std::isfinite(*value)) {
    return rt::Error{name + ":" + std::to_string(lines[row]) + ": '" + cell +
                     "' is not a finite number"};
  }
  return *value;
}

rt::Result<double> CsvTable::any_number(std::size_t row, std::size_t col) const {
  const std::string& cell = rows[row][col];
  const auto value = to_number(cell);
  if (!value) {
    return rt::Error{name + ":" + std::to_string(lines[row]) + ": '" + cell + "' is not a number"};
  }
  return *value;
}

rt::Result<CsvTable> parse_csv(const std::string& text, const std::string& name) {
  CsvTable out;
  out.name = name;
  std::istringstream in(text);
  std::string line;
  std::size_t number = 0, width = 0;
  while (std::getline(in, line)) {
    ++number;
    // The byte order mark that some spreadsheets write first.
    if (number == 1 && line.rfind("\xEF\xBB\xBF", 0) == 0) line.erase(0, 3);
    const std::string body = trimmed(line);
    if (body.empty() || body.front() == '#') continue;
    std::vector<std::string> cells;
    std::size_t from = 0;
    while (true) {
      const std::size_t comma = body.find(',', from);
      cells.push_back(trimmed(body.substr(from, comma - from)));
      if (comma == std::string::npos) break;
      from = comma + 1;
    }
    if (width == 0) {
      width = cells.size();
      if (!to_number(cells.front())) {
        out.header = std::move(cells);
        continue;
      }
    }
    if (cells.size() != width) {
      return rt::Error{name + ":" + std::to_string(number) + ": " + std::to_string(cells.size()) +
                       " cells where " + std::to_string(width) + " are expected"};
    }
    out.rows.push_back(std::move(cells));
    out.lines.push_back(number);
  }
  if (out.rows.empty()) return rt::Error{name + ": no data rows"};
  return out;
}

rt::Result<CsvTable> read_csv(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) return rt::Error{path + ": cannot be opened"};
  std::ostringstream text;
  text << file.rdbuf();
  if (file.bad()) return rt::Error{path + ": cannot be read"};
  return parse_csv(text.str(), path);
}

rt::Result<std::vector<std::vector<double>>> numeric_rows(const CsvTable& table,
                                                          const std::vector<std::string>& columns) {
  std::vector<std::size_t> index;
  for (std::size_t i = 0; i < columns.size(); ++i) {
    int at = static_cast<int>(i);
    if (!table.header.empty()) {
      at = table.column(columns[i]);
      if (at < 0) return rt::Error{table.name + ": column '" + columns[i] + "' is missing"};
    } else if (i >= table.rows.front().size()) {
      return rt::Error{table.name + ": " + std::to_string(table.rows.front().size()) +
                       " columns where " + std::to_string(columns.size()) + " are needed"};
    }
    index.push_back(static_cast<std::size_t>(at));
  }
  std::vector<std::vector<double>> out;
  out.reserve(table.rows.size());
  for (std::size_t r = 0; r < table.rows.size(); ++r) {
    std::vector<double> row;
    for (const std::size_t c : index) {
      auto value = table.number(r, c);
      if (!value) return rt::Error{value.error()};
      row.push_back(value.value());
    }
    if (!out.empty() && !(row.front() > out.back().front())) {
      return rt::Error{table.name + ":" + std::to_string(table.lines[r]) + ": " + columns.front() +
                       " must rise from row to row"};
    }
    out.push_back(std::move(row));
  }
  return out;
}

}  // namespace teletact
