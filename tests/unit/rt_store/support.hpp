// A made-up run whose every record is also kept in memory, and disks that fail.
#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "rt/audit/run_log.hpp"
#include "rt/random.hpp"
#include "rt/store/run_store.hpp"

namespace store_test {

namespace fs = std::filesystem;

class Folder {
 public:
  explicit Folder(const std::string& name = "")
      : path_(fs::temp_directory_path() /
              ("teletact_store_" + std::to_string(::getpid()) + "_" +
               testing::UnitTest::GetInstance()->current_test_info()->name() + name)) {
    fs::remove_all(path_);
  }
  ~Folder() { fs::remove_all(path_); }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  [[nodiscard]] std::string path() const { return path_.string(); }
  [[nodiscard]] std::vector<std::string> names(const std::string& start) const {
    std::vector<std::string> out;
    for (const auto& e : fs::directory_iterator(path_)) {
      const std::string name = e.path().filename();
      if (name.rfind(start, 0) == 0) out.push_back(name);
    }
    std::sort(out.begin(), out.end());
    return out;
  }

 private:
  fs::path path_;
};

inline constexpr std::int64_t kEpoch = 5000000000;

inline rt::TaskLog task(std::uint16_t id, const std::string& name, std::int64_t rate, int core) {
  rt::TaskLog t;
  t.id = id;
  t.spec.name = name;
  t.spec.rate = {rate, 1};
  t.spec.deadline = rt::Nanos{1000000000 / rate};
  t.core = core;
  const std::int64_t budget = 300000000 / rate;
  t.spec.variants = {{"full", rt::Nanos{budget}}, {"less", rt::Nanos{budget / 2}}};
  t.spec.budget = rt::Nanos{budget};
  t.work_max = 1000;
  return t;
}

inline rt::RunLog header() {
  rt::RunLog log;
  log.tasks = {task(0, "haptic", 1000, 0), task(3, "supervision", 100, 0),
               task(7, "fusion", 30, 1)};
  log.epoch_ns = kEpoch;
  return log;
}

// Records in the order in which a drain hands them over: by a job's end, samples a little late.
class MadeUpRun {
 public:
  explicit MadeUpRun(std::uint64_t seed, bool calm = false)
      : all_(header()), random_(seed), calm_(calm) {}

  // So many seconds more, into `store` and into the log of everything.
  template <class Store>
  void run(Store& store, double seconds) {
    const std::int64_t until = now_ + static_cast<std::int64_t>(seconds * 1e9);
    for (; now_ < until; now_ += 1000000) {
      for (std::size_t i = 0; i < all_.tasks.size(); ++i) step(store, i);
      for (int core = 0; core < 2; ++core) sample(store, core);
    }
  }
  [[nodiscard]] const rt::RunLog& all() const noexcept { return all_; }
  [[nodiscard]] std::uint64_t jobs() const {
    std::uint64_t n = 0;
    for (const auto& t : all_.tasks) n += t.jobs.size();
    return n;
  }

 private:
  struct State {
    std::uint64_t k = 0;
    std::int64_t end = 0;
    std::uint8_t level = 0;
    std::uint64_t frame = 0;
  };

  template <class Store>
  void step(Store& store, std::size_t i) {
    rt::TaskLog& t = all_.tasks[i];
    State& s = states_[i];
    const std::int64_t period = t.spec.period().count();
    std::int64_t release = kEpoch + static_cast<std::int64_t>(s.k) * period;
    if (release > now_) return;
    rt::JobRecord r;
    const bool odd = !calm_ && random_.uniform() < 0.02;
    r.task = t.id;
    if (odd && random_.uniform() < 0.3) {
      r.skipped = 1 + static_cast<std::uint32_t>(random_.uniform() * 3);
      s.k += r.skipped;
      release += r.skipped * period;
    }
    r.k = s.k++;
    r.release_ns = release;
    r.deadline_ns = release + period;
    if (odd && random_.uniform() < 0.1) s.level = s.level == 0 ? 1 : 0;
    r.level = s.level;
    const double wait = odd ? 0.6 : 0.02, load = odd ? 1.2 : 0.25;
    r.start_ns = std::max(release, s.end) +
                 static_cast<std::int64_t>(random_.uniform() * wait * static_cast<double>(period));
    r.cpu_ns = static_cast<std::int64_t>(random_.uniform() * load * static_cast<double>(period));
    r.end_ns = r.start_ns + r.cpu_ns + (odd ? period / 10 : 0);
    r.run_delay_ns = odd && random_.uniform() < 0.5 ? r.start_ns - release : 0;
    r.work = random_.uniform() < 0.5 ? 500 : 2000;
    r.core = static_cast<std::uint8_t>(t.core);
    r.voluntary = random_.uniform() < 0.9 ? 1 : 2;
    r.outcome = odd && random_.uniform() < 0.1 ? rt::Outcome::kAborted : rt::Outcome::kCompleted;
    r.fault = odd && random_.uniform() < 0.2 ? 42 : rt::kNoFault;
    r.allocations = static_cast<std::int32_t>(random_.uniform() * 5) - 1;
    if (random_.uniform() < 0.7) s.frame += 1 + static_cast<std::uint64_t>(random_.uniform() * 2);
    r.input_seq[0] = s.frame;
    s.end = r.end_ns;
    t.jobs.push_back(r);
    store.add(r);
  }
  template <class Store>
  void sample(Store& store, int core) {
    const std::int64_t release = now_ - 3000000;  // handed over later than its jobs
    if (release < kEpoch) return;
    rt::SentinelRecord s;
    s.release_ns = release;
    s.core = static_cast<std::uint16_t>(core);
    s.late_ns =
        static_cast<std::int64_t>(random_.uniform() * (random_.uniform() < 0.01 ? 3e6 : 2e4));
    all_.sentinels.push_back(s);
    store.add(s);
  }

  rt::RunLog all_;
  rt::Random random_;
  bool calm_;
  State states_[3];
  std::int64_t now_ = kEpoch;
};

// A folder that refuses to grow beyond so many bytes.
class SmallDisk final : public rt::StoreDisk {
 public:
  SmallDisk(const std::string& folder, std::uint64_t limit)
      : folder_(folder), disk_(rt::open_store_folder(folder)), limit_(limit) {}
  void grow(std::uint64_t limit) { limit_ = limit; }
  [[nodiscard]] std::uint64_t used() const {
    std::uint64_t sum = 0;
    for (const auto& e : fs::directory_iterator(folder_)) sum += e.file_size();
    return sum;
  }

  bool append(const std::string& name, std::span<const std::uint8_t> bytes) noexcept override {
    const std::uint64_t room = limit_ - std::min(limit_, used());
    // As a real one: what fits is there.
    const auto fits = bytes.first(std::min<std::size_t>(bytes.size(), room));
    return disk_->append(name, fits) && fits.size() == bytes.size();
  }
  bool replace(const std::string& name, std::span<const std::uint8_t> bytes) noexcept override {
    return used() + bytes.size() <= limit_ && disk_->replace(name, bytes);
  }
  std::vector<std::uint8_t> read(const std::string& name) override { return disk_->read(name); }
  bool remove(const std::string& name) noexcept override { return disk_->remove(name); }

 private:
  std::string folder_;
  std::unique_ptr<rt::StoreDisk> disk_;
  std::uint64_t limit_;
};

}  // namespace store_test
