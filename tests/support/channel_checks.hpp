// What a channel promises, checked under every interleaving. Templated on the protocol, so that the
// same check that passes on the product's must fail on the broken ones of tests/negative/channels.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "rt/channel/latest.hpp"
#include "rt/channel/ring.hpp"
#include "rt/memory/non_realtime.hpp"
#include "tests/support/interleave.hpp"

namespace channel_checks {

// A protocol of the product, or a broken one, run by the explorer.
template <class Base>
struct Explored : Base {
  template <class U>
  using Atomic = interleave::Atomic<U>;
};

// One writer, one reader for each entry of `retained`. Promises:
//   - the writer always finds a slot, and never one that a reader holds;
//   - a reader never gets the slot being written, and what it holds does not change;
//   - sequences of one reader never fall, and an acquire gives at least what was published when it
//     began.
template <class Protocol>
class LatestScenario {
 public:
  LatestScenario(interleave::Explorer& e, const std::vector<int>& retained, int writes,
                 int acquires)
      : e_(e), index_(startup_.token(), retained), retained_(retained) {
    e_.shared_state([this] { return shared_state(); });
    e_.add([this, writes] { writer(writes); });
    for (std::size_t r = 0; r < retained_.size(); ++r) {
      e_.add([this, r, acquires] { reader(static_cast<int>(r), acquires); });
    }
  }

 private:
  struct Holding {
    std::array<int, 8> slots{};
    std::array<std::uint64_t, 8> seqs{};
    int count = 0;
  };
  static constexpr int kMaxReaders = 4;

  void writer(int writes) {
    for (int i = 1; i <= writes; ++i) {
      e_.boundary(rt::mix64(static_cast<std::uint64_t>(i)));
      const int slot = index_.begin_write();
      if (slot < 0) return e_.fail("the writer finds no free slot");
      for (std::size_t r = 0; r < retained_.size(); ++r) {
        for (int k = 0; k < held_[r].count; ++k) {
          if (held_[r].slots[static_cast<std::size_t>(k)] == slot) {
            return e_.fail("the writer reaches slot " + std::to_string(slot) + ", which reader " +
                           std::to_string(r) + " holds");
          }
        }
      }
      writing_ = slot;
      content_[static_cast<std::size_t>(slot)] = 0;  // half written
      e_.boundary(rt::mix64(static_cast<std::uint64_t>(i), static_cast<std::uint64_t>(slot)));
      e_.pause();  // a reader may look in while the slot is half written
      content_[static_cast<std::size_t>(slot)] = static_cast<std::uint64_t>(i);
      writing_ = -1;
      const std::uint64_t seq = index_.publish();
      if (seq != static_cast<std::uint64_t>(i)) return e_.fail("sequence is not i");
      published_ = seq;
    }
  }

  void reader(int r, int acquires) {
    Holding& mine = held_[static_cast<std::size_t>(r)];
    const int h = retained_[static_cast<std::size_t>(r)];
    std::uint64_t last = 0;
    int got = 0;
    for (int i = 0; i < acquires; ++i) {
      e_.boundary(state_of(r, i, got, mine, last));
      e_.pause();  // the reader uses what it holds
      // From here on the oldest of h values is given up.
      std::optional<std::pair<int, std::uint64_t>> oldest;
      if (mine.count == h) {
        oldest.emplace(mine.slots[0], mine.seqs[0]);
        if (content_[static_cast<std::size_t>(oldest->first)] != oldest->second) {
          return e_.fail("a held value changed");
        }
        for (std::size_t k = 1; k < static_cast<std::size_t>(h); ++k) {
          mine.slots[k - 1] = mine.slots[k];
          mine.seqs[k - 1] = mine.seqs[k];
        }
        --mine.count;
      }
      const std::uint64_t before = published_;
      const auto held = index_.acquire(r);
      if (held.slot < 0) {
        if (before > 0) return e_.fail("nothing, though something was published");
        continue;
      }
      if (held.slot == writing_) return e_.fail("a reader gets the slot being written");
      if (content_[static_cast<std::size_t>(held.slot)] != held.seq) {
        return e_.fail("a reader gets another value than its sequence says");
      }
      if (held.seq < last) return e_.fail("a reader's sequence falls");
      if (held.seq < before) return e_.fail("a reader gets an old value");
      last = held.seq;
      ++got;
      mine.slots[static_cast<std::size_t>(mine.count)] = held.slot;
      mine.seqs[static_cast<std::size_t>(mine.count)] = held.seq;
      ++mine.count;
    }
    // What is still held at the end stays valid: the writer's own check sees it.
  }

  std::uint64_t shared_state() const {
    std::uint64_t s = rt::mix64(published_, static_cast<std::uint64_t>(writing_ + 1));
    for (int i = 0; i < index_.slots(); ++i)
      s = rt::mix64(s, content_[static_cast<std::size_t>(i)]);
    for (std::size_t r = 0; r < retained_.size(); ++r) s = hash_of(s, held_[r]);
    return s;
  }
  static std::uint64_t hash_of(std::uint64_t s, const Holding& mine) {
    for (std::size_t k = 0; k < static_cast<std::size_t>(mine.count); ++k) {
      s = rt::mix64(rt::mix64(s, static_cast<std::uint64_t>(mine.slots[k])), mine.seqs[k]);
    }
    return rt::mix64(s, static_cast<std::uint64_t>(mine.count));
  }
  static std::uint64_t state_of(int r, int i, int got, const Holding& mine, std::uint64_t last) {
    std::uint64_t s = rt::mix64(static_cast<std::uint64_t>(r), static_cast<std::uint64_t>(i));
    s = rt::mix64(s, static_cast<std::uint64_t>(got));
    return hash_of(rt::mix64(s, last), mine);
  }

  interleave::Explorer& e_;
  rt::Startup startup_;
  rt::LatestIndex<Explored<Protocol>> index_;
  std::vector<int> retained_;
  std::array<Holding, kMaxReaders> held_{};
  std::array<std::uint64_t, 64> content_{};
  int writing_ = -1;
  std::uint64_t published_ = 0;
};

template <class Protocol>
interleave::Explorer::Outcome explore_latest(const std::vector<int>& retained, int writes,
                                             int acquires) {
  return interleave::Explorer::explore([&](interleave::Explorer& e) {
    return std::static_pointer_cast<void>(
        std::make_shared<LatestScenario<Protocol>>(e, retained, writes, acquires));
  });
}

// One producer of 1 ... pushes, one consumer, a ring of 2. Promises: order and content, and a gap
// flag on an element exactly when its predecessor was dropped.
template <class Protocol>
class RingScenario {
 public:
  struct Event {
    std::uint32_t value = 0;
    bool gap = false;
  };

  RingScenario(interleave::Explorer& e, std::uint64_t first, int pushes, int pops, bool batch)
      : e_(e), ring_(first) {
    e_.add([this, pushes] { producer(pushes); });
    e_.add([this, pops, batch] { consumer(pops, batch); });
  }

 private:
  void producer(int pushes) {
    for (std::uint32_t v = 1; v <= static_cast<std::uint32_t>(pushes); ++v) {
      if (!ring_.try_push({v, false})) ++dropped_;
      if (ring_.dropped() != dropped_) return e_.fail("the drop counter is wrong");
    }
  }
  void consumer(int pops, bool batch) {
    std::uint32_t last = 0;
    for (int i = 0; i < pops; ++i) {
      std::array<Event, 2> got{};
      const std::size_t n = batch ? ring_.pop_n(got.data(), 2) : (ring_.try_pop(got[0]) ? 1U : 0U);
      for (std::size_t k = 0; k < n; ++k) {
        if (got[k].value <= last) return e_.fail("order or content is wrong");
        if (got[k].gap != (got[k].value != last + 1)) return e_.fail("the gap flag is wrong");
        last = got[k].value;
      }
    }
  }

  interleave::Explorer& e_;
  rt::Ring<Event, 2, Explored<Protocol>> ring_;
  std::uint64_t dropped_ = 0;
};

template <class Protocol>
interleave::Explorer::Outcome explore_ring(std::uint64_t first, int pushes, int pops, bool batch) {
  return interleave::Explorer::explore([&](interleave::Explorer& e) {
    return std::static_pointer_cast<void>(
        std::make_shared<RingScenario<Protocol>>(e, first, pushes, pops, batch));
  });
}

}  // namespace channel_checks
