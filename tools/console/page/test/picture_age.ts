// How old the page says that a picture is, without a browser: box, line and clocks are the test's.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { Store } from '../src/wire/store';
import { Head } from '../src/wire/types';
import { view } from '../twin/encode';

const exposed = 0.1;         // s of the box's clock from exposure to when a picture is sent
const tokenEvery = 0.05;     // s
const pictureEvery = 0.125;
const emptyPicture = Buffer.alloc(88);

interface Line {
  clock: 'real' | 'paced';
  box: (t: number) => number;   // the box's clock at a true instant
  up?: (t: number) => number;   // s that a message takes which is sent at t
  down?: (t: number) => number;
}

interface Shown { t: number; age: number; true: number }

// Events in order of true time, which is the page's clock too; what is shown just before each
// picture is replaced, at its oldest.
function play(line: Line, seconds: number, offset = 0): Shown[] {
  const { clock, box, up = () => 0.004, down = () => 0.004 } = line;
  let now = 0;
  const store = new Store(() => now + offset);
  let head: Head | null = null;
  store.on('picture', (_, h) => { head = h; });
  const todo: { at: number; run: () => void }[] = [];
  const take = (bytes: Buffer) => {
    store.take(new Uint8Array(bytes).buffer as ArrayBuffer);
    store.flush();
  };
  const json = (value: object) => Buffer.from(JSON.stringify(value));
  const say = (kind: number, sent: number, data: number, body: Buffer) => {
    const bytes = view(kind, 1, box(sent), data, body);
    todo.push({ at: sent + down(sent), run: () => take(bytes) });
  };
  say(1, 0, -1, json({ clock }));
  for (let t = 0; t < seconds; t += tokenEvery) {
    const answered = t + up(t);
    const asked = t + offset;
    say(7, answered, -1, json({ id: 1, ok: true, result: { t: asked } }));
  }
  const shown: Shown[] = [];
  let from = NaN;  // true instant of what is shown
  for (let t = 0.03; t < seconds; t += pictureEvery) {
    const bytes = view(4, 1, box(t), box(t) - exposed, emptyPicture);
    todo.push({ at: t + down(t), run: () => {
      if (Number.isFinite(from)) shown.push({ t: now, age: store.age(head), true: now - from });
      from = t - exposed;
      take(bytes);
    } });
  }
  for (const { at, run } of todo.sort((a, b) => a.at - b.at)) {
    now = at;
    run();
  }
  assert.equal(store.damaged, 0);
  return shown.filter(s => s.t > 1);
}

const most = (shown: Shown[]) => Math.max(...shown.map(s => s.age - s.true));
const least = (shown: Shown[]) => Math.min(...shown.map(s => s.age - s.true));

test('a quick line and clocks that agree in nothing but their rate: the age is true', () => {
  const shown = play({ clock: 'real', box: t => t + 12345 }, 30, 777);
  assert.ok(least(shown) > -0.001 && most(shown) < 0.006, `${least(shown)} ${most(shown)}`);
});

test('a simulated clock, slower than real time now more and now less: live is live', () => {
  // At .55 and .15 of real time, in turn.
  const box = (t: number) => 0.35 * t + 0.1 * Math.sin(2 * t);
  const shown = play({ clock: 'paced', box }, 40);
  assert.ok(shown.length > 200);
  for (const s of shown) {
    const since = s.true - exposed;  // it was sent
    assert.ok(s.age >= exposed + since - 1e-6, `${s.age} at ${s.t}`);
    assert.ok(s.age < exposed + since + tokenEvery + 0.01, `${s.age} at ${s.t}`);
    assert.ok(s.age < 0.35, `live: ${s.age}`);
  }
});

test('a simulated clock that catches up hides nothing', () => {
  // Stands for 90 ms of each second, then makes up for it at three times the rate.
  const box = (t: number) => {
    const part = t % 1;
    const after = Math.min(part, 0.8 + 3 * (part - 0.89));
    return t - part + (part < 0.8 ? part : part < 0.89 ? 0.8 : after);
  };
  const shown = play({ clock: 'paced', box }, 20);
  const since = shown.map(s => s.age - exposed - (s.true - exposed));
  assert.ok(Math.min(...since) > -1e-6, `${Math.min(...since)}`);
  assert.ok(Math.max(...since) < tokenEvery + 0.01, `${Math.max(...since)}`);
});

for (const clock of ['real', 'paced'] as const) {
  for (const late of [2, 5]) {
    test(`a line that is always ${late} s late, ${clock} clock: shown so at once`, () => {
      const shown = play({ clock, box: t => t + 50, down: () => late }, 60);
      assert.ok(shown.length > 300);
      assert.ok(least(shown) > -0.001, `${least(shown)}`);
      assert.ok(most(shown) < tokenEvery + 0.01, `${most(shown)}`);
    });
  }

  test(`a line that turns late and stays so, ${clock} clock`, () => {
    const down = (t: number) => t < 10 ? 0.004 : 2;
    const shown = play({ clock, box: t => t - 3, down }, 60);
    assert.ok(least(shown) > -0.001, `${least(shown)}`);
    for (const s of shown.filter(s => s.t > 12.2)) assert.ok(s.age > 2.09, `${s.age} at ${s.t}`);
  });

  test(`tokens that are late: shown too old, never too new, ${clock} clock`, () => {
    const shown = play({ clock, box: t => t, up: () => 0.5 }, 30);
    assert.ok(least(shown) > -0.001, `${least(shown)}`);
    assert.ok(most(shown) < 0.5 + tokenEvery + 0.01, `${most(shown)}`);
  });

  for (const step of [3, -3]) {
    test(`a clock that is set by ${step} s: not shown as newer, and true again, ${clock}`, () => {
      const shown = play({ clock, box: t => t + 100 + (t < 10 ? 0 : step) }, 30);
      assert.ok(least(shown) > -0.03, `${least(shown)}`);
      const after = shown.filter(s => s.t > 13);
      assert.ok(after.length > 100);
      assert.ok(most(after) < tokenEvery + 0.01, `${most(after)}`);
    });
  }
}

test('no echo, no age; and none of a connection before', () => {
  let now = 0;
  const store = new Store(() => now);
  let head: Head | null = null;
  store.on('picture', (_, h) => { head = h; });
  const pictureAge = () => store.age(head);
  const take = (bytes: Buffer) => {
    store.take(new Uint8Array(bytes).buffer as ArrayBuffer);
    store.flush();
  };
  const echo = view(7, 1, 5, -1, Buffer.from('{"id":1,"ok":true,"result":{"t":0.9}}'));
  const picture = (at: number) => take(view(4, 1, at, at - exposed, emptyPicture));
  now = 1;
  picture(4.9);
  assert.equal(pictureAge(), Infinity);
  take(echo);
  picture(5.1);
  assert.ok(Math.abs(pictureAge() - 0.2) < 1e-9, String(pictureAge()));
  now = 4;
  assert.ok(Math.abs(pictureAge() - 3.2) < 1e-9, 'it grows while nothing comes');
  store.reconnected();
  assert.equal(pictureAge(), Infinity);
  picture(0.1);
  assert.equal(pictureAge(), Infinity);
});

test('a slow page: a picture without colour does not overtake one with it', () => {
  const store = new Store(() => 1);
  const seen: string[] = [];
  store.on('picture', (picture, head) => seen.push(`${head.sequence} ${picture.jpeg !== null}`));
  const take = (sequence: number, colour: boolean) => {
    const body = Buffer.alloc(88 + (colour ? 1 : 0));
    if (colour) body.writeUInt32LE(1, 80);
    body.writeUInt8(colour ? 1 : 0, 84);
    store.take(new Uint8Array(view(4, sequence, 1, 1, body)).buffer as ArrayBuffer);
  };
  take(1, true);
  take(2, false);
  take(3, false);
  store.flush();
  assert.deepEqual(seen, ['1 true', '3 false']);
  take(4, false);
  take(5, true);
  store.flush();
  assert.deepEqual(seen.slice(2), ['5 true']);
});
