#include "rt/audit/rt_log.hpp"

#include <pthread.h>
#include <sched.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <stdexcept>
#include <utility>

#if defined(SPDLOG_FMT_EXTERNAL)
#include <fmt/args.h>
#else
#include <spdlog/fmt/bundled/args.h>
#endif

namespace rt {
namespace {

spdlog::level::level_enum to_spdlog(LogLevel level) {
  switch (level) {
    case LogLevel::kDebug:
      return spdlog::level::debug;
    case LogLevel::kInfo:
      return spdlog::level::info;
    case LogLevel::kWarning:
      return spdlog::level::warn;
    case LogLevel::kError:
      break;
  }
  return spdlog::level::err;
}

std::string format_words(const LogSites::Entry& entry, const LogRecord& record) {
  fmt::dynamic_format_arg_store<fmt::format_context> args;
  for (std::size_t i = 0; i < entry.types.size(); ++i) {
    const std::uint64_t word = record.words[i];
    switch (entry.types[i]) {
      case 'f':
        args.push_back(std::bit_cast<double>(word));
        break;
      case 'i':
        args.push_back(static_cast<std::int64_t>(word));
        break;
      default:
        args.push_back(word);
        break;
    }
  }
  return fmt::vformat(entry.format, args);
}

// Fields of a format string; "{{" and "}}" are braces, not fields.
std::size_t count_fields(std::string_view format) {
  std::size_t fields = 0;
  for (std::size_t i = 0; i < format.size(); ++i) {
    if (format[i] != '{') continue;
    if (i + 1 < format.size() && format[i + 1] == '{') {
      ++i;
    } else {
      ++fields;
    }
  }
  return fields;
}

}  // namespace

std::uint32_t LogSites::add_entry(NonRealtime&, Entry entry) {
  // fmt accepts more arguments than fields; a word that is never printed is a mistake as well.
  if (count_fields(entry.format) != entry.types.size()) {
    throw std::invalid_argument("log site \"" + entry.format +
                                "\": " + std::to_string(entry.types.size()) + " words for " +
                                std::to_string(count_fields(entry.format)) + " fields");
  }
  try {
    (void)format_words(entry, LogRecord{});
  } catch (const fmt::format_error& e) {
    throw std::invalid_argument("log site \"" + entry.format + "\": " + e.what());
  }
  entries_.push_back(std::move(entry));
  return static_cast<std::uint32_t>(entries_.size() - 1);
}

std::string LogSites::text(const LogRecord& record) const {
  const Entry* entry = find(record.site);
  if (entry == nullptr) return fmt::format("record of unknown site {}", record.site);
  return format_words(*entry, record);
}

LogDrain::LogDrain(NonRealtime&, const LogSites& sites, std::shared_ptr<spdlog::logger> logger)
    : sites_(sites), logger_(std::move(logger)) {}

LogDrain::~LogDrain() { stop(); }

void LogDrain::attach(NonRealtime&, std::string name, RtLog& log) {
  sources_.push_back({std::move(name), &log, 0});
}

std::size_t LogDrain::drain() {
  batch_.clear();
  for (std::size_t s = 0; s < sources_.size(); ++s) {
    LogRecord record;
    // Bounded: a source that writes as fast as we read must not keep the others waiting.
    for (std::size_t n = 0; n < RtLog::kCapacity && sources_[s].log->try_pop(record); ++n) {
      batch_.push_back({record, s});
    }
  }
  std::stable_sort(batch_.begin(), batch_.end(), [](const Pending& a, const Pending& b) {
    return a.record.time_ns < b.record.time_ns;
  });
  for (const Pending& p : batch_) {
    const LogSites::Entry* entry = sites_.find(p.record.site);
    const LogLevel level = entry == nullptr ? LogLevel::kError : entry->level;
    logger_->log(to_spdlog(level), "{:.9f} {}: {}", static_cast<double>(p.record.time_ns) * 1e-9,
                 sources_[p.source].name, sites_.text(p.record));
  }
  for (Source& source : sources_) {
    const std::uint64_t dropped = source.log->dropped();
    if (dropped == source.dropped_reported) continue;
    logger_->warn("{}: {} log records dropped, the ring of {} was full", source.name,
                  dropped - source.dropped_reported, RtLog::kCapacity);
    source.dropped_reported = dropped;
  }
  records_.fetch_add(batch_.size(), std::memory_order_relaxed);
  return batch_.size();
}

void LogDrain::say(std::int64_t time_ns, std::string_view name, std::string_view text) {
  logger_->info("{:.9f} {}: {}", static_cast<double>(time_ns) * 1e-9, name, text);
}

void LogDrain::start(NonRealtime&, Nanos period) {
  if (thread_.joinable()) return;
  stopping_.store(false, std::memory_order_relaxed);
  thread_ = std::thread([this, period] {
    // The creator may be real-time; this thread must not inherit that.
    const sched_param ordinary{};
    (void)pthread_setschedparam(pthread_self(), SCHED_OTHER, &ordinary);
    (void)pthread_setname_np(pthread_self(), "log");
    while (!stopping_.load(std::memory_order_relaxed)) {
      drain();
      std::this_thread::sleep_for(period);
    }
  });
}

void LogDrain::stop() {
  if (!thread_.joinable()) return;
  stopping_.store(true, std::memory_order_relaxed);
  thread_.join();
  drain();
  logger_->flush();
}

std::uint64_t LogDrain::dropped() const noexcept {
  std::uint64_t n = 0;
  for (const Source& source : sources_) n += source.log->dropped();
  return n;
}

}  // namespace rt
