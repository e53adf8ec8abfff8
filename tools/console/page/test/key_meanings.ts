// What a press means on each keyboard, without a browser.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { driveKeys, isStop, letters, meaningOf, Press } from '../src/act/key_meaning';
import { KeyNames } from '../src/act/key_names';
import { keyOf, keysOf, layoutNames } from './layouts';

function press(key: string, code: string, more: Partial<Press> = {}): Press {
  return { key, code, shiftKey: false, ctrlKey: false, metaKey: false, altKey: false,
    isComposing: false, keyCode: 0, ...more };
}

for (const name of layoutNames) {
  const keys = keysOf(name);
  test(`${name}: driving places drive and are no act, and no other place drives`, () => {
    for (const { key, code } of keys) {
      const meaning = meaningOf(press(key, code));
      assert.equal(meaning?.kind === 'drive', code in driveKeys, `${key} at ${code}`);
      const upper = meaningOf(press(key.toUpperCase(), code, { shiftKey: true }));
      assert.ok(upper?.kind !== 'drive' || code in driveKeys, `Shift ${key} at ${code}`);
    }
  });
  test(`${name}: each act by its letter, with Shift everywhere; undo by Ctrl alone`, () => {
    for (const [act, letter] of Object.entries(letters)) {
      const { key, code } = keyOf(keys, letter);
      const upper = press(key.toUpperCase(), code, { shiftKey: true });
      assert.deepEqual(meaningOf(upper), { kind: 'act', act }, `Shift ${key}`);
      if (code in driveKeys) continue;
      assert.deepEqual(meaningOf(press(key, code)), { kind: 'act', act }, key);
    }
    const { key, code } = keyOf(keys, 'z');
    for (const way of [{ ctrlKey: true }, { metaKey: true }]) {
      assert.deepEqual(meaningOf(press(key, code, way)), { kind: 'act', act: 'undo' });
    }
    for (const way of [{}, { ctrlKey: true, shiftKey: true }, { ctrlKey: true, altKey: true }]) {
      const meaning = meaningOf(press(key, code, way));
      assert.ok(meaning?.kind !== 'act', 'undo with other keys, or none');
    }
  });
  test(`${name}: tools by their digits' places, without Shift`, () => {
    for (const digit of '1234567') {
      const { key, code } = keys.find(k => k.code === `Digit${digit}`)!;
      assert.deepEqual(meaningOf(press(key, code)), { kind: 'tool', digit });
    }
  });
}

test('digits with Shift, and of the number pad', () => {
  const two = { kind: 'tool', digit: '2' };
  assert.deepEqual(meaningOf(press('2', 'Digit2', { shiftKey: true })), two, 'French');
  assert.deepEqual(meaningOf(press('2', 'Numpad2')), two);
  assert.equal(meaningOf(press('@', 'Digit2', { shiftKey: true })), null, 'US');
  assert.deepEqual(meaningOf(press('٢', 'Digit2')), two, 'Arabic');
  assert.deepEqual(meaningOf(press('+', 'Digit1', { shiftKey: true })),
    { kind: 'act', act: 'nearer' }, 'Swiss');
});

test('capital letters without Shift are those of Caps Lock', () => {
  assert.deepEqual(meaningOf(press('G', 'KeyW')), { kind: 'drive', command: [1, 0, 0] });
  assert.deepEqual(meaningOf(press('G', 'KeyG')), { kind: 'act', act: 'engage' });
});

test('of an input method nothing but driving and the stop is taken', () => {
  for (const way of [{ keyCode: 229 }, { isComposing: true }]) {
    for (const [key, code] of [['h', 'KeyH'], ['Process', 'KeyG'], ['ㅎ', 'KeyG'], ['2', 'Digit2'],
      ['Process', 'Digit2'], ['Delete', 'Delete'], ['?', 'Slash']] as const) {
      assert.equal(meaningOf(press(key, code, way)), null, `${key} ${code}`);
    }
    assert.equal(meaningOf(press('z', 'KeyZ', { ctrlKey: true, ...way })), null);
    assert.equal(meaningOf(press('Process', 'KeyW', way))?.kind, 'drive');
    assert.ok(isStop(press('Process', 'Space', way)));
  }
});

test('a space is one by its place and by what it prints', () => {
  assert.ok(isStop(press(' ', 'Space')));
  assert.ok(isStop(press('\u00a0', 'Space', { shiftKey: true })));
  assert.ok(isStop(press(' ', '')));
  assert.ok(!isStop(press('h', 'KeyH')));
});

test('names of keys: told by the browser', async () => {
  const names = new KeyNames();
  let changes = 0;
  names.onChange = () => ++changes;
  assert.equal(names.known, false);
  assert.equal(names.place('KeyW'), 'W');
  await names.ask({ getLayoutMap: async () =>
    new Map(keysOf('French').map(k => [k.code, k.key])) });
  assert.equal(changes, 1);
  assert.equal(names.known, true);
  assert.deepEqual(['KeyW', 'KeyA', 'KeyS', 'KeyD', 'KeyQ', 'KeyE'].map(c => names.place(c)),
    ['Z', 'Q', 'S', 'D', 'A', 'E']);
  assert.equal(names.letter('g'), 'G');
  await names.ask({ getLayoutMap: () => Promise.reject(new Error('not here')) });
  assert.equal(names.place('KeyW'), 'Z');
});

test('names of keys: learned from what is pressed, and anew after another layout', async () => {
  const names = new KeyNames();
  await names.ask({ getLayoutMap: async () => new Map(keysOf('US').map(k => [k.code, k.key])) });
  for (const { key, code } of keysOf('Turkish F')) names.learn(press(key, code));
  assert.equal(names.place('KeyW'), 'G');
  assert.equal(names.letter('g'), 'Shift G');
  assert.equal(names.letter('h'), 'H');
  names.learn(press('ц', 'KeyW'));
  assert.equal(names.place('KeyW'), 'Ц (W)');
  assert.equal(names.place('KeyQ'), 'Q', 'pressed before it, so of the layout before');
  assert.equal(names.known, false);
  names.learn(press('й', 'KeyQ'));
  names.learn(press('ф', 'KeyA'));
  assert.deepEqual(['KeyQ', 'KeyW', 'KeyA'].map(code => names.place(code)),
    ['Й (Q)', 'Ц (W)', 'Ф (A)'], 'what was learned since is kept');
  names.learn(press('п', 'KeyG'));
  assert.equal(names.letter('g'), 'П (G)');
  for (const [key, code, more] of [['Dead', 'KeyE', {}], ['Process', 'KeyE', {}],
    ['$', 'KeyE', { shiftKey: true }], ['a', 'KeyE', { ctrlKey: true }],
    ['a', 'KeyE', { isComposing: true }]] as const) {
    names.learn(press(key, code, more));
  }
  assert.notEqual(names.place('KeyE'), 'A', 'no key of these names one');
  assert.notEqual(names.place('KeyE'), '$');
});
