#include "rt/store/run_store.hpp"

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <stdexcept>
#include <system_error>
#include <utility>

#include "rt/store/bytes.hpp"

namespace rt {

namespace {

// Of the next segment, before the last one is folded: samples of the sentinel come later than jobs.
constexpr std::int64_t kFoldDelay_ns = 1000000000;
constexpr std::size_t kBlockHead = 12, kSegmentHead = 16;

std::span<const std::uint8_t> bytes_of(const std::string& text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

std::unique_ptr<StoreDisk> empty_folder(const std::string& folder) {
  std::error_code ignored;
  if (std::filesystem::is_regular_file(folder, ignored))  // a run of an older program
    std::filesystem::remove(folder, ignored);
  auto disk = open_store_folder(folder);
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    const std::string name = entry.path().filename();
    if (is_store_file(name)) (void)disk->remove(name);
  }
  return disk;
}

}  // namespace

RunStore::RunStore(const std::string& folder, const RunLog& header, const StoreOptions& options)
    : disk_(empty_folder(folder)), options_(options), folder_(header), cap_(options.cap_bytes) {
  begin(header);
}

RunStore::RunStore(std::unique_ptr<StoreDisk> disk, const RunLog& header,
                   const StoreOptions& options)
    : disk_(std::move(disk)), options_(options), folder_(header), cap_(options.cap_bytes) {
  begin(header);
}

RunStore::~RunStore() { flush(); }

void RunStore::begin(const RunLog& header) {
  if (options_.cap_bytes < StoreOptions::kLeastCap || !(options_.segment_s >= 0.1))
    throw std::runtime_error("store: a cap of at least 32 MiB and segments of at least 0.1 s");
  for (const TaskLog& t : header.tasks) ids_.push_back(t.id);
  open_.jobs.resize(ids_.size());
  waiting_.jobs.resize(ids_.size());
  std::string text = kStoreTitle + std::to_string(sizeof(JobRecord)) + ' ' +
                     std::to_string(sizeof(SentinelRecord)) + '\n' + run_header_lines(header);
  text += "crc " + std::to_string(store_crc(bytes_of(text))) + '\n';
  fixed_bytes_ = text.size();
  if (!disk_->replace("header", bytes_of(text))) disk_refused("header");
}

void RunStore::Segment::begin_anew(std::uint32_t number_) {
  number = number_;
  from_ns = 0;
  bytes = records = 0;
  broken = false;
  for (auto& of_task : jobs) of_task.clear();
  sentinels.clear();
  events.clear();
}

// The segment that a record of this release belongs to.
RunStore::Segment& RunStore::take(std::int64_t release_ns) {
  if (open_.records > 0 &&
      (static_cast<double>(release_ns - open_.from_ns) >= 1e9 * options_.segment_s ||
       open_.bytes + block_.size() >= kSegmentBytes)) {
    roll();
  }
  if (open_.records == 0) open_.from_ns = release_ns;
  ++open_.records;
  if (has_waiting_ && release_ns - open_.from_ns >= kFoldDelay_ns) fold_waiting();
  return open_;
}

void RunStore::add(const JobRecord& record) noexcept {
  const std::lock_guard lock(mutex_);
  Segment& segment = take(record.release_ns);
  const auto row = std::find(ids_.begin(), ids_.end(), record.task);
  if (row == ids_.end()) return;
  segment.jobs[static_cast<std::size_t>(row - ids_.begin())].push_back(record);
  const auto* p = reinterpret_cast<const std::uint8_t*>(&record);
  block_.push_back('J');
  block_.insert(block_.end(), p, p + sizeof record);
  if (block_.size() >= options_.block_bytes) write_block();
}

void RunStore::add(const SentinelRecord& record) noexcept {
  const std::lock_guard lock(mutex_);
  take(record.release_ns).sentinels.push_back(record);
  const auto* p = reinterpret_cast<const std::uint8_t*>(&record);
  block_.push_back('S');
  block_.insert(block_.end(), p, p + sizeof record);
  if (block_.size() >= options_.block_bytes) write_block();
}

void RunStore::event(std::int64_t time_ns, std::string_view text) noexcept {
  const std::lock_guard lock(mutex_);
  text = text.substr(0, StoreEvent::kMaxText);
  open_.events.push_back({time_ns, std::string(text)});
  ByteWriter w;
  w.i64(time_ns);
  block_.push_back('E');
  block_.insert(block_.end(), w.bytes().begin(), w.bytes().end());
  block_.push_back(static_cast<std::uint8_t>(text.size()));
  block_.insert(block_.end(), text.begin(), text.end());
  if (block_.size() >= options_.block_bytes) write_block();
}

RunStore::Use RunStore::use() const noexcept {
  const std::lock_guard lock(mutex_);
  return {bytes(), most_bytes_, files_.size(), unwritten_};
}

std::string RunStore::problem() const {
  const std::lock_guard lock(mutex_);
  return problem_;
}

void RunStore::flush() noexcept {
  const std::lock_guard lock(mutex_);
  if (!block_.empty()) write_block();
}

void RunStore::finish(const std::vector<RunFileTotals>& totals, std::uint64_t dropped) noexcept {
  const std::lock_guard lock(mutex_);
  if (has_waiting_) fold_waiting();
  roll();
  fold_waiting();
  ByteWriter w;
  for (const RunFileTotals& t : totals) {
    w.u32(t.task);
    for (const std::uint64_t n :
         {t.totals.completed, t.totals.late, t.totals.aborted, t.totals.skipped, t.totals.lost})
      w.u64(n);
    w.i64(t.totals.level);
  }
  w.u64(dropped);
  w.u64(unwritten_);
  ByteWriter file;
  file.u32(kEndMagic);
  file.u32(kSegmentVersion);
  file.u32(static_cast<std::uint32_t>(totals.size()));
  file.u32(store_crc(w.bytes()));
  file.raw(w.bytes().data(), w.bytes().size());
  if (!disk_->replace("end", file.bytes())) disk_refused("end");
}

std::uint64_t RunStore::bytes() const noexcept {
  std::uint64_t sum = fixed_bytes_ + open_.bytes + (has_waiting_ ? waiting_.bytes : 0);
  for (const StoreFile& f : files_) sum += f.bytes;
  return sum;
}

void RunStore::disk_refused(std::string_view what) noexcept {
  if (problem_.empty()) {
    problem_ = "the disk refused the store's " + std::string(what) +
               ": the job records are thinned harder, the run goes on";
  }
}

void RunStore::write_block() noexcept {
  const StoreFile file{true, open_.number, open_.number, 0};
  ByteWriter w;
  if (open_.bytes == 0) {
    w.u32(kSegmentMagic);
    w.u32(kSegmentVersion);
    w.u32(open_.number);
    w.u32(0);
  }
  w.u32(kBlockMagic);
  w.u32(static_cast<std::uint32_t>(block_.size()));
  w.u32(store_crc(block_));
  w.raw(block_.data(), block_.size());
  block_.clear();
  if (!open_.broken) {
    const std::size_t n = w.bytes().size();
    bool done = disk_->append(file.name(), w.bytes());
    if (!done) {
      // What was written of the block is torn: the rest of this segment would lie behind it.
      disk_refused("records");
      open_.broken = true;
      cap_ = std::max(StoreOptions::kLeastCap, std::min(cap_, bytes()));
      (void)drop_oldest_whole();
    }
    open_.bytes += n;
    most_bytes_ = std::max(most_bytes_, bytes());
  }
}

void RunStore::roll() {
  if (!block_.empty()) write_block();
  if (has_waiting_) fold_waiting();
  std::swap(waiting_, open_);
  open_.begin_anew(waiting_.number + 1);
  has_waiting_ = true;
}

void RunStore::fold_waiting() {
  std::vector<SentinelRecord> around = before_;
  around.insert(around.end(), waiting_.sentinels.begin(), waiting_.sentinels.end());
  around.insert(around.end(), open_.sentinels.begin(), open_.sentinels.end());
  Part part = folder_.fold(waiting_.jobs, waiting_.sentinels, around);
  part.first = part.last = waiting_.number;
  for (StoreEvent& e : waiting_.events) part.add(std::move(e));
  if (held_)
    held_->merge(std::move(part));
  else
    held_ = std::move(part);
  if (waiting_.broken) {
    for (const auto& jobs : waiting_.jobs) unwritten_ += jobs.size();
    (void)disk_->remove(StoreFile{true, waiting_.number, waiting_.number, 0}.name());
  } else if (waiting_.bytes > 0) {
    files_.push_back({true, waiting_.number, waiting_.number, waiting_.bytes});
  }
  std::swap(before_, waiting_.sentinels);
  waiting_.begin_anew(0);
  has_waiting_ = false;
  write_held();
  thin();
}

void RunStore::write_held() {
  const StoreFile file{false, held_->first, held_->last, 0};
  const std::vector<std::uint8_t> bytes = encode_part(*held_);
  bool done = disk_->replace(file.name(), bytes);
  while (!done && drop_oldest_whole()) done = disk_->replace(file.name(), bytes);
  if (!done) return disk_refused("part");
  files_.push_back(file);
  files_.back().bytes = bytes.size();
  held_.reset();
  most_bytes_ = std::max(most_bytes_, this->bytes());
}

void RunStore::drop(std::size_t file) {
  (void)disk_->remove(files_[file].name());
  files_.erase(files_.begin() + static_cast<std::ptrdiff_t>(file));
}

// Of those whose part is written: nothing but records is lost.
bool RunStore::drop_oldest_whole() {
  for (std::size_t i = 0; i < files_.size(); ++i) {
    if (!files_[i].whole) continue;
    const bool kept = std::any_of(files_.begin(), files_.end(), [&](const StoreFile& f) {
      return !f.whole && f.first <= files_[i].first && files_[i].first <= f.last;
    });
    if (!kept) continue;
    drop(i);
    return true;
  }
  return false;
}

// Of the parts from `at` on, which are neighbours, one. False: the disk refused it.
bool RunStore::merge_from(std::size_t at, std::size_t count) {
  std::optional<Part> sum;
  std::vector<StoreFile> old;
  for (std::size_t i = at; i < files_.size() && old.size() < count; ++i) {
    if (files_[i].whole) continue;
    old.push_back(files_[i]);
    auto part = decode_part(disk_->read(files_[i].name()));
    if (!part) continue;  // damaged under our feet: what it held is lost
    if (sum)
      sum->merge(std::move(part).value());
    else
      sum = std::move(part).value();
  }
  StoreFile file{false, old.front().first, old.back().last, 0};
  if (sum) {
    sum->first = file.first;
    sum->last = file.last;
    const auto bytes = encode_part(*sum);
    if (!disk_->replace(file.name(), bytes)) return false;
    file.bytes = bytes.size();
  }
  std::erase_if(files_, [&](const StoreFile& f) {
    if (f.whole || f.first < file.first || f.last > file.last) return false;
    if (f.first != file.first || f.last != file.last) (void)disk_->remove(f.name());
    return true;
  });
  const auto place = std::find_if(files_.begin(), files_.end(),
                                  [&](const StoreFile& f) { return f.first > file.last; });
  if (sum) files_.insert(place, file);
  return true;
}

// Parts of one size beyond kKeepParts: the oldest kFan of them, which have no whole segment any
// more, become one. True: there was something to do, and it was done.
bool RunStore::merge_a_ladder_step() {
  const auto oldest_whole =
      std::find_if(files_.begin(), files_.end(), [](const StoreFile& f) { return f.whole; });
  const std::uint32_t end = oldest_whole == files_.end() ? open_.number : oldest_whole->first;
  std::map<std::uint32_t, std::pair<std::size_t, std::size_t>> sizes;  // segments: first, how many
  for (std::size_t i = 0; i < files_.size(); ++i) {
    if (files_[i].whole || files_[i].last >= end) continue;
    auto& row = sizes.try_emplace(files_[i].segments(), i, 0).first->second;
    ++row.second;
  }
  for (const auto& [segments, row] : sizes) {
    if (row.second > kKeepParts) return merge_from(row.first, kFan);
  }
  return false;
}

void RunStore::thin() {
  // What the newest segment may still grow to is kept free, so that the cap holds at every moment.
  const std::uint64_t room = 2 * kSegmentBytes;
  const auto full = [&] { return bytes() + room > cap_; };
  while (full() && drop_oldest_whole()) {
  }
  while (merge_a_ladder_step()) {
  }
  // Only parts are left, and there are too many: a run of nothing but events.
  while (full()) {
    const auto part =
        std::find_if(files_.begin(), files_.end(), [](const StoreFile& f) { return !f.whole; });
    const auto parts =
        std::count_if(files_.begin(), files_.end(), [](const StoreFile& f) { return !f.whole; });
    if (parts < 2) return;
    if (!merge_from(static_cast<std::size_t>(part - files_.begin()), kFan)) return;
  }
}

}  // namespace rt
