// Latest: the newest value of one writer for N readers. Nobody waits, retries or copies.
//
//   writer    T& begin_write(), fill it, publish(). An unpublished slot is simply written again.
//   reader r  acquire(r): the newest value, by reference. The reference stays valid until that
//             reader's h-th next acquire, h being the number of values the reader retains.
//   Each value carries the instant of its publication (of the writer's job, or of the message's
//   arrival) and the uncertainty of its instants, where they were converted from another box's
//   clock.
//
// Protocol (one atomic word per retained value, H = sum of h, H + 2 slots, all seq_cst):
//   writer  picks a slot that is neither the latest nor in any word, writes it, sets latest, then
//           turns each word that is NONE into the new slot (compare-and-swap).
//   reader  takes its oldest word, sets it NONE, loads latest, compare-and-swaps NONE -> latest and
//           uses what the word then holds (its own load, or what the writer put there).
// Why a slot is always free: latest and the words exclude at most H + 1 of H + 2. Why the writer
// never reaches a held slot: a reader that loaded an old latest and sleeps before its swap finds
// its word already filled by the writer with the new one. h = 1 with one reader is the triple
// buffer. Both claims are checked exhaustively (tests/unit/rt_channel, tests/negative/promela).
//
// Rotation: acquire() number n uses word n mod h, so it gives up exactly the value of acquire()
// n - h, also when nothing new was published and both words then hold the same slot.
// acquire_if_new() spends no word in that case and returns the last view again.
//
// Slots are constructed in place in memory that the constructor has touched. A slot handed out by
// begin_write() still holds some older value: the writer overwrites what it means to publish.
#pragma once

#include <array>
#include <atomic>
#include <cassert>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <new>
#include <stdexcept>
#include <string>
#include <vector>

#include "rt/channel/ring.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/time.hpp"

namespace rt {

// What the protocol is made of. Tests replace single parts to show that each one is needed.
struct LatestProtocol {
  template <class U>
  using Atomic = std::atomic<U>;
  static constexpr std::memory_order kOrder = std::memory_order_seq_cst;
  static constexpr int kSpareSlots = 2;
  static constexpr bool kHelpReaders = true;  // the writer's compare-and-swap of NONE words
  static constexpr bool kReaderSwaps = true;  // the reader's, instead of a plain store
};

// The protocol on slot numbers only; Latest<T> adds the slots.
template <class Protocol = LatestProtocol>
class LatestIndex {
 public:
  static constexpr int kMaxRetained = 8;
  static constexpr int kMaxSlots = 255;
  struct Held {
    int slot = -1;  // -1: nothing published yet
    std::uint64_t seq = 0;
  };

  LatestIndex(NonRealtime&, const std::vector<int>& retained_per_reader)
      : readers_(retained_per_reader.size()) {
    int words = 0;
    for (std::size_t r = 0; r < readers_.size(); ++r) {
      const int h = retained_per_reader[r];
      if (h < 1 || h > kMaxRetained) {
        throw std::invalid_argument("Latest: reader " + std::to_string(r) + " retains " +
                                    std::to_string(h) + " values, allowed are 1 to " +
                                    std::to_string(kMaxRetained));
      }
      readers_[r].retained = h;
      words += h;
    }
    slots_ = words + Protocol::kSpareSlots;
    if (slots_ > kMaxSlots) {
      throw std::invalid_argument("Latest: " + std::to_string(slots_) + " slots, allowed are " +
                                  std::to_string(kMaxSlots));
    }
  }
  LatestIndex(const LatestIndex&) = delete;
  LatestIndex& operator=(const LatestIndex&) = delete;

  [[nodiscard]] int slots() const noexcept { return slots_; }
  [[nodiscard]] int readers() const noexcept { return static_cast<int>(readers_.size()); }

  // Writer. The slot to fill; the same one until published. -1 is impossible in the protocol.
  [[nodiscard]] int begin_write() noexcept {
    if (writing_ < 0) writing_ = find_free();
    return writing_;
  }
  // Writer. The slot that begin_write() gave and publish() has not taken; -1: none.
  [[nodiscard]] int writing() const noexcept { return writing_; }
  // Writer. Sequence of the value, from 1; 0 when no slot had been asked for.
  std::uint64_t publish() noexcept {
    if (writing_ < 0) return 0;
    const std::uint64_t entry = pack(++seq_, writing_);
    writing_ = -1;
    latest_.store(entry, Protocol::kOrder);
    if constexpr (Protocol::kHelpReaders) {
      for (Reader& reader : readers_) {
        for (int i = 0; i < reader.retained; ++i) {
          auto& word = reader.words[static_cast<std::size_t>(i)];
          // A swap that would fail is a load: look first and leave the reader's line alone.
          std::uint64_t seen = word.load(Protocol::kOrder);
          if (seen == kNone) word.compare_exchange_strong(seen, entry, Protocol::kOrder);
        }
      }
    }
    return seq_;
  }

  // Reader.
  [[nodiscard]] Held acquire(int r) noexcept {
    assert(r >= 0 && r < readers());
    Reader& reader = readers_[static_cast<std::size_t>(r)];
    if (latest_.load(Protocol::kOrder) == kNone) return {};  // keep the rotation for a real value
    auto& word = reader.words[static_cast<std::size_t>(reader.next)];
    if (++reader.next == reader.retained) reader.next = 0;
    word.store(kNone, Protocol::kOrder);
    const std::uint64_t newest = latest_.load(Protocol::kOrder);
    std::uint64_t held = kNone;
    if constexpr (Protocol::kReaderSwaps) {
      if (word.compare_exchange_strong(held, newest, Protocol::kOrder)) held = newest;
    } else {
      word.store(held = newest, Protocol::kOrder);
    }
    reader.last = unpack(held);
    return reader.last;
  }
  [[nodiscard]] Held acquire_if_new(int r) noexcept {
    assert(r >= 0 && r < readers());
    return fresh(r) ? acquire(r) : readers_[static_cast<std::size_t>(r)].last;
  }
  // Reader. True when something newer than its last acquire was published.
  [[nodiscard]] bool fresh(int r) const noexcept {
    return latest_seq() != readers_[static_cast<std::size_t>(r)].last.seq;
  }
  // Any thread. Sequence of the newest value; 0 before the first.
  [[nodiscard]] std::uint64_t latest_seq() const noexcept {
    return latest_.load(Protocol::kOrder) >> kSlotBits;
  }

 private:
  static constexpr unsigned kSlotBits = 8;
  static constexpr std::uint64_t kNone = 0;  // sequences start at 1, so no entry is 0

  struct Reader {
    alignas(kLinePair) std::array<typename Protocol::template Atomic<std::uint64_t>,
                                  kMaxRetained> words{};  // read by the writer
    alignas(kLinePair) int next = 0;                      // the reader's own
    int retained = 1;
    Held last;
  };

  static constexpr std::uint64_t pack(std::uint64_t seq, int slot) noexcept {
    return (seq << kSlotBits) | static_cast<std::uint64_t>(slot);
  }
  static constexpr Held unpack(std::uint64_t entry) noexcept {
    return {static_cast<int>(entry & ((1U << kSlotBits) - 1)), entry >> kSlotBits};
  }

  [[nodiscard]] int find_free() noexcept {
    std::array<bool, kMaxSlots + 1> taken{};
    mark(latest_.load(Protocol::kOrder), taken);
    for (Reader& reader : readers_) {
      for (int i = 0; i < reader.retained; ++i) {
        mark(reader.words[static_cast<std::size_t>(i)].load(Protocol::kOrder), taken);
      }
    }
    for (int s = 0; s < slots_; ++s) {
      if (!taken[static_cast<std::size_t>(s)]) return s;
    }
    return -1;
  }
  static void mark(std::uint64_t entry, std::array<bool, kMaxSlots + 1>& taken) noexcept {
    if (entry != kNone) taken[static_cast<std::size_t>(unpack(entry).slot)] = true;
  }

  alignas(kLinePair) typename Protocol::template Atomic<std::uint64_t> latest_{kNone};
  alignas(kLinePair) std::uint64_t seq_ = 0;  // writer only
  int writing_ = -1;
  int slots_ = 0;
  std::vector<Reader> readers_;
};

template <class T, class Protocol = LatestProtocol>
class Latest {
 public:
  struct View {
    const T* value = nullptr;  // null: nothing published yet
    std::uint64_t seq = 0;
    Time at{};        // when it was published; zero where the writer did not say
    Nanos unsure{0};  // of the instants in it
    explicit operator bool() const noexcept { return value != nullptr; }
    const T& operator*() const noexcept { return *value; }
    const T* operator->() const noexcept { return value; }
  };

  // One entry per reader: how many values it retains. Every slot is made as T(args...).
  template <class... Args>
  Latest(NonRealtime& nrt, const std::vector<int>& retained_per_reader, const Args&... args)
      : index_(nrt, retained_per_reader), slots_(index_.slots()) {
    for (int i = 0; i < index_.slots(); ++i) slots_.construct(args...);
  }

  // Set-up: calls f(T&) for each slot, to size buffers that the values own. Before the first use.
  template <class F>
  void for_each_slot(NonRealtime&, F&& f) {
    for (int i = 0; i < index_.slots(); ++i) f(slots_[i].value);
  }

  // Writer.
  [[nodiscard]] T& begin_write() noexcept {
    const int slot = index_.begin_write();
    if (slot < 0) [[unlikely]]
      std::abort();  // excluded by the protocol: see above
    return slots_[slot].value;
  }
  // Writer. Returns the value's sequence, 1 for the first; 0 when begin_write() was not called.
  std::uint64_t publish(Time at = {}, Nanos unsure = Nanos{0}) noexcept {
    if (const int slot = index_.writing(); slot >= 0) {
      slots_[slot].at = at;
      slots_[slot].unsure = unsure;
    }
    return index_.publish();
  }

  // Reader `reader` (0 ... readers - 1), one thread at a time each.
  [[nodiscard]] View acquire(int reader) noexcept { return view(index_.acquire(reader)); }
  [[nodiscard]] View acquire_if_new(int reader) noexcept {
    return view(index_.acquire_if_new(reader));
  }
  [[nodiscard]] bool fresh(int reader) const noexcept { return index_.fresh(reader); }

  // Any thread.
  [[nodiscard]] std::uint64_t latest_seq() const noexcept { return index_.latest_seq(); }
  [[nodiscard]] int slot_count() const noexcept { return index_.slots(); }
  [[nodiscard]] int reader_count() const noexcept { return index_.readers(); }

 private:
  struct Slot {
    template <class... Args>
    explicit Slot(const Args&... args) : value(args...) {}
    T value;
    Time at{};
    Nanos unsure{0};
  };
  // Slots apart by whole line pairs, in memory that is touched before the first construction.
  class Slots {
   public:
    explicit Slots(int count)
        : bytes_(static_cast<std::size_t>(count) * kStride),
          memory_(static_cast<std::byte*>(::operator new (bytes_, std::align_val_t{kAlign}))) {
      std::memset(memory_, 0, bytes_);
    }
    ~Slots() {
      while (made_ > 0) (*this)[--made_].~Slot();
      ::operator delete (memory_, bytes_, std::align_val_t{kAlign});
    }
    Slots(const Slots&) = delete;
    Slots& operator=(const Slots&) = delete;
    template <class... Args>
    void construct(const Args&... args) {
      ::new (static_cast<void*>(memory_ + static_cast<std::size_t>(made_) * kStride)) Slot(args...);
      ++made_;
    }
    Slot& operator[](int i) noexcept {
      return *std::launder(
          reinterpret_cast<Slot*>(memory_ + static_cast<std::size_t>(i) * kStride));
    }

   private:
    static constexpr std::size_t kAlign = alignof(Slot) > 4096 ? alignof(Slot) : 4096;
    static constexpr std::size_t kUnit = alignof(Slot) > kLinePair ? alignof(Slot) : kLinePair;
    static constexpr std::size_t kStride = (sizeof(Slot) + kUnit - 1) / kUnit * kUnit;
    std::size_t bytes_;
    std::byte* memory_;
    int made_ = 0;
  };

  [[nodiscard]] View view(typename LatestIndex<Protocol>::Held held) noexcept {
    if (held.slot < 0) return {};
    const Slot& slot = slots_[held.slot];
    return {&slot.value, held.seq, slot.at, slot.unsure};
  }

  LatestIndex<Protocol> index_;
  Slots slots_;
};

}  // namespace rt
