/* Latest (rt/channel/latest.hpp): one writer, two readers that retain 1 and 2 values, running for
 * ever. Sequence numbers are left out so that the state space is finite: what holds here holds for
 * any number of operations. Each statement that touches a shared word is one atomic step.
 *
 *   spin -a latest.pml                     correct: 0 errors
 *   spin -a -DNO_WRITER_SWAP latest.pml    the writer does not fill NONE words
 *   spin -a -DNO_READER_SWAP latest.pml    the reader stores instead of compare-and-swap
 *   spin -a -DONE_SLOT_LESS latest.pml     H + 1 slots
 * Each of the last three must yield an assertion violation.
 */
#define READERS 2
#define WORDS 3            /* H: word 0 is reader 0's, words 1 and 2 are reader 1's */
#ifdef ONE_SLOT_LESS
#define SLOTS (WORDS + 1)
#else
#define SLOTS (WORDS + 2)
#endif
#define NONE 15

byte latest = NONE;
byte word[WORDS] = NONE;

/* Ghosts: what the promises are about; not part of the protocol. */
byte writing = NONE;       /* slot that the writer is filling */
byte users[SLOTS] = 0;     /* how many references readers hold to each slot */

active proctype writer() {
  byte s, i;
  bool taken[SLOTS];
  do
  :: /* begin_write: one look at latest and at each word, in turn */
     d_step { taken[0] = false; taken[1] = false; taken[2] = false; taken[3] = false;
#ifndef ONE_SLOT_LESS
              taken[4] = false;
#endif
              i = 0 };
     d_step { if :: latest != NONE -> taken[latest] = true :: else fi; s = 0 };
     do
     :: i < WORDS ->
        d_step { if :: word[i] != NONE -> taken[word[i]] = true :: else fi; i++ }
     :: else -> break
     od;
     skip;                      /* a break may not lead into a d_step */
     d_step {
       do :: s < SLOTS && taken[s] -> s++ :: else -> break od;
       i = 0
     };
     assert(s < SLOTS);         /* the writer finds a free slot ... */
     d_step {
       assert(users[s] == 0);    /* ... that nobody holds */
       writing = s
     };
     /* here the slot is being filled, while readers go on */
     d_step { latest = s; writing = NONE };  /* publish */
#ifndef NO_WRITER_SWAP
     do
     :: i < WORDS ->
        d_step { if :: word[i] == NONE -> word[i] = s :: else fi; i++ }
     :: else -> break
     od;
     i = 0;
#endif
     s = 0
  od
}

/* acquire: gives up what it held in word w, then takes the newest */
inline acquire(w, held) {
  latest != NONE;                                      /* nothing published: nothing done */
  d_step { if :: held != NONE -> users[held]-- :: else fi; held = NONE };
  word[w] = NONE;
  mine = latest;
#ifdef NO_READER_SWAP
  d_step { word[w] = mine; held = mine;
#else
  d_step { if :: word[w] == NONE -> word[w] = mine :: else fi; held = word[w];
#endif
    users[held]++;
    assert(held != writing);     /* never the slot being written */
    mine = NONE
  }
}

active proctype reader_of_one() {
  byte mine = NONE, held = NONE;
  do :: acquire(0, held) od
}

active proctype reader_of_two() {
  byte mine = NONE, older = NONE, newer = NONE;
  do
  :: acquire(1, older);          /* `newer` stays valid across this */
     acquire(2, newer)
  od
}
