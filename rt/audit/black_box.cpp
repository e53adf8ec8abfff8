#include "rt/audit/black_box.hpp"

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <sstream>
#include <stdexcept>
#include <system_error>

#include "rt/audit/run_file.hpp"
#include "rt/hash.hpp"

namespace rt {

namespace {

constexpr const char* kTitle = "teletact-blackbox 1 ";
constexpr std::size_t kMaxRing = std::size_t{1} << 30U;

std::string sizes() {
  return std::to_string(sizeof(JobRecord)) + ' ' + std::to_string(sizeof(SentinelRecord));
}

std::uint32_t check_of(const BlackBoxWriter::Head& head, const std::byte* payload) noexcept {
  Hash64 h;
  h.word(head.number);
  h.word((static_cast<std::uint64_t>(head.tag) << 32U) | head.size);
  h.bytes(payload, head.size);
  return static_cast<std::uint32_t>(h.digest());
}

}  // namespace

BlackBoxWriter::BlackBoxWriter(const std::string& path, const RunLog& header, Nanos window,
                               std::size_t ring_bytes)
    : path_(path), ring_bytes_(std::clamp(ring_bytes / 8 * 8, 4 * kMaxPayload, kMaxRing)) {
  const std::string text = kTitle + sizes() + ' ' + std::to_string(window.count()) + ' ' +
                           std::to_string(ring_bytes_) + '\n' + run_header_lines(header) + '\n';
  if (text.size() > kStopAt) throw std::runtime_error(path + ": too many tasks for a black box");
  const int fd = ::open(path.c_str(), O_RDWR | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
  const std::size_t size = kRingAt + ring_bytes_;
  // A hole in the file would become SIGBUS on a full disk, in the midst of a run.
  int error = fd < 0 ? errno : ::posix_fallocate(fd, 0, static_cast<off_t>(size));
  if (error == 0) {
    void* map = ::mmap(nullptr, size, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_POPULATE, fd, 0);
    error = map == MAP_FAILED ? errno : 0;
    if (error == 0) map_ = static_cast<std::byte*>(map);
  }
  if (fd >= 0) ::close(fd);
  if (error != 0) {
    ::unlink(path.c_str());
    throw std::system_error(error, std::generic_category(), path + ": no black box");
  }
  std::memcpy(map_, text.data(), text.size());
}

BlackBoxWriter::~BlackBoxWriter() { ::munmap(map_, kRingAt + ring_bytes_); }

void BlackBoxWriter::put(char tag, const void* data, std::size_t size) noexcept {
  const std::lock_guard lock(mutex_);
  const std::size_t need = stored(size);
  std::byte* ring = map_ + kRingAt;
  if (at_ + need > ring_bytes_) {
    std::memset(ring + at_, 0, ring_bytes_ - at_);  // nothing of the last lap stays behind
    at_ = 0;
  }
  Head head;
  head.magic = kMagic;
  head.number = ++number_;
  head.size = static_cast<std::uint32_t>(size);
  head.tag = static_cast<unsigned char>(tag);
  head.check = check_of(head, static_cast<const std::byte*>(data));
  std::memcpy(ring + at_, &head, sizeof head);
  std::memcpy(ring + at_ + sizeof head, data, size);
  at_ += need;
}

void BlackBoxWriter::add(const JobRecord& record) noexcept { put('J', &record, sizeof record); }
void BlackBoxWriter::add(const SentinelRecord& record) noexcept {
  put('S', &record, sizeof record);
}
void BlackBoxWriter::add(char tag, std::span<const std::byte> payload) noexcept {
  put(tag, payload.data(), std::min(payload.size(), kMaxPayload));
}

void BlackBoxWriter::note_stop(std::string_view why) noexcept {
  auto* stop = reinterpret_cast<char*>(map_ + kStopAt);
  if (stop[0] != 0) return;
  const std::size_t n = std::min(why.size(), kStopSize - 1);
  // The first byte last: an empty reason or a whole one.
  for (std::size_t i = n; i-- > 0;) stop[i] = why[i];
}

bool BlackBoxWriter::copy_to(const std::string& path, std::string_view why) noexcept {
  std::FILE* file = std::fopen(path.c_str(), "wb");
  if (file == nullptr) return false;
  char stop[kStopSize] = {};
  std::memcpy(stop, why.data(), std::min(why.size(), kStopSize - 1));
  bool ok = false;
  {
    const std::lock_guard lock(mutex_);
    ok = std::fwrite(map_, kStopAt, 1, file) == 1 && std::fwrite(stop, kStopSize, 1, file) == 1 &&
         std::fwrite(map_ + kRingAt, ring_bytes_, 1, file) == 1;
  }
  return std::fclose(file) == 0 && ok;
}

void BlackBoxWriter::remove() noexcept { ::unlink(path_.c_str()); }

std::size_t black_box_size(const RunLog& header, Nanos window, double more_per_s) {
  double per_s = more_per_s;
  // A sentinel wakes at most at every release of its core.
  for (const auto& t : header.tasks) {
    const double hz = static_cast<double>(t.spec.rate.num) / static_cast<double>(t.spec.rate.den);
    per_s += hz * static_cast<double>(BlackBoxWriter::stored(sizeof(JobRecord)) +
                                      BlackBoxWriter::stored(sizeof(SentinelRecord)));
  }
  return static_cast<std::size_t>(1.25 * per_s * seconds(window)) + 65536;
}

bool is_black_box(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  std::string start(std::strlen(kTitle), '\0');
  in.read(start.data(), static_cast<std::streamsize>(start.size()));
  return in && start == kTitle;
}

namespace {

struct Found {
  std::uint64_t number;
  std::size_t at;
  std::uint32_t size;
  char tag;
};

// Every valid record of the ring, by number.
std::vector<Found> find_records(const std::vector<std::byte>& ring) {
  std::vector<Found> found;
  BlackBoxWriter::Head head;
  for (std::size_t at = 0; at + sizeof head <= ring.size();) {
    std::memcpy(&head, ring.data() + at, sizeof head);
    const bool fits = head.magic == BlackBoxWriter::kMagic &&
                      head.size <= BlackBoxWriter::kMaxPayload && head.tag < 128 &&
                      head.number != 0 && at + sizeof head + head.size <= ring.size();
    if (!fits || check_of(head, ring.data() + at + sizeof head) != head.check) {
      at += 8;
      continue;
    }
    found.push_back({head.number, at + sizeof head, head.size, static_cast<char>(head.tag)});
    at += BlackBoxWriter::stored(head.size);
  }
  std::sort(found.begin(), found.end(),
            [](const auto& a, const auto& b) { return a.number < b.number; });
  found.erase(std::unique(found.begin(), found.end(),
                          [](const auto& a, const auto& b) { return a.number == b.number; }),
              found.end());
  return found;
}

}  // namespace

Result<BlackBox> read_black_box(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in) return Error{path + ": can not be read"};
  std::string head(BlackBoxWriter::kRingAt, '\0');
  in.read(head.data(), static_cast<std::streamsize>(head.size()));
  const auto got = static_cast<std::size_t>(in.gcount());
  const std::string text = head.substr(0, std::min(got, BlackBoxWriter::kStopAt));
  std::istringstream lines(text);
  std::string line;
  std::getline(lines, line);
  BlackBox box;
  std::istringstream first(line);
  std::string title, version, job, sentinel;
  long long window = 0, ring_bytes = 0;
  first >> title >> version >> job >> sentinel >> window >> ring_bytes;
  if (!first || title + ' ' + version + ' ' != kTitle || job + ' ' + sentinel != sizes() ||
      window < 0 || ring_bytes < 0 || static_cast<std::size_t>(ring_bytes) > kMaxRing) {
    return Error{path + ":1: not a black box of this version"};
  }
  box.window = Nanos{window};
  for (int number = 2;; ++number) {
    if (!std::getline(lines, line)) return Error{path + ": the header ends early"};
    if (line.empty()) break;
    if (!parse_run_header_line(line, box.log))
      return Error{path + ":" + std::to_string(number) + ": not a header line"};
  }
  if (got > BlackBoxWriter::kStopAt) {
    for (std::size_t i = BlackBoxWriter::kStopAt; i < got && head[i] != 0; ++i)
      box.stop += head[i] >= 0x20 && head[i] < 0x7f ? head[i] : '?';
  }
  std::vector<std::byte> ring(static_cast<std::size_t>(ring_bytes));
  in.read(reinterpret_cast<char*>(ring.data()), ring_bytes);
  ring.resize(static_cast<std::size_t>(std::max<std::streamsize>(in.gcount(), 0)));
  const auto found = find_records(ring);
  for (const auto& f : found) {
    const std::byte* p = ring.data() + f.at;
    if (f.tag == 'J' && f.size == sizeof(JobRecord)) {
      JobRecord r;
      std::memcpy(&r, p, sizeof r);
      if (TaskLog* t = box.log.find(r.task); t != nullptr && r.level < t->spec.levels())
        t->jobs.push_back(r);
    } else if (f.tag == 'S' && f.size == sizeof(SentinelRecord)) {
      box.log.sentinels.emplace_back();
      std::memcpy(&box.log.sentinels.back(), p, sizeof(SentinelRecord));
    } else if (f.tag != 'J' && f.tag != 'S') {
      box.entries.push_back({f.tag, {p, p + f.size}});
    }
  }
  box.records = found.size();
  if (!found.empty()) box.missing = found.back().number - found.front().number + 1 - found.size();
  sort_jobs(box.log);
  return box;
}

}  // namespace rt
