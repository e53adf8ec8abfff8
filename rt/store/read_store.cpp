#include "rt/store/read_store.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <map>
#include <sstream>
#include <utility>

#include "rt/audit/run_file.hpp"
#include "rt/store/bytes.hpp"
#include "rt/store/store_disk.hpp"
#include "rt/store/store_files.hpp"

namespace rt {

namespace {

namespace fs = std::filesystem;

bool read_block(ByteReader r, RunLog& log, std::vector<StoreEvent>& events,
                std::uint64_t& records) {
  JobRecord job;
  SentinelRecord sample;
  std::uint8_t tag = 0;
  while (r.left() > 0 && r.raw(&tag, 1)) {
    if (tag == 'J' && r.raw(&job, sizeof job)) {
      if (TaskLog* t = log.find(job.task); t != nullptr && job.level < t->spec.levels()) {
        t->jobs.push_back(job);
        ++records;
      }
    } else if (tag == 'S' && r.raw(&sample, sizeof sample)) {
      log.sentinels.push_back(sample);
    } else if (tag == 'E') {
      StoreEvent e;
      e.time_ns = r.i64();
      std::uint8_t size = 0;
      (void)r.raw(&size, 1);
      e.text = r.text(size);
      if (r.good()) events.push_back(std::move(e));
    } else {
      r.fail();
    }
  }
  return r.good();
}

Result<RunLog> read_header(const std::string& folder) {
  const auto bytes = read_bytes(folder + "/header");
  const std::string text(bytes.begin(), bytes.end());
  const std::string name = folder + "/header";
  if (text.empty()) return Error{name + ": can not be read"};
  std::istringstream in(text);
  std::string line;
  std::getline(in, line);
  std::ostringstream expected;
  expected << kStoreTitle << sizeof(JobRecord) << ' ' << sizeof(SentinelRecord);
  if (line != expected.str()) return Error{name + ":1: not a store of this version"};
  RunLog log;
  for (int number = 2; std::getline(in, line); ++number) {
    if (line.rfind("crc ", 0) == 0) {
      const std::size_t end = text.rfind("crc ");
      const auto crc = store_crc(std::span(bytes).first(end));
      if (line != "crc " + std::to_string(crc)) return Error{name + ": wrong CRC"};
      return log;
    }
    if (!parse_run_header_line(line, log))
      return Error{name + ":" + std::to_string(number) + ": not a header line"};
  }
  return Error{name + ": torn"};
}

void read_end(const std::string& folder, RunLog& log) {
  const auto bytes = read_bytes(folder + "/end");
  if (bytes.empty()) return;
  ByteReader r(bytes);
  const bool ours = r.u32() == kEndMagic && r.u32() == kSegmentVersion;
  const std::uint32_t tasks = r.u32();
  const std::uint32_t crc = r.u32();
  if (!ours || !r.good() || crc != store_crc(std::span(bytes).last(r.left()))) {
    log.told.emplace_back("the store's end is damaged: totals are those of the records");
    return;
  }
  for (std::uint32_t i = 0; i < tasks && r.good(); ++i) {
    TaskTotals t;
    TaskLog* task = log.find(static_cast<std::uint16_t>(r.u32()));
    for (std::uint64_t* n : {&t.completed, &t.late, &t.aborted, &t.skipped, &t.lost}) *n = r.u64();
    t.level = static_cast<int>(r.i64());
    if (task != nullptr && r.good()) task->totals = t;
  }
  log.dropped = r.u64();
  if (const std::uint64_t n = r.u64(); n > 0 && r.good())
    log.told.push_back(std::to_string(n) +
                       " records were not written, the disk was full: they are counted");
}

// Records outside the piece go, and what is only known of the whole run.
void crop_log(RunLog& log, std::int64_t epoch_ns, const StorePiece& piece) {
  const auto outside = [&](std::int64_t ns) {
    const double s = 1e-9 * static_cast<double>(ns - epoch_ns);
    return s < piece.from_s || s >= piece.to_s;
  };
  for (TaskLog& t : log.tasks) {
    std::erase_if(t.jobs, [&](const JobRecord& r) { return outside(r.release_ns); });
    t.totals.reset();
  }
  std::erase_if(log.sentinels, [&](const SentinelRecord& s) { return outside(s.release_ns); });
  log.dropped = 0;
}

// The files of one store and what of them is wanted.
class StoreReader {
 public:
  StoreReader(std::string folder, const StorePiece& piece, StoreLog& out)
      : folder_(std::move(folder)), piece_(piece), out_(out) {}

  void run() {
    list();
    find_epoch();
    for (const Row& row : parts_) take(row);
    for (const auto& [number, file] : wholes_) {
      if (!covered(number)) (void)take_whole(file, number == wholes_.rbegin()->first);
    }
    for (auto& [id, past] : pasts_)
      out_.log.find(id)->past = std::make_shared<const TaskPast>(std::move(past));
    crop();
    tell();
  }

 private:
  struct Row {
    StoreFile file;
    std::int64_t from_ns = 0, to_ns = 0;
    bool readable = false;
    std::string error;
  };
  struct Segment {
    RunLog log;
    std::vector<StoreEvent> events;
    std::uint64_t records = 0;
  };

  void list() {
    std::error_code error;
    std::vector<StoreFile> parts;
    for (const auto& entry : fs::directory_iterator(folder_, error)) {
      const auto f = store_file_of(entry.path().filename().string());
      if (!f) continue;
      ++out_.files;
      if (f->whole)
        wholes_[f->first] = *f;
      else
        parts.push_back(*f);
    }
    // Of parts that overlap after a kill the longest holds what the others do.
    std::sort(parts.begin(), parts.end(), [](const StoreFile& a, const StoreFile& b) {
      return a.first != b.first ? a.first < b.first : a.last > b.last;
    });
    std::int64_t covered_to = -1;
    for (const StoreFile& f : parts) {
      if (std::int64_t{f.first} <= covered_to) continue;
      const auto head = decode_part_head(read_bytes(path(f)));
      if (!head && wholes_.count(f.first) > 0) continue;
      covered_to = f.last;
      Row& row = parts_.emplace_back();
      row.file = f;
      row.readable = head.has_value();
      if (!head) row.error = head.error();
      if (head) row.from_ns = head.value().from_ns;
      if (head) row.to_ns = head.value().to_ns;
    }
  }
  [[nodiscard]] std::string path(const StoreFile& f) const { return folder_ + "/" + f.name(); }
  [[nodiscard]] bool covered(std::uint32_t segment) const {
    const auto after =
        std::upper_bound(parts_.begin(), parts_.end(), segment,
                         [](std::uint32_t n, const Row& row) { return n < row.file.first; });
    return after != parts_.begin() && (after - 1)->file.last >= segment;
  }

  // False: not whole to the end.
  bool read_into(const StoreFile& f, Segment& s) const {
    for (const TaskLog& t : out_.log.tasks) {
      s.log.tasks.emplace_back();
      s.log.tasks.back().spec = t.spec;
      s.log.tasks.back().id = t.id;
    }
    return read_segment(read_bytes(path(f)), s.log, s.events, s.records);
  }

  void find_epoch() {
    epoch_ = out_.log.epoch_ns;
    for (const Row& row : parts_) newest_ = std::max(newest_, row.to_ns);
    if (epoch_ != 0) return;
    if (!parts_.empty()) {
      epoch_ = parts_.front().from_ns;
    } else if (!wholes_.empty()) {
      Segment s;
      (void)read_into(wholes_.begin()->second, s);
      epoch_ = std::numeric_limits<std::int64_t>::max();
      for (const TaskLog& t : s.log.tasks) {
        if (!t.jobs.empty()) epoch_ = std::min(epoch_, t.jobs.front().release_ns);
      }
    }
  }
  [[nodiscard]] double since_epoch(std::int64_t ns) const {
    return 1e-9 * static_cast<double>(ns - epoch_);
  }

  void take(const Row& row) {
    const bool outside = row.readable && (since_epoch(row.to_ns) < piece_.from_s ||
                                          since_epoch(row.from_ns) >= piece_.to_s);
    if (outside) return;
    const bool wanted = 1e-9 * static_cast<double>(newest_ - row.to_ns) < piece_.whole_s;
    const auto whole = wholes_.find(row.file.first);
    if (whole != wholes_.end() && row.file.segments() == 1 && wanted) {
      if (take_whole(whole->second, false)) return;
    }
    take_part(row);
  }

  // False: nothing is taken, for the file is damaged and the segment has a part.
  bool take_whole(const StoreFile& f, bool newest) {
    Segment s;
    if (!read_into(f, s)) {
      const std::string name = "segment " + std::to_string(f.first) + " is damaged: ";
      if (covered(f.first)) {
        out_.log.told.push_back(name + "its counts and histograms are used");
        return false;
      }
      if (!newest) out_.log.told.push_back(name + "read in part");
    }
    out_.whole_records += s.records;
    for (std::size_t i = 0; i < s.log.tasks.size(); ++i) {
      auto& to = out_.log.tasks[i].jobs;
      to.insert(to.end(), s.log.tasks[i].jobs.begin(), s.log.tasks[i].jobs.end());
    }
    auto& samples = out_.log.sentinels;
    samples.insert(samples.end(), s.log.sentinels.begin(), s.log.sentinels.end());
    for (StoreEvent& e : s.events) out_.events.push_back(std::move(e));
    return true;
  }

  void take_part(const Row& row) {
    auto read = row.readable ? decode_part(read_bytes(path(row.file))) : Error{row.error};
    if (!read) {
      out_.log.told.push_back(row.file.name() + ": " + read.error() + ", left out");
      return;
    }
    Part part = std::move(read).value();
    if (!part.tasks.empty()) {
      counted_from_ = std::min(counted_from_, part.from_ns);
      counted_to_ = std::max(counted_to_, part.to_ns);
    }
    for (auto& [id, past] : part.tasks) {
      const TaskLog* task = out_.log.find(id);
      if (task == nullptr) continue;
      const int levels = task->spec.levels();
      std::erase_if(past.events,
                    [&](const JobRecord& r) { return r.task != id || r.level >= levels; });
      out_.part_records += past.jobs;
      pasts_[id].merge(past);
    }
    for (auto& [core, histogram] : part.sentinels) out_.log.past_sentinels[core].merge(histogram);
    for (StoreEvent& e : part.events) out_.events.push_back(std::move(e));
  }

  // Records outside the piece go.
  void crop() {
    std::stable_sort(out_.events.begin(), out_.events.end(),
                     [](const auto& a, const auto& b) { return a.time_ns < b.time_ns; });
    if (piece_.all()) return;
    crop_log(out_.log, epoch_, piece_);
    std::erase_if(out_.events, [&](const StoreEvent& e) {
      const double s = since_epoch(e.time_ns);
      return s < piece_.from_s || s >= piece_.to_s;
    });
  }

  void tell() {
    if (out_.part_records == 0) return;
    char text[200];
    std::snprintf(text, sizeof text,
                  "%llu jobs from %.1f to %.1f s are counts and histograms (quantiles within 1.6 "
                  "%%), %llu are whole",
                  static_cast<unsigned long long>(out_.part_records), since_epoch(counted_from_),
                  since_epoch(counted_to_), static_cast<unsigned long long>(out_.whole_records));
    out_.log.told.emplace_back(text);
  }

  std::string folder_;
  StorePiece piece_;
  StoreLog& out_;
  std::map<std::uint32_t, StoreFile> wholes_;
  std::vector<Row> parts_;  // in order, none within another
  std::map<std::uint16_t, TaskPast> pasts_;
  std::int64_t epoch_ = 0, newest_ = std::numeric_limits<std::int64_t>::min();
  std::int64_t counted_from_ = std::numeric_limits<std::int64_t>::max();
  std::int64_t counted_to_ = std::numeric_limits<std::int64_t>::min();
};

}  // namespace

bool read_segment(std::span<const std::uint8_t> bytes, RunLog& log, std::vector<StoreEvent>& events,
                  std::uint64_t& records) {
  ByteReader r(bytes);
  if (r.u32() != kSegmentMagic || r.u32() != kSegmentVersion || !r.good()) return false;
  (void)r.u32();
  (void)r.u32();
  while (r.good() && r.left() > 0) {
    if (r.u32() != kBlockMagic) return false;
    const std::uint32_t size = r.u32();
    const std::uint32_t crc = r.u32();
    if (!r.good() || size > r.left()) return false;
    const auto payload = bytes.subspan(bytes.size() - r.left(), size);
    if (crc != store_crc(payload)) return false;
    if (!read_block(ByteReader(payload), log, events, records)) return false;
    r.skip(size);
  }
  return r.good();
}

bool is_store(const std::string& path) {
  std::error_code error;
  return fs::is_regular_file(path + "/header", error);
}

Result<StoreLog> read_store(const std::string& folder, const StorePiece& piece) {
  auto header = read_header(folder);
  if (!header) return Error{header.error()};
  StoreLog out;
  out.log = std::move(header).value();
  read_end(folder, out.log);
  StoreReader(folder, piece, out).run();
  sort_jobs(out.log);
  return out;
}

Result<RunLog> read_run(const std::string& path, const StorePiece& piece) {
  std::error_code error;
  if (fs::is_directory(path, error)) {
    auto store = read_store(path, piece);
    if (!store) return Error{store.error()};
    return std::move(store).value().log;
  }
  auto log = read_run_file(path);
  if (!log || piece.all()) return log;
  std::int64_t epoch = log.value().epoch_ns;
  if (epoch == 0) {
    epoch = std::numeric_limits<std::int64_t>::max();
    for (const TaskLog& t : log.value().tasks) {
      if (!t.jobs.empty()) epoch = std::min(epoch, t.jobs.front().release_ns);
    }
  }
  crop_log(log.value(), epoch, piece);
  return log;
}

std::uint64_t store_bytes(const std::string& folder) {
  std::uint64_t sum = 0;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder, error)) {
    const auto size = entry.file_size(error);
    if (!error) sum += size;
  }
  return sum;
}

}  // namespace rt
