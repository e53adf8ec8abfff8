// Keyboards of other people at the page, in whichever browser: no act moves the robot, driving
// places do nothing else, Space stops.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { driveKeys, letters } from '../src/act/key_meaning';
import { Intent } from '../twin/desk';
import { TwinBox } from '../twin/box';
import { Desk, until } from './browser';
import { Key, keyOf, keysOf, LayoutName } from './layouts';

export interface Modifiers { shift?: boolean; ctrl?: boolean; inputMethod?: boolean }

export interface Keyboard {
  down(key: Key, modifiers?: Modifiers): Promise<void>;
  up(key: Key, modifiers?: Modifiers): Promise<void>;
}

const space: Key = { key: ' ', code: 'Space' };

export function keySuite(desk: Desk, twin: TwinBox, keyboard: Keyboard,
  layouts: LayoutName[]): void {
  const { page } = desk;
  const press = async (key: Key, modifiers: Modifiers = {}) => {
    await keyboard.down(key, modifiers);
    await keyboard.up(key, modifiers);
  };
  // Back to the scene, from wherever a key has led.
  const scene = () => page.evaluate(() => {
    (document.getElementById('help') as HTMLDialogElement).close();
    document.getElementById('canvas')!.focus();
  });
  const acts = (since: Intent | undefined) => twin.intents
    .slice(since ? twin.intents.indexOf(since) + 1 : 0)
    .filter(i => i.act !== 'token' && i.act !== 'seen');
  // All that was asked before it has arrived with it.
  const undone = async (keys: Key[], since: Intent | undefined) => {
    await scene();
    await press(keyOf(keys, 'z'), { ctrl: true });
    await until('the undo', () => acts(since).some(i => i.act === 'undo'));
  };

  for (const name of layouts) {
    const keys = keysOf(name);
    test(`${name}: no key but those of driving moves the robot`, async () => {
      await desk.live();
      await desk.engage();
      const since = twin.intents.at(-1);
      const from = twin.plant.robot.join();
      for (const key of keys) {
        if (key.code in driveKeys) continue;
        await scene();
        await press(key);
        await scene();
        await press({ ...key, key: key.key.toUpperCase() }, { shift: true });
      }
      await undone(keys, since);
      assert.deepEqual(acts(since).filter(i => i.act === 'drive'), []);
      assert.equal(twin.plant.robot.join(), from);
      for (const act of ['engage', 'hold', 'clear', 'record']) {
        assert.ok(acts(since).filter(i => i.act === act).length >= 2, `${act}, also with Shift`);
      }
    });
    test(`${name}: each act by its letter, and tools by digits`, async () => {
      for (const act of ['engage', 'hold', 'clear', 'record'] as const) {
        const key = keyOf(keys, letters[act]);
        const since = twin.intents.at(-1);
        await scene();
        await press(key, { shift: key.code in driveKeys });
        await until(act, () => acts(since).some(i => i.act === act));
      }
      await scene();
      await press(keys.find(k => k.code === 'Digit2')!);
      await until('the tool', () => page.evaluate(() =>
        document.querySelector('#rail [aria-pressed=true]')!.textContent === 'Touch'));
    });
    test(`${name}: driving places drive, and are no act`, async () => {
      for (const key of keys) {
        const way = driveKeys[key.code];
        if (!way) continue;
        await desk.engage();
        await scene();
        let since = twin.intents.at(-1);
        // A machine too busy to send a token in time lets go, rightly: pressed again.
        await until(`${key.key} to drive`, async () => {
          since = twin.intents.at(-1);
          await keyboard.down(key);
          await page.waitForTimeout(60);
          await keyboard.up(key);
          return acts(since).some(i => i.act === 'drive' && Number(i.vx) * way[0]
            + Number(i.vy) * way[1] + Number(i.wz) * way[2] > 0);
        });
        await until('the base to stand', () => twin.plant.velocity.every(v => v === 0));
        assert.deepEqual(acts(since).filter(i => i.act !== 'drive'), [], key.key);
      }
    });
    test(`${name}: Space stops, while a place of driving is held too`, async () => {
      await desk.engage();
      await scene();
      await keyboard.down(keys.find(k => k.code === 'KeyW')!);
      const stops = twin.count('stop');
      await press(space);
      await until('the stop', () => twin.count('stop') === stops + 1);
      await keyboard.up(keys.find(k => k.code === 'KeyW')!);
      await until('the base to stand', () => twin.plant.velocity.every(v => v === 0));
    });
  }
  test('while an input method has the keys no act is done, and Space stops', async () => {
    await desk.engage();
    const since = twin.intents.at(-1);
    await scene();
    for (const code of ['KeyH', 'KeyG', 'KeyC', 'Digit2']) {
      await press({ key: 'Process', code }, { inputMethod: true });
    }
    await press({ key: 'Process', code: 'Space' }, { inputMethod: true });
    await until('the stop', () => acts(since).some(i => i.act === 'stop'));
    assert.deepEqual(acts(since).filter(i => i.act !== 'stop'), []);
  });
  test('the help names the keys of this person', async () => {
    await scene();
    for (const key of keysOf('French')) {
      if (key.code in driveKeys) await press(key);
    }
    await scene();
    await press({ key: '?', code: 'KeyM' }, { shift: true });
    await until('the keys', () => page.isVisible('#help'));
    const named = await page.locator('#help kbd').allTextContents();
    assert.ok(named.includes('Z S') && named.includes('Q D') && named.includes('A E'),
      named.join(', '));
    assert.ok(named.includes('Ctrl Z'));
    assert.match((await page.getAttribute('#canvas', 'aria-label'))!, /Z Q S D A E drive/);
    await scene();
  });
}
