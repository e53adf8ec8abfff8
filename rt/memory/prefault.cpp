#include "rt/memory/prefault.hpp"

#include <alloca.h>
#include <malloc.h>
#include <pthread.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <unistd.h>

#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <new>

namespace rt {
namespace {

std::size_t page_size() noexcept { return static_cast<std::size_t>(sysconf(_SC_PAGESIZE)); }

// Touches `bytes` below the caller's frame. Not inlined: the frame must end with the call.
[[gnu::noinline]] void touch_stack(std::size_t bytes) noexcept {
  auto* block = static_cast<volatile unsigned char*>(alloca(bytes));
  const std::size_t page = page_size();
  for (std::size_t i = 0; i < bytes; i += page) block[i] = 0;
  block[bytes - 1] = 0;
}

// Bytes of stack between this frame and the lowest usable address; 0 when unknown.
std::size_t stack_left() noexcept {
  pthread_attr_t attr;
  if (pthread_getattr_np(pthread_self(), &attr) != 0) return 0;
  void* lowest = nullptr;
  std::size_t size = 0;
  std::size_t guard = 0;
  pthread_attr_getstack(&attr, &lowest, &size);
  pthread_attr_getguardsize(&attr, &guard);
  pthread_attr_destroy(&attr);
  const auto here = reinterpret_cast<std::uintptr_t>(__builtin_frame_address(0));
  const auto floor = reinterpret_cast<std::uintptr_t>(lowest) + guard;
  return here > floor ? static_cast<std::size_t>(here - floor) : 0;
}

std::string kib(std::size_t bytes) { return std::to_string(bytes / 1024) + " KiB"; }

void join(std::string& all, const std::string& one) {
  if (one.empty()) return;
  if (!all.empty()) all += "; ";
  all += one;
}

}  // namespace

std::string lock_all_memory(NonRealtime&) {
  if (mlockall(MCL_CURRENT | MCL_FUTURE) == 0) return {};
  const int error = errno;
  rlimit limit{};
  getrlimit(RLIMIT_MEMLOCK, &limit);
  const std::string now =
      limit.rlim_cur == RLIM_INFINITY ? "unlimited" : kib(static_cast<std::size_t>(limit.rlim_cur));
  return std::string("memory is not locked: ") + std::strerror(error) + ", memlock limit " + now +
         " (set memlock to unlimited in /etc/security/limits.d)";
}

std::string keep_heap(NonRealtime&) {
#if defined(__GLIBC__)
  std::string missing;
  if (mallopt(M_TRIM_THRESHOLD, -1) != 1) join(missing, "the heap may be trimmed");
  if (mallopt(M_MMAP_MAX, 0) != 1) join(missing, "large blocks may come from mmap");
  return missing;
#else
  return "this C library's allocator has no settings to keep its memory";
#endif
}

std::string prefault_heap(NonRealtime& nrt, std::size_t bytes) {
  if (bytes == 0) return {};
  const std::unique_ptr<std::byte[]> block(new (std::nothrow) std::byte[bytes]);
  if (block == nullptr) return "the heap could not grow by " + kib(bytes);
  prefault_range(nrt, block.get(), bytes);
  return {};
}

std::string prefault_stack(NonRealtime&, std::size_t bytes) {
  // What this call itself needs, and a signal handler on top of it, stays out of the touched part.
  constexpr std::size_t kMargin = 32 * 1024;
  const std::size_t left = stack_left();
  const std::size_t usable = left > kMargin ? left - kMargin : 0;
  const std::size_t touched = bytes < usable ? bytes : usable;
  if (touched > 0) touch_stack(touched);
  if (touched == bytes) return {};
  return "stack touched for " + kib(touched) + " of " + kib(bytes) + ", it is not larger";
}

void prefault_range(NonRealtime&, void* data, std::size_t bytes) noexcept {
  if (bytes == 0) return;
  auto* p = static_cast<volatile unsigned char*>(data);
  const std::size_t page = page_size();
  for (std::size_t i = 0; i < bytes; i += page) p[i] = p[i];
  p[bytes - 1] = p[bytes - 1];
}

std::string prepare_process_memory(NonRealtime& nrt, std::size_t heap_bytes,
                                   std::size_t stack_bytes) {
  std::string missing;
  join(missing, keep_heap(nrt));
  join(missing, lock_all_memory(nrt));
  join(missing, prefault_heap(nrt, heap_bytes));
  join(missing, prefault_stack(nrt, stack_bytes));
  return missing;
}

}  // namespace rt
