/* Ring (rt/channel/ring.hpp): one producer, one consumer, for ever. Counters run modulo 8 with a
 * capacity of 2, so the wrap of the 64-bit counters is part of the model; elements are numbered
 * modulo 4. An element is written and read in two halves, so that a torn one shows.
 *
 *   spin -a ring.pml                       correct: 0 errors
 *   spin -a -DPUBLISH_FIRST ring.pml       the sequence word is set before the element is written
 *   spin -a -DFREE_FIRST ring.pml          head is moved before the element is read
 *   spin -a -DNO_FULL_CHECK ring.pml       the producer does not look at head
 *   spin -a -DFORGET_GAP ring.pml          a drop sets no gap flag
 * Each of the last four must yield an assertion violation. (The first two are what a weaker memory
 * order would permit.)
 */
#define N 2
#define M 8                       /* counters modulo M, a multiple of N */
#define E 4                       /* element numbers modulo E */
#define NEXT(a) ((a + 1) % M)
#define DIFF(a, b) ((a + M - b) % M)

byte head = 0;                    /* written by the consumer only */
byte seq[N];                      /* i + 1 once element i is in */
byte slot_lo[N], slot_hi[N];      /* the two halves of an element */
bool slot_gap[N];

/* Ghosts: which element must arrive at a position, and whether one was dropped before it. */
byte expect_value[M];
bool expect_gap[M];

inline write_element() {
  slot_lo[tail % N] = n;
  slot_hi[tail % N] = n;
#ifdef FORGET_GAP
  d_step { slot_gap[tail % N] = false; gap = false }
#else
  d_step { slot_gap[tail % N] = gap; gap = false }
#endif
}

active proctype producer() {
  byte tail = 0, head_copy = 0, n = 0;
  bool gap = false, lost = false;                       /* lost is the ghost of gap */
  do
  :: n = (n + 1) % E;
#ifndef NO_FULL_CHECK
     if :: DIFF(tail, head_copy) >= N -> head_copy = head :: else fi;
#endif
     if
#ifndef NO_FULL_CHECK
     :: DIFF(tail, head_copy) >= N -> d_step { gap = true; lost = true }   /* dropped */
     :: else ->
#else
     :: true ->
#endif
        d_step { expect_value[tail] = n; expect_gap[tail] = lost; lost = false };
#ifdef PUBLISH_FIRST
        seq[tail % N] = NEXT(tail);
        write_element();
#else
        write_element();
        seq[tail % N] = NEXT(tail);
#endif
        tail = NEXT(tail)
     fi
  od
}

active proctype consumer() {
  byte lo, hi, at;
  bool gap;
  do
  :: seq[head % N] == NEXT(head) ->                     /* else empty: nothing happens */
     at = head;
#ifdef FREE_FIRST
     head = NEXT(head);
#endif
     lo = slot_lo[at % N];
     hi = slot_hi[at % N];
     d_step {
       gap = slot_gap[at % N];
       assert(lo == hi);                                /* whole */
       assert(lo == expect_value[at]);                  /* in order, none twice, none lost */
       assert(gap == expect_gap[at]);                   /* and it says what is missing */
       lo = 0; hi = 0; gap = false;
       expect_value[at] = 0; expect_gap[at] = false     /* ghosts: fewer states */
     };
#ifndef FREE_FIRST
     head = NEXT(head);
#endif
     at = 0
  od
}
