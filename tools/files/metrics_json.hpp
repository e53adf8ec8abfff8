// The machine-readable result of a run or bench: {"command", "version", "host", "metrics": [...]}.
// Metric names are documented in docs/metrics.md.
#pragma once

#include <string>
#include <vector>

namespace teletact {

class Metrics {
 public:
  explicit Metrics(std::string command) : command_(std::move(command)) {}
  void add(std::string name, double value, std::string unit);
  void add(std::string name, std::string value, std::string unit);  // hashes, states
  // Writes the file whole or not at all (temporary file, then rename). Throws std::runtime_error.
  void write(const std::string& path) const;
  [[nodiscard]] std::string json() const;
  struct Row {
    std::string name, text, unit;
    double value = 0;
    bool is_text = false;
  };
  [[nodiscard]] const std::vector<Row>& rows() const { return rows_; }

 private:
  std::string command_;
  std::vector<Row> rows_;
};

}  // namespace teletact
