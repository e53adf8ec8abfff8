// The text file that a LogDrain writes to. It keeps the newest lines: this file, and older ones
// beside it (operator.1.log). A line that the disk refuses is lost in the file and nowhere else;
// the first one is told. Ordinary threads only.
#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <string>
#include <string_view>

#include "rt/memory/non_realtime.hpp"

namespace spdlog {
class logger;
}

namespace rt {

struct LogFile {
  std::string path;
  std::function<void(std::string_view)> also{};  // sees each line, whatever the disk does
  std::function<void()> refused{};               // once, by the thread that drains
  std::size_t bytes = std::size_t{8} << 20U;     // of one file
  std::size_t older = 2;                         // files beside it
};

// Files of an earlier log under these names are removed. Throws spdlog::spdlog_ex, a
// std::exception, when the file can not be made.
[[nodiscard]] std::shared_ptr<spdlog::logger> open_log_file(NonRealtime&, LogFile file);

}  // namespace rt
