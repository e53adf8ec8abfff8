/* Ring (rt/channel/ring.hpp) with cached indices: one producer, one consumer, for ever. Counters run
 * modulo 4 with a capacity of 2, so the wrap of the 64-bit counters is part of the model; elements
 * are numbered modulo 4. Slots are written and read in two steps, so that a torn one shows.
 *
 *   spin -a ring.pml                       correct: 0 errors
 *   spin -a -DPUBLISH_FIRST ring.pml       tail is moved before the slot is written
 *   spin -a -DFREE_FIRST ring.pml          head is moved before the slot is read
 *   spin -a -DNO_FULL_CHECK ring.pml       the producer does not look at head
 *   spin -a -DFORGET_GAP ring.pml          a drop sets no gap flag
 * Each of the last four must yield an assertion violation. (The first two are what a weaker memory
 * order would permit.)
 */
#define N 2
#define M 4                       /* counters modulo M, a multiple of N */
#define DIFF(a, b) ((a + M - b) % M)

byte tail = 0, head = 0;
byte slot_lo[N], slot_hi[N];      /* the two halves of an element */
bool slot_gap[N];

/* Ghost: the number of the next element that must arrive, and whether one was dropped before it.
 * The producer keeps them exactly, in the order of its pushes. */
byte expect_value[M];
bool expect_gap[M];

active proctype producer() {
  byte head_copy = 0, n = 0;
  bool gap = false, lost = false;                       /* lost is the ghost of gap */
  do
  :: n = (n + 1) % M;
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
        d_step { expect_value[tail] = n; expect_gap[tail] = lost; lost = false }
#ifdef PUBLISH_FIRST
        tail = (tail + 1) % M;
        slot_lo[(tail + M - 1) % M % N] = n;
        slot_hi[(tail + M - 1) % M % N] = n;
        d_step { slot_gap[(tail + M - 1) % M % N] = gap; gap = false }
#else
        slot_lo[tail % N] = n;
        slot_hi[tail % N] = n;
#ifdef FORGET_GAP
        d_step { slot_gap[tail % N] = false; gap = false };
#else
        d_step { slot_gap[tail % N] = gap; gap = false };
#endif
        tail = (tail + 1) % M
#endif
     fi
  od
}

active proctype consumer() {
  byte tail_copy = 0, lo, hi, at;
  bool gap;
  do
  :: if :: head == tail_copy -> tail_copy = tail :: else fi;
     if
     :: head == tail_copy -> skip                       /* empty */
     :: else ->
        at = head;
#ifdef FREE_FIRST
        head = (head + 1) % M;
#endif
        lo = slot_lo[at % N];
        hi = slot_hi[at % N];
        d_step {
          gap = slot_gap[at % N];
          assert(lo == hi);                             /* whole */
          assert(lo == expect_value[at]);               /* in order, none twice, none lost */
          assert(gap == expect_gap[at]);                /* and it says what is missing */
          lo = 0; hi = 0; gap = false;
          expect_value[at] = 0; expect_gap[at] = false  /* ghosts: fewer states */
        }
#ifndef FREE_FIRST
        head = (head + 1) % M;
#endif
        at = 0
     fi
  od
}
