// A token for "this may allocate, block or throw". Set-up code receives a NonRealtime& from the
// application's start-up and hands it on; a step() has none, so a call from it does not compile.
#pragma once

namespace rt {

class NonRealtime {
 public:
  NonRealtime(const NonRealtime&) = delete;
  NonRealtime& operator=(const NonRealtime&) = delete;

 private:
  NonRealtime() = default;
  friend class Startup;
};

// Made once by main() and by tests; nothing below tools/ makes one.
class Startup {
 public:
  Startup() = default;
  [[nodiscard]] NonRealtime& token() noexcept { return token_; }

 private:
  NonRealtime token_;
};

}  // namespace rt
