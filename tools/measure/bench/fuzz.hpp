// teletact bench fuzz: readers of files from outside, fed with damaged files for a while.
//
// Each reader has a few good files. An input is one of them with some damage: bits, bytes and
// numbers changed, parts cut out, doubled, moved, taken from another one; then, every other time,
// with its checksums made good again, so that the damage gets past them. Input n of a seed is
// always the same bytes.
//
// A reader must end: with a result, or with one line that says what is wrong. A fault is a crash,
// an exception, a line that is none, more than `limit_cpu_s` for one input, minutes without using
// any, or memory beyond `limit_MiB`. Each reader runs in a process of its own, `jobs` at once, so a
// fault ends the reader and not the bench; the input is kept. A line a minute tells how far they
// are.
#pragma once

#include <cstdint>
#include <functional>
#include <ostream>
#include <string>
#include <vector>

#include "rt/random.hpp"
#include "rt/result.hpp"
#include "tools/files/bench_metric.hpp"
#include "tools/measure/bench/limit.hpp"

namespace teletact {

struct FuzzReader {
  std::string name;
  std::vector<std::string> seeds;  // good files: `read` accepts each
  std::function<rt::Result<bool>(const std::string& bytes)> read;
  std::function<void(std::string& bytes)> seal;  // makes checksums good; empty: it has none
  bool text = false;                             // damage by words too
};

struct FuzzOptions {
  double seconds = 600;  // CPU of each reader
  std::uint64_t seed = 1;
  int jobs = 1;                    // readers at once
  std::string only;                // one reader; empty: all
  std::string keep = ".";          // folder for the input of a fault
  double limit_cpu_s = 10;         // for one input
  std::uint64_t limit_MiB = 4096;  // of address space; 0: none (sanitizers take all of it)
};

struct FuzzRow {
  std::string reader;
  std::uint64_t inputs = 0, accepted = 0;
  double cpu_s = 0;
  std::string fault;  // what happened, and the file with the input; empty: none
};

struct FuzzResult {
  std::vector<FuzzRow> rows;
  [[nodiscard]] int faults() const;
  [[nodiscard]] std::vector<Limit> limits() const;
  [[nodiscard]] int missed() const { return teletact::missed(limits()); }
  [[nodiscard]] std::vector<BenchMetric> metrics() const;
  void print(std::ostream& out) const;
};

// Input n: a function of its arguments.
[[nodiscard]] std::string fuzz_input(const FuzzReader& reader, std::uint64_t seed, std::uint64_t n);

// Throws std::runtime_error for a reader that there is not, or that refuses its own good files.
[[nodiscard]] FuzzResult bench_fuzz(std::ostream& progress, const std::vector<FuzzReader>& readers,
                                    const FuzzOptions& options);

}  // namespace teletact
