// Must be rejected by clang-tidy, once for each group of checks that .clang-tidy switches on:
// tools/lint fails if one of them is silent. Not part of any build.
#include <chrono>
#include <string>
#include <thread>
#include <utility>
#include <vector>

namespace lint {

struct badly_named {         // readability-identifier-naming
  double BadMember = 0;      // ... of a public member
  double p_WH = 0;           // a monogram: allowed
  double force_limit_N = 0;  // a unit: allowed
};

int use_after_move() {
  std::string a = "moved";
  const std::string b = std::move(a);
  return static_cast<int>(a.size() + b.size());  // bugprone-use-after-move
}

int copies(const std::vector<std::string>& all) {
  int n = 0;
  for (const std::string s : all) n += static_cast<int>(s.size());  // performance-for-range-copy
  return n;
}

struct HasVirtual {  // cppcoreguidelines-virtual-class-destructor
  virtual int f() { return 1; }
};

}  // namespace lint
