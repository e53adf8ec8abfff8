// Which clicks an answer to *Accept* drops: those that were accepted, and none that began since.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { Acts } from '../src/act/acts';
import { Selecting } from '../src/act/selecting';
import { Answer, Selection } from '../src/wire/types';

const shown = (proposal: number): Selection =>
  ({ width: 1, height: 1, proposal, mask: Uint8Array.of(1) });

// A box that answers a click at once, and *Accept* when it is told to.
function stub() {
  let propose = (_: Selection): void => {};
  let answerAccept = (_: Answer): void => {};
  const acts = {
    store: { picture: null, on: (_: string, run: typeof propose) => { propose = run; } },
    link: { act: () => Promise.resolve({ ok: true, result: {} }) },
    ask: () => new Promise<Answer>(done => { answerAccept = done; }),
    say: () => {},
  };
  const selecting = new Selecting(acts as unknown as Acts);
  return { selecting, propose: (s: Selection) => propose(s),
    answer: (ok: boolean) => answerAccept({ ok } as Answer) };
}

test('an accepted object leaves no clicks, a refused one keeps them', async () => {
  for (const ok of [true, false]) {
    const { selecting, propose, answer } = stub();
    selecting.click(0.5, 0.5);
    propose(shown(1));
    const accepted = selecting.accept('bin');
    answer(ok);
    await accepted;
    assert.equal(selecting.clicks.length, ok ? 0 : 1);
    assert.equal(selecting.proposal === null, ok);
  }
});

test('clicks of another object outlive the late answer to the accept before', async () => {
  const { selecting, propose, answer } = stub();
  selecting.click(0.5, 0.5);
  propose(shown(1));
  const accepted = selecting.accept('bin');
  selecting.drop();  // Escape, before the answer
  selecting.click(0.2, 0.2);
  answer(true);
  await accepted;
  assert.equal(selecting.clicks.length, 1);
  propose(shown(2));
  assert.equal(selecting.proposal?.proposal, 2);
});
