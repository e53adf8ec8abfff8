// Memory of a real-time process: locked, touched, never given back. Set-up only.
//
// Each function returns what was missing as text for the report, empty when all is well. A missing
// privilege is said, never hidden: the run goes on and is marked "not real-time".
#pragma once

#include <cstddef>
#include <string>

#include "rt/memory/non_realtime.hpp"

namespace rt {

// mlockall(current and future). Names the limit and the setting that would allow it.
[[nodiscard]] std::string lock_all_memory(NonRealtime&);

// The allocator keeps what it has: no trim, no mmap for large blocks, so memory freed by set-up
// code does not fault again.
[[nodiscard]] std::string keep_heap(NonRealtime&);

// Grows the heap by `bytes` and touches it, so later firm-class library allocations do not fault.
[[nodiscard]] std::string prefault_heap(NonRealtime&, std::size_t bytes);

// Touches `bytes` of the calling thread's stack below the current frame; never past the guard page.
[[nodiscard]] std::string prefault_stack(NonRealtime&, std::size_t bytes);

// Writes one byte to every page of [data, data + bytes) without changing it.
void prefault_range(NonRealtime&, void* data, std::size_t bytes) noexcept;

// All of the above; the lines joined by "; ".
[[nodiscard]] std::string prepare_process_memory(NonRealtime&, std::size_t heap_bytes,
                                                 std::size_t stack_bytes);

}  // namespace rt
