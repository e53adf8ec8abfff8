// The product's malloc: counts for its thread, then glibc's own. Linked into the program alone,
// never into a library: tests have the guard's (tools/measure/support/rt_guard.cpp), a sanitizer
// its own.
#include <cerrno>
#include <cstddef>

#include "rt/memory/allocations.hpp"

extern "C" {

// NOLINTBEGIN(bugprone-reserved-identifier, readability-identifier-naming): the names are glibc's.
void* __libc_malloc(std::size_t) noexcept;
void* __libc_calloc(std::size_t, std::size_t) noexcept;
void* __libc_realloc(void*, std::size_t) noexcept;
void* __libc_memalign(std::size_t, std::size_t) noexcept;
// NOLINTEND(bugprone-reserved-identifier, readability-identifier-naming)

void* malloc(std::size_t n) noexcept {
  rt::note_allocation();
  return __libc_malloc(n);
}
void* calloc(std::size_t n, std::size_t size) noexcept {
  rt::note_allocation();
  return __libc_calloc(n, size);
}
void* realloc(void* p, std::size_t n) noexcept {
  rt::note_allocation();
  return __libc_realloc(p, n);
}
void* aligned_alloc(std::size_t align, std::size_t n) noexcept {
  rt::note_allocation();
  return __libc_memalign(align, n);
}
void* memalign(std::size_t align, std::size_t n) noexcept {
  rt::note_allocation();
  return __libc_memalign(align, n);
}
int posix_memalign(void** out, std::size_t align, std::size_t n) noexcept {
  rt::note_allocation();
  if (align % sizeof(void*) != 0 || align == 0 || (align & (align - 1)) != 0) return EINVAL;
  void* p = __libc_memalign(align, n);
  if (p == nullptr) return ENOMEM;
  *out = p;
  return 0;
}

}  // extern "C"

namespace {
[[maybe_unused]] const bool kCounts = (rt::allocations_are_counted(), true);
}
