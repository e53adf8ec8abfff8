// The date, for files that say when they were made.
#pragma once

#include <ctime>
#include <string>

namespace teletact {

// UTC, as 2026-01-31.
[[nodiscard]] inline std::string today() {
  const std::time_t now = std::time(nullptr);
  std::tm parts{};
  gmtime_r(&now, &parts);
  char text[16];
  std::strftime(text, sizeof text, "%Y-%m-%d", &parts);
  return text;
}

}  // namespace teletact
