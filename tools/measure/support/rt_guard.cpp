// Strong symbols over the C and C++ run-time libraries: each counts when the calling thread is in
// an rt::Section, then does the real thing. The allocator is forwarded to glibc's own entry points,
// so that it works before any constructor ran and inside dlsym.
#include "tools/measure/support/rt_guard.hpp"

#include <dlfcn.h>
#include <pthread.h>

#include <atomic>
#include <cerrno>
#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <typeinfo>

#include "rt/memory/allocations.hpp"
#include "rt/memory/section.hpp"

// NOLINTBEGIN(bugprone-reserved-identifier, readability-identifier-naming): the names are glibc's.
extern "C" {
void* __libc_malloc(std::size_t) noexcept;
void* __libc_calloc(std::size_t, std::size_t) noexcept;
void* __libc_realloc(void*, std::size_t) noexcept;
void* __libc_memalign(std::size_t, std::size_t) noexcept;
void __libc_free(void*) noexcept;
}
// NOLINTEND(bugprone-reserved-identifier, readability-identifier-naming)

namespace {

struct Counters {
  std::atomic<std::uint64_t> allocations{0}, frees{0}, locks{0}, waits{0}, throws{0};
};
Counters g_counters;
std::atomic<bool> g_abort{false};

void note(std::atomic<std::uint64_t>& counter) noexcept {
  if (!rt::Section::active()) return;
  counter.fetch_add(1, std::memory_order_relaxed);
  if (g_abort.load(std::memory_order_relaxed)) std::abort();
}

void note_allocation() noexcept {
  rt::note_allocation();
  note(g_counters.allocations);
}

// Versioned first: an unversioned lookup may give the condition variable of an old ABI.
void* next_symbol(const char* name, const char* version) noexcept {
  if (version != nullptr) {
    if (void* found = dlvsym(RTLD_NEXT, name, version)) return found;
  }
  void* found = dlsym(RTLD_NEXT, name);
  if (found == nullptr) std::abort();
  return found;
}

template <class F>
F* resolve(std::atomic<void*>& cache, const char* name, const char* version = nullptr) noexcept {
  void* found = cache.load(std::memory_order_acquire);
  if (found == nullptr) {
    found = next_symbol(name, version);
    cache.store(found, std::memory_order_release);
  }
  return reinterpret_cast<F*>(found);
}

struct ReadEnvironment {
  ReadEnvironment() noexcept {
    const char* mode = std::getenv("TELETACT_RT_GUARD");
    if (mode != nullptr && std::strcmp(mode, "abort") == 0) g_abort.store(true);
    rt::allocations_are_counted();
  }
} g_read_environment;

}  // namespace

extern "C" {

void teletact_rt_guard_counts(rt_guard::Counts* out) noexcept {
  out->allocations = g_counters.allocations.load(std::memory_order_relaxed);
  out->frees = g_counters.frees.load(std::memory_order_relaxed);
  out->locks = g_counters.locks.load(std::memory_order_relaxed);
  out->waits = g_counters.waits.load(std::memory_order_relaxed);
  out->throws = g_counters.throws.load(std::memory_order_relaxed);
}
void teletact_rt_guard_reset() noexcept {
  g_counters.allocations.store(0, std::memory_order_relaxed);
  g_counters.frees.store(0, std::memory_order_relaxed);
  g_counters.locks.store(0, std::memory_order_relaxed);
  g_counters.waits.store(0, std::memory_order_relaxed);
  g_counters.throws.store(0, std::memory_order_relaxed);
}
void teletact_rt_guard_abort(bool on) noexcept { g_abort.store(on, std::memory_order_relaxed); }

// --- allocation ---------------------------------------------------------------------------------
void* malloc(std::size_t n) noexcept {
  note_allocation();
  return __libc_malloc(n);
}
void* calloc(std::size_t n, std::size_t size) noexcept {
  note_allocation();
  return __libc_calloc(n, size);
}
void* realloc(void* p, std::size_t n) noexcept {
  note_allocation();
  return __libc_realloc(p, n);
}
void free(void* p) noexcept {
  if (p != nullptr) note(g_counters.frees);
  __libc_free(p);
}
void* aligned_alloc(std::size_t align, std::size_t n) noexcept {
  note_allocation();
  return __libc_memalign(align, n);
}
void* memalign(std::size_t align, std::size_t n) noexcept {
  note_allocation();
  return __libc_memalign(align, n);
}
int posix_memalign(void** out, std::size_t align, std::size_t n) noexcept {
  note_allocation();
  if (align % sizeof(void*) != 0 || align == 0 || (align & (align - 1)) != 0) return EINVAL;
  void* p = __libc_memalign(align, n);
  if (p == nullptr) return ENOMEM;
  *out = p;
  return 0;
}

// --- locks and waits ----------------------------------------------------------------------------
int pthread_mutex_lock(pthread_mutex_t* m) noexcept {
  static std::atomic<void*> real{nullptr};
  note(g_counters.locks);
  return resolve<int(pthread_mutex_t*)>(real, "pthread_mutex_lock")(m);
}
int pthread_mutex_timedlock(pthread_mutex_t* m, const timespec* t) noexcept {
  static std::atomic<void*> real{nullptr};
  note(g_counters.locks);
  return resolve<int(pthread_mutex_t*, const timespec*)>(real, "pthread_mutex_timedlock")(m, t);
}
int pthread_mutex_clocklock(pthread_mutex_t* m, clockid_t c, const timespec* t) noexcept {
  static std::atomic<void*> real{nullptr};
  note(g_counters.locks);
  return resolve<int(pthread_mutex_t*, clockid_t, const timespec*)>(
      real, "pthread_mutex_clocklock")(m, c, t);
}
int pthread_rwlock_rdlock(pthread_rwlock_t* l) noexcept {
  static std::atomic<void*> real{nullptr};
  note(g_counters.locks);
  return resolve<int(pthread_rwlock_t*)>(real, "pthread_rwlock_rdlock")(l);
}
int pthread_rwlock_wrlock(pthread_rwlock_t* l) noexcept {
  static std::atomic<void*> real{nullptr};
  note(g_counters.locks);
  return resolve<int(pthread_rwlock_t*)>(real, "pthread_rwlock_wrlock")(l);
}
int pthread_spin_lock(pthread_spinlock_t* l) noexcept {
  static std::atomic<void*> real{nullptr};
  note(g_counters.locks);
  return resolve<int(pthread_spinlock_t*)>(real, "pthread_spin_lock")(l);
}
int pthread_cond_wait(pthread_cond_t* c, pthread_mutex_t* m) {
  static std::atomic<void*> real{nullptr};
  note(g_counters.waits);
  return resolve<int(pthread_cond_t*, pthread_mutex_t*)>(real, "pthread_cond_wait", "GLIBC_2.3.2")(
      c, m);
}
int pthread_cond_timedwait(pthread_cond_t* c, pthread_mutex_t* m, const timespec* t) {
  static std::atomic<void*> real{nullptr};
  note(g_counters.waits);
  return resolve<int(pthread_cond_t*, pthread_mutex_t*, const timespec*)>(
      real, "pthread_cond_timedwait", "GLIBC_2.3.2")(c, m, t);
}
int pthread_cond_clockwait(pthread_cond_t* c, pthread_mutex_t* m, clockid_t k, const timespec* t) {
  static std::atomic<void*> real{nullptr};
  note(g_counters.waits);
  return resolve<int(pthread_cond_t*, pthread_mutex_t*, clockid_t, const timespec*)>(
      real, "pthread_cond_clockwait")(c, m, k, t);
}

// --- exceptions ---------------------------------------------------------------------------------
// The names are the C++ ABI's.
// NOLINTBEGIN(bugprone-reserved-identifier, readability-identifier-naming)
[[noreturn]] void __cxa_throw(void* object, std::type_info* type, void (*destroy)(void*)) {
  static std::atomic<void*> real{nullptr};
  note(g_counters.throws);
  resolve<void(void*, std::type_info*, void (*)(void*))>(real, "__cxa_throw")(object, type,
                                                                              destroy);
  __builtin_unreachable();
}
[[noreturn]] void __cxa_rethrow() {
  static std::atomic<void*> real{nullptr};
  note(g_counters.throws);
  resolve<void()>(real, "__cxa_rethrow")();
  __builtin_unreachable();
}
// NOLINTEND(bugprone-reserved-identifier, readability-identifier-naming)

}  // extern "C"
