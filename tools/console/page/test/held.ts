// What is held, without a browser: the clock is the test's.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { Drive } from '../src/act/drive';
import { GamepadHand } from '../src/act/gamepad';
import { Held } from '../src/act/held';
import { Pads } from '../src/act/pads';
import { Hold } from '../src/wire/types';
import { until } from './browser';

type Told = { act: string; keys: Record<string, unknown> };

function gamepad(down: number[], axes = [0, -1, 0, 0]): Gamepad {
  return { connected: true, mapping: 'standard', axes,
    buttons: Array.from({ length: 16 }, (_, i) => ({ pressed: down.includes(i) })),
  } as unknown as Gamepad;
}

function bench() {
  const told: Told[] = [];
  const lost: Hold[][] = [];
  const refused: string[] = [];
  const road = { tell: (act: string, keys: object) => {
    return told.push({ act, keys: keys as Record<string, unknown> });
  } };
  const clock = { now: 0 };
  const held = new Held(road, () => clock.now);
  held.onLost((_, holds) => lost.push(holds));
  const gate = { why: null as string | null };
  const pads: (Gamepad | null)[] = [];
  const drive = new Drive(road, held, { why: () => gate.why }, why => refused.push(why),
    new Pads(() => pads));
  const newest = () => told.filter(t => t.act === 'token').pop()?.keys.holds as Hold[];
  return { told, lost, refused, clock, held, drive, gate, pads, newest };
}

test('a token goes on while it is held, and says at once that it is not', async () => {
  const b = bench();
  b.held.press('hand');
  await until('tokens', () => b.told.length > 2);
  assert.deepEqual(b.newest(), ['hand']);
  b.held.release('hand');
  assert.deepEqual(b.newest(), []);
});
test('a browser that stood still lets go', async () => {
  const b = bench();
  b.held.press('drive');
  b.clock.now = 201;
  await until('the loss', () => b.lost.length > 0);
  assert.deepEqual(b.lost, [['drive']]);
  assert.equal(b.held.has('drive'), false);
  const count = b.told.length;
  await new Promise(done => setTimeout(done, 120));
  assert.equal(b.told.length, count, 'no token after it');
});
test('what the box has let go of is let go of here, once; older words do not count', () => {
  const b = bench();
  b.held.press('hand');
  const now = performance.now() / 1000;
  b.held.boxLost(['hand', 'drive'], now);
  b.held.boxLost(['hand'], -Infinity);
  assert.deepEqual(b.lost, []);
  b.held.boxLost(['drive'], now + 1);
  assert.ok(b.held.has('hand'));
  b.held.boxLost(['hand', 'drive'], now + 1);
  b.held.boxLost(['hand', 'drive'], now + 2);
  assert.deepEqual(b.lost, [['hand']]);
  assert.deepEqual(b.newest(), []);
});
test('a press anew begins with a token that lets go', () => {
  const b = bench();
  b.held.press('engage');
  const before = b.told.length;
  b.held.pressAnew('engage');
  assert.deepEqual(b.told.slice(before).map(t => t.keys.holds), [[], ['engage']]);
  b.held.release('engage');
});
test('a refused command lets go once, and an older one of no press says nothing', () => {
  const b = bench();
  b.drive.press('KeyW', [1, 0, 0]);
  b.drive.press('KeyQ', [0, 0, 1]);
  const ids = b.told.flatMap((x, k) => x.act === 'drive' ? [k + 1] : []);
  assert.ok(ids.length >= 2);
  assert.equal(b.drive.wasRefused(ids[0]!, 'the picture is 1.2 s old'), true);
  assert.equal(b.drive.wasRefused(ids[1]!, 'the picture is 1.2 s old'), true);
  assert.deepEqual(b.lost, [['drive']]);
  assert.equal(b.drive.driving, false);
  assert.equal(b.drive.wasRefused(b.told.length + 1, 'nothing is held'), false);
});
test('after a freeze the command whose timer is first does not go', () => {
  const b = bench();
  b.drive.press('KeyW', [1, 0, 0]);
  b.drive.press('KeyQ', [0, 0, 1]);
  const before = b.told.filter(x => x.act === 'drive').length;
  b.clock.now = 201;
  b.drive.release('KeyQ');  // a command at once, before the token's timer has run
  assert.deepEqual(b.lost, [['drive']]);
  assert.equal(b.told.filter(x => x.act === 'drive').length, before);
  assert.deepEqual(b.newest(), []);
});
test('after a freeze a press holds what is pressed, and nothing from before', () => {
  const b = bench();
  b.held.press('engage');
  b.held.press('hand');
  b.clock.now = 201;
  b.held.press('drive');
  assert.deepEqual(b.lost, [['engage', 'hand']]);
  assert.deepEqual(b.newest(), ['drive']);
  b.clock.now = 402;
  b.held.release('hand');
  assert.deepEqual(b.newest(), []);
});
test('keys add up, and the last one up ends', () => {
  const b = bench();
  assert.ok(b.drive.press('KeyW', [1, 0, 0]));
  b.drive.press('KeyQ', [0, 0, 1]);
  assert.deepEqual(b.told.filter(x => x.act === 'drive').pop()!.keys,
    { vx: 0.3, vy: 0, wz: 0.6 });
  b.drive.release('KeyW');
  assert.ok(b.drive.driving);
  b.drive.release('KeyQ');
  assert.equal(b.drive.driving, false);
  assert.deepEqual(b.told.filter(x => x.act === 'drive').pop()!.keys, { vx: 0, vy: 0, wz: 0 });
});
test('what is locked does not start, and what locks meanwhile ends', async () => {
  const b = bench();
  b.gate.why = 'the picture is frozen';
  assert.equal(b.drive.press('KeyW', [1, 0, 0]), false);
  assert.equal(b.told.length, 0);
  b.gate.why = null;
  b.drive.press('KeyW', [1, 0, 0]);
  b.gate.why = 'the picture is frozen';
  await until('the loss', () => b.lost.length > 0);
  assert.equal(b.drive.driving, false);
  b.drive.releaseAll();
});
test('a gamepad drives by its dead-man button, and not by its stick alone', () => {
  const b = bench();
  const poll = (pad: Gamepad | null) => {
    b.pads[0] = pad;
    b.drive.pollGamepad();
  };
  poll(gamepad([]));
  assert.equal(b.drive.driving, false);
  poll(gamepad([5]));
  assert.ok(b.drive.driving);
  b.held.lose('the gamepad was lost', ['drive']);
  poll(gamepad([5]));
  assert.equal(b.drive.driving, false, 'still pressed is not a new press');
  poll(gamepad([]));
  poll(gamepad([5]));
  assert.ok(b.drive.driving);
  poll(null);
  assert.equal(b.drive.driving, false);
});
test('where no frame is drawn the release of the dead-man button is seen', async () => {
  const b = bench();
  b.pads[0] = gamepad([5]);
  b.drive.pollGamepad();
  assert.ok(b.drive.driving);
  b.pads[0] = gamepad([]);
  await until('the end of driving', () => !b.drive.driving);
  assert.deepEqual(b.newest(), []);
});
test('a gamepad moves the cross-hair and presses there, but not while it drives', () => {
  const clock = { now: 0 };
  const pads: (Gamepad | null)[] = [gamepad([])];
  const moves: [number, number][] = [];
  const presses: string[] = [];
  const hand = new GamepadHand(new Pads(() => pads), { moveCross: (dx, dy) => moves.push([dx, dy]),
    pressCross: () => presses.push('down'),
    releaseCross: lost => presses.push(lost ? 'lost' : 'up') },
  { focus: () => presses.push('focus') }, () => clock.now);
  const poll = (pad: Gamepad | null) => {
    clock.now += 50;
    pads[0] = pad;
    hand.poll();
  };
  poll(gamepad([]));
  assert.deepEqual(moves, [[0, -20]]);
  poll(gamepad([0], [1, 0, 0, 0]));
  poll(gamepad([0], [0.1, 0.1, 0, 0]));
  assert.deepEqual(moves, [[0, -20], [20, 0]]);
  assert.deepEqual(presses, ['focus', 'down']);
  poll(gamepad([]));
  poll(gamepad([0, 5]));
  assert.equal(moves.length, 3, 'the sticks drive');
  poll(null);
  assert.deepEqual(presses, ['focus', 'down', 'up', 'focus', 'down', 'lost']);
});
