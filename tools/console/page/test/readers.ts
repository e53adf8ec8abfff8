// Damaged views: read, or left out and counted, and never anything else.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { Store } from '../src/wire/store';
import { bits, cutBlocks, floats, meshBody, shoot, view } from '../twin/encode';
import { makeBodies, randomFrom } from '../twin/world';
import { seed } from './browser';

const rounds = 1500;

function samples(): Buffer[] {
  const bodies = makeBodies(1);
  const head = Buffer.alloc(8);
  head.writeUInt16LE(20, 0);
  head.writeUInt16LE(10, 2);
  const json = (value: object) => Buffer.from(JSON.stringify(value));
  const cost = Buffer.concat([Buffer.from([4, 0, 3, 0]), floats(0.05),
    Buffer.from(new Float64Array([0, 0, 0, 1, 0, 0, 0]).buffer), Buffer.alloc(12)]);
  return [
    view(1, 1, 1, 1, json({ mode: 'hold' })),
    view(2, 1, 1, 1, Buffer.alloc(160)),
    view(3, 1, 1, 1, meshBody(cutBlocks(bodies).slice(0, 3), 1, true)),
    view(4, 1, 1, 1, shoot(bodies, [0, 0, 1], [0.5, -0.5, 0.5, -0.5]).body),
    view(5, 1, 1, 1, cost),
    view(6, 1, 1, 1, Buffer.concat([Buffer.from([1, 0]), floats(1, 2)])),
    view(7, 1, 1, 1, json({ id: 1, ok: true })),
    view(8, 1, 1, 1, Buffer.concat([head, bits(new Array<boolean>(200).fill(true))])),
  ];
}

function asArray(bytes: Buffer): ArrayBuffer {
  return new Uint8Array(bytes).buffer as ArrayBuffer;
}

test('views from the box, damaged', () => {
  const random = randomFrom(seed);
  const good = samples();
  const store = new Store();
  let heard = 0;
  for (const topic of ['text', 'pose', 'mesh', 'picture', 'costMap', 'moving', 'answer',
    'selection'] as const) store.on(topic, () => ++heard);
  for (const bytes of good) {
    store.take(asArray(bytes));
    store.flush();
  }
  assert.equal(heard, good.length);
  assert.equal(store.damaged, 0);
  assert.equal(store.selection!.mask.reduce((sum, bit) => sum + bit, 0), 200);

  const warn = console.warn;
  console.warn = () => {};
  for (let i = 0; i < rounds; ++i) {
    const bytes = Buffer.from(good[Math.floor(random() * good.length)]!);
    const kind = random();
    const cut = kind < 0.5 ? bytes.subarray(0, Math.floor(random() * bytes.length)) : bytes;
    for (let k = 0; k < 4 && cut.length > 0; ++k) {
      cut[Math.floor(random() * Math.min(cut.length, 200))] = Math.floor(256 * random());
    }
    store.take(asArray(cut));
    store.flush();
  }
  console.warn = warn;
  assert.ok(store.damaged > rounds / 10, `${store.damaged} left out`);
});
