// Runs small concurrent code under every possible interleaving of its atomic operations.
//
// The code under test is the product's own, with interleave::Atomic in place of std::atomic. Each
// thread of a scenario is a fiber that stops before each of its atomic operations; the explorer
// chooses who goes on, depth first, by running the scenario again from its start along the next
// untried choice. A state that was met before is not explored again: its key is the value of every
// atomic plus, for each fiber, everything it has read since its last boundary().
//
// Exhaustive under sequential consistency for the given numbers of operations (up to collisions of
// a 64-bit hash). Weaker memory orders are not modelled; ThreadSanitizer is there for those.
#pragma once

#include <ucontext.h>

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <unordered_set>
#include <vector>

#include "rt/random.hpp"

namespace interleave {

class Explorer;

namespace detail {
inline Explorer* current = nullptr;  // one exploration at a time, on one thread
}

// One run of a scenario: construct everything fresh, add the fibers, state failures by fail().
class Explorer {
 public:
  struct Outcome {
    std::string failure;  // empty: every interleaving kept every promise
    std::uint64_t states = 0, runs = 0;
    bool complete = true;  // false: the limit of runs came first
  };

  // `scenario(explorer)` is called once a run: it builds its objects (owned by the returned handle)
  // and calls add() for each fiber.
  static Outcome explore(const std::function<std::shared_ptr<void>(Explorer&)>& scenario,
                         std::uint64_t max_runs = 20'000'000) {
    Explorer e;
    detail::current = &e;
    do {
      e.run(scenario);
    } while (e.outcome_.failure.empty() && e.backtrack() && e.outcome_.runs < max_runs);
    e.outcome_.complete = e.path_.empty() || !e.outcome_.failure.empty();
    detail::current = nullptr;
    return e.outcome_;
  }

  void add(std::function<void()> body) {
    fibers_.push_back(std::make_unique<Fiber>());
    fibers_.back()->body = std::move(body);
  }
  // From a fiber: a promise was broken.
  void fail(std::string what) {
    if (outcome_.failure.empty()) outcome_.failure = std::move(what);
  }
  // From a fiber: `state` says everything of this fiber that its further behaviour depends on.
  void boundary(std::uint64_t state) { active_->local = rt::mix64(state, 0x5eed); }
  // From a fiber: others may run here.
  void pause() {
    step();
    saw(0x9a05e);
  }
  // What the fibers share besides atomics, as a hash.
  void shared_state(std::function<std::uint64_t()> hash) { shared_state_ = std::move(hash); }

  // --- for Atomic ---
  void step() {
    if (active_ != nullptr) swapcontext(&active_->context, &scheduler_);
  }
  void saw(std::uint64_t value) {
    if (active_ != nullptr) active_->local = rt::mix64(active_->local, value);
  }
  void register_atomic(const std::uint64_t* value) { memory_.push_back(value); }

 private:
  struct Fiber {
    ucontext_t context{};
    std::vector<char> stack;
    std::function<void()> body;
    std::uint64_t local = 0;
    bool done = false;
  };
  struct Choice {
    std::vector<int> enabled;
    std::size_t taken = 0;
  };

  static void enter() {
    Explorer& e = *detail::current;
    Fiber* self = e.active_;
    self->body();
    self->done = true;
    swapcontext(&self->context, &e.scheduler_);
  }

  void run(const std::function<std::shared_ptr<void>(Explorer&)>& scenario) {
    fibers_.clear();
    memory_.clear();
    shared_state_ = nullptr;
    active_ = nullptr;
    ++outcome_.runs;
    const std::shared_ptr<void> objects = scenario(*this);
    for (auto& fiber : fibers_) start(*fiber);
    for (std::size_t depth = 0;; ++depth) {
      if (depth == path_.size() && !descend()) break;
      const Choice& choice = path_[depth];
      resume(*fibers_[static_cast<std::size_t>(choice.enabled[choice.taken])]);
      if (!outcome_.failure.empty()) {
        describe(depth);
        break;
      }
    }
    // Fibers that have not ended are dropped with their stacks; their frames own nothing.
  }

  void start(Fiber& fiber) {
    if (stacks_.empty()) {
      fiber.stack.resize(64 * 1024);
    } else {
      fiber.stack = std::move(stacks_.back());
      stacks_.pop_back();
    }
    getcontext(&fiber.context);
    fiber.context.uc_stack.ss_sp = fiber.stack.data();
    fiber.context.uc_stack.ss_size = fiber.stack.size();
    fiber.context.uc_link = nullptr;
    makecontext(&fiber.context, &Explorer::enter, 0);
    resume(fiber);  // up to its first atomic operation
  }

  void resume(Fiber& fiber) {
    active_ = &fiber;
    swapcontext(&scheduler_, &fiber.context);
    active_ = nullptr;
  }

  // Opens the next decision, unless all fibers ended or this state is known.
  bool descend() {
    Choice next;
    for (std::size_t i = 0; i < fibers_.size(); ++i) {
      if (!fibers_[i]->done) next.enabled.push_back(static_cast<int>(i));
    }
    if (next.enabled.empty()) return false;
    std::uint64_t key = shared_state_ ? shared_state_() : 0;
    for (const std::uint64_t* value : memory_) key = rt::mix64(key, *value);
    for (const auto& fiber : fibers_) key = rt::mix64(key, fiber->local);
    if (!seen_.insert(key).second) return false;
    ++outcome_.states;
    path_.push_back(std::move(next));
    return true;
  }

  bool backtrack() {
    for (auto& fiber : fibers_) stacks_.push_back(std::move(fiber->stack));
    fibers_.clear();
    while (!path_.empty()) {
      if (++path_.back().taken < path_.back().enabled.size()) return true;
      path_.pop_back();
    }
    return false;
  }

  void describe(std::size_t depth) {
    outcome_.failure += " (schedule";
    for (std::size_t d = 0; d <= depth && d < path_.size(); ++d) {
      outcome_.failure += ' ' + std::to_string(path_[d].enabled[path_[d].taken]);
    }
    outcome_.failure += ')';
  }

  ucontext_t scheduler_{};
  Fiber* active_ = nullptr;
  std::vector<std::unique_ptr<Fiber>> fibers_;
  std::vector<std::vector<char>> stacks_;
  std::vector<const std::uint64_t*> memory_;
  std::function<std::uint64_t()> shared_state_;
  std::vector<Choice> path_;
  std::unordered_set<std::uint64_t> seen_;
  Outcome outcome_;
};

// The part of std::atomic<std::uint64_t> that the channels use.
template <class U>
class Atomic {
  static_assert(sizeof(U) == 8);

 public:
  Atomic() : Atomic(U{}) {}
  Atomic(U value) : value_(value) {  // NOLINT: implicit as in std::atomic
    if (detail::current != nullptr) detail::current->register_atomic(&value_);
  }
  Atomic(const Atomic&) = delete;
  Atomic& operator=(const Atomic&) = delete;

  U load(std::memory_order) const noexcept {
    step();
    saw(value_);
    return value_;
  }
  void store(U value, std::memory_order) noexcept {
    step();
    value_ = value;
    saw(1);
  }
  bool compare_exchange_strong(U& expected, U desired, std::memory_order) noexcept {
    step();
    saw(value_);
    if (value_ == expected) {
      value_ = desired;
      return true;
    }
    expected = value_;
    return false;
  }

 private:
  static void step() noexcept {
    if (detail::current != nullptr) detail::current->step();
  }
  static void saw(std::uint64_t value) noexcept {
    if (detail::current != nullptr) detail::current->saw(value);
  }
  std::uint64_t value_;
};

}  // namespace interleave
