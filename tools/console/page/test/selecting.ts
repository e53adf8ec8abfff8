// Which answers change what is being chosen: of an *Accept* and of a click, in time and late.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { Acts } from '../src/act/acts';
import { Selecting } from '../src/act/selecting';
import { Answer, Selection } from '../src/wire/types';

const shown = (proposal: number): Selection =>
  ({ width: 1, height: 1, proposal, mask: Uint8Array.of(1) });

// A box that answers a click and *Accept* when it is told to.
function stub() {
  let propose = (_: Selection): void => {};
  let answerAccept = (_: Answer): void => {};
  const clicked: ((size_m?: number[]) => void)[] = [];
  const acts = {
    store: { picture: null, on: (_: string, run: typeof propose) => { propose = run; } },
    link: { act: () => new Promise<Answer>(done => clicked.push(size_m =>
      done({ ok: true, result: size_m ? { size_m } : {} } as unknown as Answer))) },
    ask: () => new Promise<Answer>(done => { answerAccept = done; }),
    say: () => {},
  };
  const selecting = new Selecting(acts as unknown as Acts);
  return { selecting, clicked, propose: (s: Selection) => propose(s),
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

test('the answer to a click says its size or that there is none; to one that was dropped, nothing',
  async () => {
    const { selecting, clicked, propose } = stub();
    const answered = async (size_m?: number[]) => {
      clicked.shift()!(size_m);
      await new Promise(done => setTimeout(done));
    };
    selecting.click(0.5, 0.5);
    propose(shown(1));
    await answered();
    assert.ok(selecting.scant);
    selecting.click(0.6, 0.5);
    await answered([0.1, 0.2, 0.3]);
    assert.ok(!selecting.scant);
    assert.equal(selecting.text, '2 clicks, 0.10 × 0.20 × 0.30 m');
    for (const late of [undefined, [1, 1, 1]]) {
      selecting.click(0.5, 0.5);
      selecting.drop();  // Escape, before the answer
      selecting.click(0.2, 0.2);
      propose(shown(2));
      await answered(late);
      assert.equal(selecting.text, '1 click');
      await answered([0.4, 0.5, 0.6]);
      assert.equal(selecting.text, '1 click, 0.40 × 0.50 × 0.60 m');
      selecting.drop();
    }
  });
