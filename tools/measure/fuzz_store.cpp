// The readers of a run's job records: the store's parts and segments, its header.
#include <filesystem>
#include <fstream>

#include "rt/random.hpp"
#include "rt/store/read_store.hpp"
#include "rt/store/run_store.hpp"
#include "tools/measure/fuzz_readers.hpp"

namespace teletact {
namespace {

constexpr std::size_t kPartCrcAt = 40, kSegmentHead = 16, kBlockHead = 12;

rt::RunLog store_header() {
  rt::RunLog log;
  rt::TaskLog t;
  t.spec.name = "haptic";
  t.spec.rate = {1000, 1};
  t.spec.deadline = rt::Nanos{1000000};
  t.spec.budget = rt::Nanos{100000};
  log.tasks = {t};
  return log;
}

std::span<const std::uint8_t> bytes_of(const std::string& b) {
  return {reinterpret_cast<const std::uint8_t*>(b.data()), b.size()};
}

void put_u32(std::string& b, std::size_t at, std::uint32_t v) {
  for (unsigned i = 0; i < 4; ++i) b[at + i] = static_cast<char>((v >> (8 * i)) & 0xffU);
}

void seal_part(std::string& b) {
  if (b.size() < kPartCrcAt + 4) return;
  put_u32(b, kPartCrcAt,
          rt::store_crc(bytes_of(b).first(kPartCrcAt), bytes_of(b).subspan(kPartCrcAt + 4)));
}

// The CRC of every block, as far as the lengths lead.
void seal_segment(std::string& b) {
  for (std::size_t at = kSegmentHead; at + kBlockHead <= b.size();) {
    std::uint32_t size = 0;
    for (unsigned i = 0; i < 4; ++i) size |= std::uint32_t{bytes_of(b)[at + 4 + i]} << (8 * i);
    if (size > b.size() - at - kBlockHead) return;
    put_u32(b, at + 8, rt::store_crc(bytes_of(b).subspan(at + kBlockHead, size)));
    at += kBlockHead + size;
  }
}

// Two segments.
void write_store(const std::string& folder, const rt::RunLog& header) {
  rt::StoreOptions options;
  options.segment_s = 0.2;
  options.block_bytes = 2000;
  rt::RunStore store(folder, header, options);
  rt::Random random(9);
  for (std::uint64_t k = 0; k < 400; ++k) {
    rt::JobRecord r;
    r.k = k;
    r.release_ns = 1000000000 + static_cast<std::int64_t>(k) * 1000000;
    r.deadline_ns = r.release_ns + 1000000;
    r.start_ns = r.release_ns + static_cast<std::int64_t>(random.uniform() * 4e5);
    r.cpu_ns = static_cast<std::int64_t>(random.uniform() * 8e5);
    r.end_ns = r.start_ns + r.cpu_ns;
    store.add(r);
    store.add(rt::SentinelRecord{r.release_ns, r.start_ns - r.release_ns, 0});
  }
  store.event(1100000000, "mode engaged");
  store.finish({{0, {400, 0, 0, 0, 0, 0}}}, 0);
}

std::string file(const std::filesystem::path& path) {
  const auto b = rt::read_bytes(path.string());
  return {b.begin(), b.end()};
}

}  // namespace

void FuzzReaders::add_store() {
  const std::filesystem::path folder = folder_ / "store";
  const rt::RunLog header = store_header();
  write_store(folder.string(), header);
  const std::string part = file(folder / "part-00000000-00000000"),
                    whole = file(folder / "whole-00000000"),
                    newest = file(folder / "whole-00000001"), head = file(folder / "header");
  readers_.push_back({"store_part",
                      {part, file(folder / "part-00000001-00000001")},
                      [](const std::string& b) -> rt::Result<bool> {
                        auto read = rt::decode_part(bytes_of(b));
                        if (!read) return rt::Error{read.error()};
                        return true;
                      },
                      seal_part,
                      false});
  readers_.push_back({"store_segment",
                      {whole, newest},
                      [header](const std::string& b) -> rt::Result<bool> {
                        rt::RunLog log = header;
                        std::vector<rt::StoreEvent> events;
                        std::uint64_t records = 0;
                        if (rt::read_segment(bytes_of(b), log, events, records)) return true;
                        return rt::Error{"a segment that does not end with a whole block"};
                      },
                      seal_segment,
                      false});
  readers_.push_back({"store_header",
                      {head},
                      [folder](const std::string& b) -> rt::Result<bool> {
                        std::ofstream(folder / "header", std::ios::binary | std::ios::trunc) << b;
                        auto read = rt::read_store(folder.string());
                        if (!read) return rt::Error{read.error()};
                        return true;
                      },
                      [](std::string& b) {
                        const std::size_t end = b.rfind("crc ");
                        if (end == std::string::npos) return;
                        const auto crc = rt::store_crc(bytes_of(b).first(end));
                        b = b.substr(0, end) + "crc " + std::to_string(crc) + "\n";
                      },
                      true});
}

}  // namespace teletact
