// Log of a real-time thread: a record of 64 bytes into a ring, put into words by an ordinary
// thread.
//
//   set-up     LogSites sites; auto late = sites.add<double, int>(nrt, LogLevel::kWarning,
//                                                   "late by {:.1f} us, {} skipped");
//              RtLog log;                               one per real-time thread
//              LogDrain drain(nrt, sites, logger);      hands lines to spdlog
//              drain.attach(nrt, "haptic", log); drain.start(nrt, 10ms);
//   real time  log.write(late, tick.start, 12.5, 3);    no lock, no allocation, no system call
//
// A full ring drops the newest record and counts it; the drain reports the count. A site fixes the
// types of its words at compile time and checks its format string at set-up.
#pragma once

#include <array>
#include <atomic>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <thread>
#include <type_traits>
#include <vector>

#include "rt/channel/ring.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/time.hpp"

namespace spdlog {
class logger;
}

namespace rt {

enum class LogLevel : std::uint8_t { kDebug, kInfo, kWarning, kError };

struct LogRecord {
  static constexpr std::size_t kWords = 6;
  std::int64_t time_ns = 0;
  std::uint32_t site = 0;
  std::uint32_t reserved = 0;
  std::array<std::uint64_t, kWords> words{};
};
static_assert(sizeof(LogRecord) == 64 && std::is_trivially_copyable_v<LogRecord>);

namespace detail {
template <class A>
concept LogWord = (std::is_arithmetic_v<A> || std::is_enum_v<A>)&&sizeof(A) <= 8;

template <LogWord A>
constexpr char log_word_type() noexcept {
  if constexpr (std::is_floating_point_v<A>) {
    return 'f';
  } else if constexpr (std::is_enum_v<A>) {
    return log_word_type<std::underlying_type_t<A>>();
  } else {
    return std::is_signed_v<A> ? 'i' : 'u';
  }
}
template <LogWord A>
constexpr std::uint64_t log_word(A value) noexcept {
  if constexpr (std::is_floating_point_v<A>) {
    return std::bit_cast<std::uint64_t>(static_cast<double>(value));
  } else {
    return static_cast<std::uint64_t>(value);
  }
}
}  // namespace detail

// What a call site may write: made by LogSites::add, copied freely.
template <class... Words>
struct LogSite {
  std::uint32_t id = 0;
};

// The table of sites. Filled at set-up, read-only while logs run.
class LogSites {
 public:
  struct Entry {
    LogLevel level;
    std::string format;  // fmt syntax, one field per word
    std::string types;   // 'f', 'i' or 'u' per word
  };
  // Throws std::invalid_argument, naming the format, when it does not fit the words.
  template <detail::LogWord... Words>
  [[nodiscard]] LogSite<Words...> add(NonRealtime& nrt, LogLevel level, std::string format) {
    static_assert(sizeof...(Words) <= LogRecord::kWords, "a record carries up to six words");
    return {add_entry(nrt, {level, std::move(format), {detail::log_word_type<Words>()...}})};
  }
  [[nodiscard]] const Entry* find(std::uint32_t id) const noexcept {
    return id < entries_.size() ? &entries_[id] : nullptr;
  }
  // The record in words; says so when its site is unknown.
  [[nodiscard]] std::string text(const LogRecord& record) const;

 private:
  std::uint32_t add_entry(NonRealtime&, Entry entry);
  std::vector<Entry> entries_;
};

// One real-time thread's log. write() is the producer side, the drain the consumer.
class RtLog {
 public:
  static constexpr std::size_t kCapacity = 1024;

  // False: full, dropped and counted.
  template <class... Words>
  bool write(LogSite<Words...> site, Time time, std::type_identity_t<Words>... words) noexcept {
    const LogRecord record{ns_of(time), site.id, 0, {detail::log_word(words)...}};
    return ring_.try_push(record);
  }
  [[nodiscard]] std::uint64_t dropped() const noexcept { return ring_.dropped(); }
  [[nodiscard]] bool try_pop(LogRecord& out) noexcept { return ring_.try_pop(out); }

 private:
  Ring<LogRecord, kCapacity> ring_;
};

// Ordinary side: collects from all attached logs, orders by time, formats, hands to spdlog.
class LogDrain {
 public:
  LogDrain(NonRealtime&, const LogSites& sites, std::shared_ptr<spdlog::logger> logger);
  ~LogDrain();  // stops
  LogDrain(const LogDrain&) = delete;
  LogDrain& operator=(const LogDrain&) = delete;

  // Before start(). `log` must outlive the drain.
  void attach(NonRealtime&, std::string name, RtLog& log);
  // One pass by the calling thread, while the drain's own does not run; returns the records handed
  // over.
  std::size_t drain();
  // A line beside the records, by the thread that drains: of the box itself, which has no log.
  void say(std::int64_t time_ns, std::string_view name, std::string_view text);
  // An ordinary thread makes a pass each `period` until stop(), which makes a last one.
  void start(NonRealtime&, Nanos period);
  void stop();

  [[nodiscard]] std::uint64_t records() const noexcept {
    return records_.load(std::memory_order_relaxed);
  }
  [[nodiscard]] std::uint64_t dropped() const noexcept;

 private:
  struct Source {
    std::string name;
    RtLog* log;
    std::uint64_t dropped_reported;
  };
  struct Pending {
    LogRecord record;
    std::size_t source;
  };
  const LogSites& sites_;
  std::shared_ptr<spdlog::logger> logger_;
  std::vector<Source> sources_;
  std::vector<Pending> batch_;
  std::atomic<std::uint64_t> records_{0};
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

}  // namespace rt
