// A loop of integers, compiled for the vectors of more than one instruction set; which one runs is
// chosen when the program is loaded. Integers give the same on all of them.
#pragma once

// clang and the sanitizers take the plain version: they do not build, or do not survive, functions
// that the loader chooses.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && \
    !defined(__SANITIZE_THREAD__) && !defined(__SANITIZE_ADDRESS__)
#define TELETACT_CODEC_CLONES __attribute__((target_clones("avx2", "default")))
#else
#define TELETACT_CODEC_CLONES
#endif
