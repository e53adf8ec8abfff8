#include <zlib.h>

#include <utility>

#include "rt/store/bytes.hpp"
#include "rt/store/part.hpp"

namespace rt {

namespace {

constexpr std::uint32_t kPartMagic = 0x54504c54;  // "TLPT"
constexpr std::uint32_t kPartVersion = 1;
// More are no box's: a damaged count must not ask for memory.
constexpr std::size_t kMaxTasks = 256, kMaxCores = 1024;
constexpr std::size_t kPartHead = 4 + 4 + 4 + 4 + 8 + 8 + 8;  // before the CRC

void put_histogram(ByteWriter& w, const Histogram& h) {
  std::size_t used = 0;
  h.for_each_bucket([&](std::size_t, std::uint64_t) { ++used; });
  w.packed(used);
  if (used == 0) return;
  const Histogram::Ends e = h.ends();
  w.i64(e.min);
  w.i64(e.max);
  w.u64(e.sum_low);
  w.i64(e.sum_high);
  std::size_t next = 0;  // buckets in steps: small numbers
  h.for_each_bucket([&](std::size_t i, std::uint64_t n) {
    w.packed(i - next);
    w.packed(n);
    next = i + 1;
  });
}

void get_histogram(ByteReader& r, Histogram& h) {
  const std::size_t used = r.count(2);
  if (used == 0) return;
  Histogram::Ends e;
  e.min = r.i64();
  e.max = r.i64();
  e.sum_low = r.u64();
  e.sum_high = r.i64();
  std::uint64_t at = 0;
  for (std::size_t i = 0; i < used && r.good(); ++i) {
    const std::uint64_t step = r.packed();
    at += step;
    const std::uint64_t n = r.packed();
    if (step > Histogram::kBuckets || !h.put(static_cast<std::size_t>(at), n)) r.fail();
    ++at;
  }
  if (e.min > e.max) r.fail();
  h.put(e);
}

void put_signed(ByteWriter& w, const SignedHistogram& h) {
  put_histogram(w, h.above);
  put_histogram(w, h.below);
}
void get_signed(ByteReader& r, SignedHistogram& h) {
  get_histogram(r, h.above);
  get_histogram(r, h.below);
}

void put_past(ByteWriter& w, const TaskPast& p) {
  w.packed(p.jobs);
  w.i64(p.first_release_ns);
  w.i64(p.last_release_ns);
  w.packed(p.first_k);
  w.packed(p.last_k);
  w.i64(p.last_end_ns);
  w.packed(static_cast<std::uint64_t>(p.last_cause));
  w.packed(p.last_level);
  w.packed(p.last_fault);
  w.packed(static_cast<std::uint64_t>(p.last_severity));
  for (const std::uint64_t n : p.counts.late) w.packed(n);
  for (const std::uint64_t n : p.counts.misses) w.packed(n);
  for (const std::uint64_t n : {p.counts.late_total, p.counts.miss_total, p.counts.completed,
                                p.counts.aborted, p.counts.skipped})
    w.packed(n);
  for (const auto* h : {&p.lateness, &p.response, &p.cpu, &p.allocations}) put_histogram(w, *h);
  put_signed(w, p.slack);
  put_signed(w, p.late_minus_sentinel);
  w.packed(p.levels.size());
  for (const LevelPast& level : p.levels) {
    w.packed(level.jobs);
    w.packed(level.charged);
    put_histogram(w, level.cpu);
  }
  w.packed(p.inputs_seen);
  w.packed(p.newest_input);
  w.packed(p.events_left_out);
  w.packed(p.events.size());
  for (const JobRecord& e : p.events) w.raw(&e, sizeof e);
}

void get_past(ByteReader& r, TaskPast& p) {
  p.jobs = r.packed();
  p.begun = true;
  p.first_release_ns = r.i64();
  p.last_release_ns = r.i64();
  p.first_k = r.packed();
  p.last_k = r.packed();
  p.last_end_ns = r.i64();
  const std::uint64_t cause = r.packed();
  if (cause >= static_cast<std::uint64_t>(kCauses)) return r.fail();
  p.last_cause = static_cast<Cause>(cause);
  p.last_level = static_cast<std::uint8_t>(r.packed());
  p.last_fault = static_cast<std::uint16_t>(r.packed());
  p.last_severity = static_cast<Severity>(r.packed() & 0xffU);
  for (std::uint64_t& n : p.counts.late) n = r.packed();
  for (std::uint64_t& n : p.counts.misses) n = r.packed();
  for (std::uint64_t* n : {&p.counts.late_total, &p.counts.miss_total, &p.counts.completed,
                           &p.counts.aborted, &p.counts.skipped})
    *n = r.packed();
  for (auto* h : {&p.lateness, &p.response, &p.cpu, &p.allocations}) get_histogram(r, *h);
  get_signed(r, p.slack);
  get_signed(r, p.late_minus_sentinel);
  const std::size_t levels = r.count(3);
  if (levels > TaskPast::kMaxLevels) return r.fail();
  p.levels.resize(levels);
  for (LevelPast& level : p.levels) {
    level.jobs = r.packed();
    level.charged = r.packed();
    get_histogram(r, level.cpu);
  }
  p.inputs_seen = r.packed();
  p.newest_input = r.packed();
  p.events_left_out = r.packed();
  const std::size_t events = r.count(sizeof(JobRecord));
  if (events > TaskPast::kMaxEvents) return r.fail();
  p.events.resize(events);
  for (JobRecord& e : p.events) (void)r.raw(&e, sizeof e);
}

// Histograms that hold other numbers of jobs than the task had are no part of ours.
bool is_consistent(const TaskPast& p) noexcept {
  return p.lateness.count() == p.jobs && p.response.count() == p.jobs && p.cpu.count() == p.jobs &&
         p.slack.count() == p.jobs && p.counts.completed + p.counts.aborted == p.jobs;
}

void put_payload(ByteWriter& w, const Part& part) {
  w.packed(part.tasks.size());
  for (const auto& [id, past] : part.tasks) {
    w.packed(id);
    put_past(w, past);
  }
  w.packed(part.sentinels.size());
  for (const auto& [core, histogram] : part.sentinels) {
    w.packed(static_cast<std::uint64_t>(core));
    put_histogram(w, histogram);
  }
  w.packed(part.events_left_out);
  w.packed(part.events.size());
  for (const StoreEvent& e : part.events) {
    w.i64(e.time_ns);
    w.packed(e.text.size());
    w.raw(e.text.data(), e.text.size());
  }
}

void get_payload(ByteReader& r, Part& part) {
  const std::size_t tasks = r.count(64);
  if (tasks > kMaxTasks) return r.fail();
  for (std::size_t n = tasks; n > 0 && r.good(); --n) {
    const std::uint64_t id = r.packed();
    TaskPast past;
    get_past(r, past);
    if (id > 0xffffU || !is_consistent(past)) r.fail();
    if (r.good()) part.tasks[static_cast<std::uint16_t>(id)] = std::move(past);
  }
  const std::size_t cores = r.count(2);
  if (cores > kMaxCores) return r.fail();
  for (std::size_t n = cores; n > 0 && r.good(); --n) {
    const std::uint64_t core = r.packed();
    if (core > 0xffffU) r.fail();
    get_histogram(r, part.sentinels[static_cast<int>(core & 0xffffU)]);
  }
  part.events_left_out = r.packed();
  const std::size_t events = r.count(9);
  if (events > Part::kMaxEvents) r.fail();
  for (std::size_t i = 0; i < events && r.good(); ++i) {
    StoreEvent e;
    e.time_ns = r.i64();
    const std::size_t size = r.count(1);
    if (size > StoreEvent::kMaxText) r.fail();
    e.text = r.good() ? r.text(size) : std::string{};
    part.events.push_back(std::move(e));
  }
}

}  // namespace

std::uint32_t store_crc(std::span<const std::uint8_t> head,
                        std::span<const std::uint8_t> rest) noexcept {
  const auto more = [](uLong crc, std::span<const std::uint8_t> b) {
    return b.empty() ? crc : ::crc32_z(crc, b.data(), b.size());
  };
  return static_cast<std::uint32_t>(more(more(::crc32_z(0, nullptr, 0), head), rest));
}

std::vector<std::uint8_t> encode_part(const Part& part) {
  ByteWriter payload, file;
  put_payload(payload, part);
  file.u32(kPartMagic);
  file.u32(kPartVersion);
  file.u32(part.first);
  file.u32(part.last);
  file.i64(part.from_ns);
  file.i64(part.to_ns);
  file.u64(payload.bytes().size());
  file.u32(store_crc(file.bytes(), payload.bytes()));
  file.raw(payload.bytes().data(), payload.bytes().size());
  return std::move(file.bytes());
}

Result<Part> decode_part_head(std::span<const std::uint8_t> bytes) {
  ByteReader r(bytes);
  Part part;
  if (r.u32() != kPartMagic || !r.good()) return Error{"not a part of a store"};
  if (const std::uint32_t version = r.u32(); version != kPartVersion) {
    return Error{"part of version " + std::to_string(version) + ", this program reads " +
                 std::to_string(kPartVersion)};
  }
  part.first = r.u32();
  part.last = r.u32();
  part.from_ns = r.i64();
  part.to_ns = r.i64();
  const std::uint64_t size = r.u64();
  (void)r.u32();
  if (!r.good() || size != r.left() || part.first > part.last) return Error{"torn part"};
  return part;
}

Result<Part> decode_part(std::span<const std::uint8_t> bytes) {
  auto head = decode_part_head(bytes);
  if (!head) return head;
  ByteReader r(bytes);
  r.skip(kPartHead);
  const std::uint32_t crc = r.u32();
  if (crc != store_crc(bytes.first(kPartHead), bytes.last(r.left())))
    return Error{"part with a wrong CRC"};
  Part part = std::move(head).value();
  get_payload(r, part);
  if (!r.good() || r.left() != 0) return Error{"damaged part"};
  return part;
}

}  // namespace rt
