// The options --from and --to: a piece of a run, in seconds since its start.
#pragma once

#include <CLI/CLI.hpp>
#include <limits>
#include <memory>
#include <stdexcept>

#include "rt/store/read_store.hpp"
#include "tools/cli/options.hpp"

namespace teletact {

class PieceOptions {
 public:
  explicit PieceOptions(CLI::App& app) {
    app.add_option("--from", ends_->from_s, "only from this second of the run on")
        ->check(in_range(0, 1e8));
    app.add_option("--to", ends_->to_s, "only before this second of the run")
        ->check(in_range(0, 1e8));
  }
  // After parsing. Throws std::runtime_error when nothing lies between them.
  [[nodiscard]] rt::StorePiece piece() const {
    if (ends_->to_s <= ends_->from_s)
      throw std::runtime_error("--to: must lie after --from, both in seconds of the run");
    return {ends_->from_s, ends_->to_s};
  }

 private:
  struct Ends {
    double from_s = 0, to_s = std::numeric_limits<double>::infinity();
  };
  std::unique_ptr<Ends> ends_ = std::make_unique<Ends>();
};

}  // namespace teletact
