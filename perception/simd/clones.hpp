// Hot leaf loops are compiled once per instruction set and chosen at load time. Without contraction
// (-ffp-contract=off) every clone gives the same bytes. Off under sanitizers: their run-time is not
// up yet when the loader picks a clone.
#pragma once

#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && \
    !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
#define TELETACT_CLONES \
  __attribute__((target_clones("default", "arch=x86-64-v3", "arch=x86-64-v4")))
#else
#define TELETACT_CLONES
#endif
