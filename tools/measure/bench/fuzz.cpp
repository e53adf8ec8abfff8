#include "tools/measure/bench/fuzz.hpp"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/time.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <memory>
#include <stdexcept>

namespace teletact {
namespace {

// Told by the reader's process while it works.
struct Progress {
  std::uint64_t input, accepted;
  std::int64_t cpu_ns;
  char message[256];
};
constexpr int kBadMessage = 41, kException = 42;

std::int64_t cpu_ns() {
  timespec t{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return t.tv_sec * 1000000000LL + t.tv_nsec;
}

double wall_s() {
  timespec t{};
  clock_gettime(CLOCK_MONOTONIC, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

constexpr double kSpeak_s = 60;  // between two words about those that run

std::size_t below(rt::Random& random, std::size_t n) {
  return n == 0 ? 0 : static_cast<std::size_t>(random() % n);
}

constexpr std::uint64_t kNumbers[] = {0,
                                      1,
                                      0x7f,
                                      0x80,
                                      0xff,
                                      0x7fff,
                                      0x8000,
                                      0xffff,
                                      0x10000,
                                      0x7fffffff,
                                      0x80000000,
                                      0xffffffff,
                                      0x7ff0000000000000,
                                      0x7ff8000000000000,
                                      0xffffffffffffffff};
constexpr const char* kWords[] = {"nan",     "inf",       "-inf",
                                  "1e999",   "-1e308",    "1e-320",
                                  "0",       "-1",        "99999999999999999999",
                                  "1.5.2",   "0x10",      "#",
                                  "\n",      "",          "a b",
                                  "../../x", "4294967296"};

void damage_bytes(std::string& b, rt::Random& random, const std::string& other) {
  const std::size_t at = below(random, b.size());
  const std::size_t length = 1 + below(random, std::min<std::size_t>(b.size() - at, 64));
  switch (random.integer(0, 8)) {
    case 0:
      b[at] = static_cast<char>(b[at] ^ (1 << (random() & 7U)));
      break;
    case 1:
      b[at] = static_cast<char>(random());
      break;
    case 2: {  // a number, of 1, 2, 4 or 8 bytes
      const std::uint64_t v = kNumbers[below(random, std::size(kNumbers))];
      const std::size_t n = std::min<std::size_t>(std::size_t{1} << (random() & 3U), b.size() - at);
      std::memcpy(b.data() + at, &v, n);
      break;
    }
    case 3:
      b.erase(at, length);
      break;
    case 4:
      b.insert(at, b.substr(at, length));
      break;
    case 5:
      b.insert(at, std::string(length, static_cast<char>(random())));
      break;
    case 6:
      b.resize(at);
      break;
    case 7: {  // the end of another file
      const std::size_t from = below(random, other.size());
      b = b.substr(0, at) + other.substr(from);
      break;
    }
    default: {  // a part elsewhere
      const std::string part = b.substr(at, length);
      b.erase(at, length);
      b.insert(below(random, b.size() + 1), part);
      break;
    }
  }
}

void damage_word(std::string& b, rt::Random& random) {
  const auto blank = [&](std::size_t i) { return b[i] == ' ' || b[i] == '\n' || b[i] == ','; };
  std::size_t first = below(random, b.size());
  while (first > 0 && !blank(first - 1)) --first;
  std::size_t last = first;
  while (last < b.size() && !blank(last)) ++last;
  b.replace(first, last - first, kWords[below(random, std::size(kWords))]);
}

// In the reader's process; does not return.
[[noreturn]] void work(const FuzzReader& reader, const FuzzOptions& options,
                       const std::string& said, Progress& progress) {
  if (options.limit_MiB > 0) {
    const rlimit memory{options.limit_MiB << 20U, options.limit_MiB << 20U};
    setrlimit(RLIMIT_AS, &memory);
  }
  // Decoders grumble: their last words are kept, for a fault.
  const int words = open(said.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_APPEND, 0644);
  if (words >= 0) dup2(words, STDERR_FILENO);
  const rlimit no_core{0, 0};
  setrlimit(RLIMIT_CORE, &no_core);
  const std::int64_t end = cpu_ns() + static_cast<std::int64_t>(1e9 * options.seconds);
  const auto seconds = static_cast<std::time_t>(options.limit_cpu_s);
  const itimerval bound{{0, 0}, {std::max<std::time_t>(seconds, 1), 0}};
  const std::int64_t begin = cpu_ns();
  try {
    for (std::uint64_t n = 0; cpu_ns() < end; ++n) {
      progress.input = n;
      if (words >= 0 && n % 64 == 0 && ftruncate(words, 0) != 0) _exit(1);
      const std::string bytes = fuzz_input(reader, options.seed, n);
      setitimer(ITIMER_PROF, &bound, nullptr);  // SIGPROF ends a reader that does not
      const auto result = reader.read(bytes);
      if (result) {
        ++progress.accepted;
      } else if (result.error().empty() || result.error().find('\n') != std::string::npos) {
        std::snprintf(progress.message, sizeof progress.message, "%s", result.error().c_str());
        _exit(kBadMessage);
      }
      progress.cpu_ns = cpu_ns() - begin;
    }
  } catch (const std::exception& e) {
    std::snprintf(progress.message, sizeof progress.message, "%s", e.what());
    _exit(kException);
  }
  _exit(0);
}

std::string what_ended(int status, const Progress& progress) {
  if (WIFSIGNALED(status)) {
    const int signal = WTERMSIG(status);
    return signal == SIGPROF ? "does not end" : std::string("signal: ") + strsignal(signal);
  }
  const int code = WEXITSTATUS(status);
  if (code == 0) return {};
  if (code == kBadMessage) return std::string("message that is no line: ") + progress.message;
  if (code == kException) return std::string("exception: ") + progress.message;
  return "ended with " + std::to_string(code);
}

// A reader in a process of its own, from its start to its end.
class Fuzzed {
 public:
  Fuzzed(const FuzzReader& reader, const FuzzOptions& options)
      : reader_(reader),
        options_(options),
        said_((std::filesystem::path(options.keep) / (reader.name + ".stderr")).string()) {
    for (const std::string& good : reader.seeds) {
      const auto result = reader.read(good);
      if (!result)
        throw std::runtime_error(reader.name + " refuses a good file: " + result.error());
    }
    void* shared =
        mmap(nullptr, sizeof(Progress), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (shared == MAP_FAILED) throw std::runtime_error("no shared memory");
    progress_ = static_cast<Progress*>(shared);
    moved_s_ = wall_s();
    pid_ = fork();
    if (pid_ == 0) work(reader, options, said_, *progress_);
    if (pid_ < 0) {
      munmap(progress_, sizeof(Progress));
      throw std::runtime_error("no process could be started");
    }
  }
  ~Fuzzed() {
    if (pid_ > 0) {  // left by an exception
      kill(pid_, SIGKILL);
      wait(0);
    }
    munmap(progress_, sizeof(Progress));
  }
  Fuzzed(const Fuzzed&) = delete;
  Fuzzed& operator=(const Fuzzed&) = delete;

  // Does not wait. True: it has ended, and row() tells how.
  [[nodiscard]] bool ended() {
    if (wait(WNOHANG)) return true;
    const std::uint64_t input = progress_->input;
    if (input != last_input_) last_input_ = input, moved_s_ = wall_s();
    // A reader that waits for something uses no CPU: no limit of CPU time ends it.
    if (wall_s() - moved_s_ < kStandstill_s + 10 * options_.limit_cpu_s) return false;
    kill(pid_, SIGKILL);
    wait(0);
    stands_ = true;
    return true;
  }
  [[nodiscard]] FuzzRow row() const {
    FuzzRow row;
    row.reader = reader_.name;
    row.inputs = progress_->input + 1;
    row.accepted = progress_->accepted;
    row.cpu_s = 1e-9 * static_cast<double>(progress_->cpu_ns);
    row.fault = stands_ ? "stands still" : what_ended(status_, *progress_);
    std::error_code ignored;
    if (row.fault.empty()) {
      std::filesystem::remove(said_, ignored);
      return row;
    }
    const std::string file = reader_.name + "_" + std::to_string(options_.seed) + "_" +
                             std::to_string(progress_->input) + ".fault";
    const auto path = std::filesystem::path(options_.keep) / file;
    std::ofstream(path, std::ios::binary) << fuzz_input(reader_, options_.seed, progress_->input);
    row.fault += "; input: " + path.string() + ", what it said: " + said_;
    return row;
  }
  [[nodiscard]] std::string so_far() const {
    char text[96];
    std::snprintf(text, sizeof text, "%s %.0f of %.0f s, %llu inputs", reader_.name.c_str(),
                  1e-9 * static_cast<double>(progress_->cpu_ns), options_.seconds,
                  static_cast<unsigned long long>(progress_->input));
    return text;
  }

 private:
  static constexpr double kStandstill_s = 60;
  bool wait(int flags) {
    pid_t got = 0;
    while ((got = waitpid(pid_, &status_, flags)) < 0 && errno == EINTR) {
    }
    if (got != pid_) return false;
    pid_ = -1;
    return true;
  }

  const FuzzReader& reader_;
  const FuzzOptions& options_;
  std::string said_;
  Progress* progress_ = nullptr;
  pid_t pid_ = -1;
  int status_ = 0;
  bool stands_ = false;
  std::uint64_t last_input_ = 0;
  double moved_s_ = 0;
};

}  // namespace

std::string fuzz_input(const FuzzReader& reader, std::uint64_t seed, std::uint64_t n) {
  rt::Random random(seed, n);
  std::string bytes = reader.seeds[below(random, reader.seeds.size())];
  const std::string& other = reader.seeds[below(random, reader.seeds.size())];
  const auto edits = random.integer(1, 5);
  for (std::int64_t e = 0; e < edits && !bytes.empty(); ++e) {
    if (reader.text && (random() & 1U) != 0) {
      damage_word(bytes, random);
    } else {
      damage_bytes(bytes, random, other);
    }
  }
  if (reader.seal && (random() & 1U) != 0) reader.seal(bytes);
  return bytes;
}

FuzzResult bench_fuzz(std::ostream& progress, const std::vector<FuzzReader>& readers,
                      const FuzzOptions& options) {
  std::vector<const FuzzReader*> wanted;
  for (const FuzzReader& reader : readers)
    if (options.only.empty() || options.only == reader.name) wanted.push_back(&reader);
  if (wanted.empty()) {
    std::string names;
    for (const FuzzReader& r : readers) names += (names.empty() ? "" : ", ") + r.name;
    throw std::runtime_error("--reader " + options.only + ": there are " + names);
  }
  FuzzResult result;
  result.rows.resize(wanted.size());
  std::vector<std::unique_ptr<Fuzzed>> running(wanted.size());
  std::size_t started = 0, ended = 0;
  double spoken_s = wall_s();
  while (ended < wanted.size()) {
    for (; started < wanted.size() && started - ended < static_cast<std::size_t>(options.jobs);
         ++started) {
      progress << "fuzzing " << wanted[started]->name << ", seed " << options.seed << ", "
               << started + 1 << " of " << wanted.size() << std::endl;
      running[started] = std::make_unique<Fuzzed>(*wanted[started], options);
    }
    usleep(50'000);
    const bool speak = wall_s() - spoken_s > kSpeak_s;
    if (speak) spoken_s = wall_s();
    for (std::size_t n = 0; n < started; ++n) {
      if (running[n] == nullptr) continue;
      if (running[n]->ended()) {
        result.rows[n] = running[n]->row();
        running[n].reset();
        ++ended;
        if (!result.rows[n].fault.empty())
          progress << "FAULT: " << result.rows[n].reader << ": " << result.rows[n].fault
                   << std::endl;
      } else if (speak) {
        progress << "  " << running[n]->so_far() << std::endl;
      }
    }
  }
  return result;
}

int FuzzResult::faults() const {
  return static_cast<int>(
      std::count_if(rows.begin(), rows.end(), [](const FuzzRow& r) { return !r.fault.empty(); }));
}

void FuzzResult::print(std::ostream& out) const {
  char line[160];
  out << "reader                  inputs    accepted   CPU s\n";
  for (const FuzzRow& r : rows) {
    std::snprintf(line, sizeof line, "%-18s %11llu %11llu %7.1f%s", r.reader.c_str(),
                  static_cast<unsigned long long>(r.inputs),
                  static_cast<unsigned long long>(r.accepted), r.cpu_s,
                  r.fault.empty() ? "" : "  FAULT: ");
    out << line << r.fault << "\n";
  }
  teletact::print(out, limits());
}

std::vector<Limit> FuzzResult::limits() const {
  Limits all;
  all.add("faults", faults(), "<=", 0);
  return all.all();
}

std::vector<BenchMetric> FuzzResult::metrics() const {
  std::vector<BenchMetric> m;
  for (const FuzzRow& r : rows) {
    m.push_back({"fuzz." + r.reader + ".inputs", static_cast<double>(r.inputs), "1"});
    m.push_back({"fuzz." + r.reader + ".cpu_s", r.cpu_s, "s"});
  }
  m.push_back({"fuzz.faults", static_cast<double>(faults()), "1"});
  return m;
}

}  // namespace teletact
