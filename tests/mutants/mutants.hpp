// Included by every changed file of a mutated tree. teletact_mutant(k): is mutant k the one that runs?
// TELETACT_MUTANT=k chooses it; TELETACT_MUTANT_HITS=FILE gets a byte per mutant that was reached.
#pragma once
#if defined(__cplusplus)
#include <fcntl.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <unistd.h>
namespace teletact_mutants {
inline constexpr int kMost = 1024;
inline int chosen() noexcept {
  const char* t = ::getenv("TELETACT_MUTANT");
  return t != nullptr ? ::atoi(t) : -1;
}
inline unsigned char* open_hits() noexcept {
  static unsigned char none[kMost];
  const char* path = ::getenv("TELETACT_MUTANT_HITS");
  if (path == nullptr) return none;
  const int fd = ::open(path, O_RDWR | O_CREAT | O_CLOEXEC, 0666);
  if (fd < 0) return none;
  if (::ftruncate(fd, kMost) != 0) return none;
  void* p = ::mmap(nullptr, kMost, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_POPULATE, fd, 0);
  ::close(fd);
  return p == MAP_FAILED ? none : static_cast<unsigned char*>(p);
}
inline int active = chosen();
inline unsigned char* hits = open_hits();
inline bool reached(int k) noexcept {
  if (hits == nullptr) return false;  // before the start of this file's variables
  hits[k] = 1;
  return active == k;
}
}  // namespace teletact_mutants
constexpr bool teletact_mutant(int k) noexcept {
  if (__builtin_is_constant_evaluated()) return false;
  return teletact_mutants::reached(k);
}
#endif
