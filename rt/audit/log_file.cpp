#include "rt/audit/log_file.hpp"

#include <spdlog/details/null_mutex.h>
#include <spdlog/logger.h>
#include <spdlog/sinks/base_sink.h>
#include <spdlog/sinks/rotating_file_sink.h>

#include <filesystem>
#include <utility>

namespace rt {

namespace {

class LineSink final : public spdlog::sinks::base_sink<spdlog::details::null_mutex> {
 public:
  explicit LineSink(std::function<void(std::string_view)> take) : take_(std::move(take)) {}

 private:
  void sink_it_(const spdlog::details::log_msg& m) override {
    take_({m.payload.data(), m.payload.size()});
  }
  void flush_() override {}
  std::function<void(std::string_view)> take_;
};

}  // namespace

std::shared_ptr<spdlog::logger> open_log_file(NonRealtime&, LogFile file) {
  using Sink = spdlog::sinks::rotating_file_sink_mt;
  // An earlier run's go first: the sink would go on with them.
  for (std::size_t i = 0; i <= file.older; ++i)
    std::filesystem::remove(Sink::calc_filename(file.path, i));
  auto logger = std::make_shared<spdlog::logger>(
      "tasks", std::make_shared<Sink>(file.path, file.bytes, file.older));
  if (file.also) logger->sinks().push_back(std::make_shared<LineSink>(std::move(file.also)));
  // The records carry their own time (box clock), so lines need no other.
  logger->set_pattern("%l %v");
  logger->flush_on(spdlog::level::info);
  // Instead of a line of the library's on stderr in each second of a full disk.
  logger->set_error_handler(
      [refused = std::move(file.refused), told = false](const std::string&) mutable {
        if (!std::exchange(told, true) && refused) refused();
      });
  return logger;
}

}  // namespace rt
