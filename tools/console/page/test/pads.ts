// Gamepads: of the standard mapping, taught, and unknown; then the page's line about one.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { PadLesson } from '../src/act/pad_lesson';
import { PadMap, Pads, readMap } from '../src/act/pads';
import { desk, twin } from './bench';
import { until } from './browser';

const map: PadMap = { forward: { index: 4, sign: -1 }, left: { index: 0, sign: 1 },
  turn: { index: 3, sign: -1 }, deadMan: 7, press: 1 };
const axes = [0, 0, -1, 0, 0.02, 0, 0];  // at rest; the third is a trigger

function gamepad(changed: Record<number, number> = {}, down: number[] = [], mapping = ''): Gamepad {
  return { id: 'Odd pad', connected: true, mapping,
    axes: axes.map((value, i) => changed[i] ?? value),
    buttons: Array.from({ length: 12 }, (_, i) => ({ pressed: down.includes(i) })),
  } as unknown as Gamepad;
}

test('a pad of no known mapping does nothing, and is told of', () => {
  const pads = new Pads(() => [null, gamepad({ 1: -1 }, [0, 5])]);
  assert.equal(pads.reading(), null);
  assert.equal(pads.unknown()?.id, 'Odd pad');
  const both = new Pads(() => [gamepad(), gamepad({ 1: -1 }, [5], 'standard')]);
  assert.equal(both.unknown(), null);
  assert.deepEqual(both.reading(), { forward: 1, left: 0, turn: 1, deadMan: true, press: false });
});

test('one that was taught is read by that, also after a reload', () => {
  const kept = new Map<string, string>();
  const storage = { getItem: (name: string) => kept.get(name) ?? null,
    setItem: (name: string, text: string) => void kept.set(name, text),
    removeItem: (name: string) => void kept.delete(name) };
  const list = () => [gamepad({ 4: -0.9, 0: 0.5, 3: 0.1 }, [7])];
  new Pads(list, storage).teach('Odd pad', map);
  const pads = new Pads(list, storage);
  assert.equal(pads.unknown(), null);
  assert.deepEqual(pads.reading(),
    { forward: 0.9, left: 0.5, turn: 0, deadMan: true, press: false });
  pads.resting = true;
  assert.equal(pads.reading(), null, 'nothing drives while one is taught');
});

test('what is kept in the browser may be damaged: it is none then', () => {
  assert.deepEqual(readMap(JSON.stringify(map)), map);
  for (const bad of [null, '', '{', 'null', '5', '[]', '{}', JSON.stringify({ ...map, press: 7 }),
    JSON.stringify({ ...map, turn: map.left }), JSON.stringify({ ...map, deadMan: -1 }),
    JSON.stringify({ ...map, deadMan: 1.5 }), JSON.stringify({ ...map, press: 1e9 }),
    JSON.stringify({ ...map, left: { index: 0, sign: 2 } }),
    JSON.stringify({ ...map, left: { index: '0', sign: 1 } }), JSON.stringify(map).slice(0, -5)]) {
    assert.equal(readMap(bad), null, String(bad));
  }
});

test('a lesson: sticks and buttons one after the other, each let go of', () => {
  const lesson = new PadLesson();
  const polls = (pad: Gamepad, count = 6) => { for (let i = 0; i < count; ++i) lesson.poll(pad); };
  assert.match(lesson.text, /^Step 1 of 5: let go/);
  polls(gamepad({ 4: -1 }, [3]), 20);
  assert.match(lesson.text, /let go/, 'a button is down');
  polls(gamepad());
  assert.match(lesson.text, /left stick forwards/);
  polls(gamepad({ 4: -1 }), 3);
  polls(gamepad());
  assert.match(lesson.text, /^Step 1 of 5: push/, 'a movement in passing does not count');
  polls(gamepad({ 2: 1 }), 20);
  assert.match(lesson.text, /^Step 1 of 5: push/, 'a trigger is no stick');
  polls(gamepad({ 4: -1, 0: 0.3 }));
  assert.match(lesson.text, /^Step 2 of 5: let go/);
  polls(gamepad({ 4: -1 }), 20);
  assert.match(lesson.text, /^Step 2 of 5: let go/);
  polls(gamepad());
  polls(gamepad({ 4: -1, 0: 0.8 }));  // the first one again beside it: known already
  polls(gamepad());
  polls(gamepad({ 3: -1 }));
  polls(gamepad());
  polls(gamepad({}, [7]));
  polls(gamepad());
  polls(gamepad({}, [7]), 20);
  assert.equal(lesson.done, false, 'the same button is not both');
  polls(gamepad({}, [1]));
  assert.ok(lesson.done);
  assert.deepEqual(lesson.map, map);
  assert.deepEqual(readMap(JSON.stringify(lesson.map)), map);
});

test('in the browser: the line, the steps, and the base driven by what was taught', async () => {
  const { page } = desk;
  interface Faked { pad: { down: number[]; changed: Record<number, number> } }
  await page.evaluate(rest => {
    const faked = window as unknown as Faked;
    faked.pad = { down: [], changed: {} };
    navigator.getGamepads = () => [{ id: 'Odd pad', connected: true, mapping: '', index: 0,
      axes: rest.map((value, i) => faked.pad.changed[i] ?? value),
      buttons: Array.from({ length: 12 }, (_, i) => ({ pressed: faked.pad.down.includes(i) })),
    } as unknown as Gamepad];
  }, axes);
  const does = (changed: Record<number, number>, down: number[] = []) => page.evaluate(pad => {
    (window as unknown as Faked).pad = pad;
  }, { changed, down });
  const note = () => page.textContent('#pad .note span');
  const says = (word: RegExp) => until(String(word), async () => word.test((await note()) ?? ''));
  await says(/Odd pad.*does nothing/);
  await page.click('#pad .note button:has-text("Teach it")');
  await page.evaluate(() => document.getElementById('canvas')!.focus());
  const lessons: [RegExp, Record<number, number>, number[]][] = [[/forwards/, { 4: -1 }, []],
    [/left stick to the left/, { 0: 1 }, []], [/right stick to the left/, { 3: -1 }, []],
    [/while driving/, {}, [7]], [/presses at/, {}, [1]]];
  for (const [word, changed, down] of lessons) {
    await says(word);
    await does(changed, down);
    await says(/let go|presses at/);
    if (!/presses at/.test(word.source)) await does({});
  }
  await until('the end of the lesson', () => page.isHidden('#pad .note'));
  await does({});
  await desk.live();
  const before = twin.intents.at(-1)!;
  await until('driving', async () => {
    await desk.engage();
    await does({ 4: -1 }, []);
    await page.waitForTimeout(100);
    await does({ 4: -1 }, [7]);
    await page.waitForTimeout(300);
    return twin.intents.slice(twin.intents.indexOf(before) + 1)
      .some(i => i.act === 'drive' && Number(i.vx) > 0 && i.vy === 0);
  });
  await does({});
  await until('the base to stand', () => twin.plant.velocity.every(v => v === 0));
  await page.evaluate(() => {
    navigator.getGamepads = () => [];
    localStorage.removeItem('gamepad Odd pad');
  });
});
