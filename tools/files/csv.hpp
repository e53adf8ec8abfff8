// Comma-separated tables of the batch tools. Blank lines and lines that begin with '#' are skipped.
// The first other line is the header if its first cell is not a number.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "rt/result.hpp"

namespace teletact {

struct CsvTable {
  std::string name;                 // the file, for messages
  std::vector<std::string> header;  // empty: none
  std::vector<std::vector<std::string>> rows;
  std::vector<std::size_t> lines;  // line number of each row

  // Index of a named column, or -1.
  [[nodiscard]] int column(const std::string& column_name) const;
  // The cell as a finite number; an error names file, line and cell.
  [[nodiscard]] rt::Result<double> number(std::size_t row, std::size_t column) const;
  // The same, but "nan" and "inf" are values too.
  [[nodiscard]] rt::Result<double> any_number(std::size_t row, std::size_t column) const;
};

// Every row must have as many cells as the header, or as the first row.
[[nodiscard]] rt::Result<CsvTable> read_csv(const std::string& path);
[[nodiscard]] rt::Result<CsvTable> parse_csv(const std::string& text, const std::string& name);

// Columns as numbers, in the order of `columns`; with a header they are found by name, without one
// they are the first ones. The first column must rise strictly.
[[nodiscard]] rt::Result<std::vector<std::vector<double>>> numeric_rows(
    const CsvTable& table, const std::vector<std::string>& columns);

}  // namespace teletact
