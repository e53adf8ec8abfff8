// Tests that assert the same of many samples: few of them in every run, all where TELETACT_WHOLE is
// set (tools/test --all, ctest -C all: the tests <name>.whole that WHOLE_TESTS of teletact_test
// declares).
#pragma once

#include <cstddef>
#include <cstdlib>
#include <initializer_list>
#include <vector>

namespace tests {

inline bool whole() { return std::getenv("TELETACT_WHOLE") != nullptr; }

// All of them, or those at these places.
template <class T>
std::vector<T> whole_or(const std::vector<T>& all, std::initializer_list<std::size_t> few) {
  if (whole()) return all;
  std::vector<T> out;
  for (const std::size_t i : few) out.push_back(all.at(i));
  return out;
}

// All of them, or each n-th.
template <class T>
std::vector<T> whole_or_each(const std::vector<T>& all, std::size_t n) {
  if (whole()) return all;
  std::vector<T> out;
  for (std::size_t i = 0; i < all.size(); i += n) out.push_back(all[i]);
  return out;
}

}  // namespace tests
