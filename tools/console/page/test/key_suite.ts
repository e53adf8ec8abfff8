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
const told = ['engage', 'hold', 'clear', 'record'] as const;  // acts of which the box hears

class Trial {
  constructor(private readonly desk: Desk, private readonly twin: TwinBox,
    private readonly keyboard: Keyboard) {}

  async noActMoves(keys: Key[]): Promise<void> {
    this.twin.plant.drop();  // a goal of a test before: it is engaged here
    await this.desk.live();
    await this.desk.engage();
    await this.stands();
    const since = this.twin.intents.at(-1);
    const from = this.twin.plant.robot.join();
    for (const key of keys) {
      if (key.code in driveKeys) continue;
      await this.toScene();
      await this.press(key);
      await this.toScene();
      await this.press({ ...key, key: key.key.toUpperCase() }, { shift: true });
    }
    // All that was asked before it has arrived with it.
    await this.toScene();
    await this.press(keyOf(keys, 'z'), { ctrl: true });
    await until('the undo', () => this.acts(since).some(i => i.act === 'undo'));
    assert.deepEqual(this.acts(since).filter(i => i.act === 'drive'), []);
    assert.equal(this.twin.plant.robot.join(), from);
    for (const act of told) {
      const letter = keyOf(keys, letters[act]);
      const least = letter.code in driveKeys ? 0 : 2;
      assert.ok(this.acts(since).filter(i => i.act === act).length >= least,
        `${act}, also with Shift`);
    }
  }

  async eachActAndTool(keys: Key[]): Promise<void> {
    for (const act of told) {
      const key = keyOf(keys, letters[act]);
      const since = this.twin.intents.at(-1);
      await this.toScene();
      await this.press(key, { shift: key.code in driveKeys });
      await until(act, () => this.acts(since).some(i => i.act === act));
    }
    for (const [code, tool] of [['Digit3', 'Mark'], ['Digit2', 'Touch']]) {
      await this.toScene();
      await this.press(keys.find(k => k.code === code)!);
      await until(`tool ${tool}`, () => this.desk.page.evaluate(name =>
        document.querySelector('#rail [aria-pressed=true]')!.textContent === name, tool));
    }
  }

  async placesDrive(keys: Key[]): Promise<void> {
    for (const key of keys) {
      const way = driveKeys[key.code];
      if (!way) continue;
      await this.desk.engage();
      await this.toScene();
      let since: Intent | undefined;
      // A machine too busy to send a token in time lets go, rightly: pressed again.
      await until(`${key.key} to drive`, async () => {
        since = this.twin.intents.at(-1);
        await this.press(key);
        return this.acts(since).some(i => i.act === 'drive' && Number(i.vx) * way[0]
          + Number(i.vy) * way[1] + Number(i.wz) * way[2] > 0);
      });
      assert.deepEqual(this.acts(since).filter(i => i.act !== 'drive'), [], key.key);
    }
    await this.stands();
  }

  async spaceStops(keys: Key[]): Promise<void> {
    const forward = keys.find(k => k.code === 'KeyW')!;
    await this.desk.engage();
    await this.toScene();
    await this.keyboard.down(forward);
    const stops = this.twin.count('stop');
    await this.press(space);
    await until('the stop', () => this.twin.count('stop') === stops + 1);
    await this.keyboard.up(forward);
    await this.stands();
  }

  // While it is down macOS tells of no key that is let go.
  async metaLetsGo(): Promise<void> {
    const forward: Key = { key: 'w', code: 'KeyW' };
    const meta: Key = { key: 'Meta', code: 'MetaLeft' };
    await this.desk.engage();
    await this.toScene();
    const since = this.twin.intents.at(-1);
    await this.keyboard.down(forward);
    await until('driving', () => this.acts(since).some(i => i.act === 'drive'));
    await this.keyboard.down(meta);
    await until('the token without it', () => {
      const token = this.twin.newest('token')!;
      return !(token.holds as string[]).includes('drive');
    });
    await this.stands();
    await this.keyboard.up(meta);
    await this.keyboard.up(forward);
  }

  async inputMethod(): Promise<void> {
    await this.desk.engage();
    const since = this.twin.intents.at(-1);
    await this.toScene();
    for (const code of ['KeyH', 'KeyG', 'KeyC', 'Digit2']) {
      await this.press({ key: 'Process', code }, { inputMethod: true });
    }
    await this.press({ key: 'Process', code: 'Space' }, { inputMethod: true });
    await until('the stop', () => this.acts(since).some(i => i.act === 'stop'));
    assert.deepEqual(this.acts(since).filter(i => i.act !== 'stop'), []);
  }

  async helpNames(): Promise<void> {
    const { page } = this.desk;
    await this.toScene();
    for (const key of keysOf('French')) if (key.code in driveKeys) await this.press(key);
    await this.toScene();
    await this.press({ key: '?', code: 'KeyM' }, { shift: true });
    await until('the keys', () => page.isVisible('#help'));
    const named = await page.locator('#help kbd').allTextContents();
    for (const name of ['Z S', 'Q D', 'A E', 'Ctrl Z']) assert.ok(named.includes(name), name);
    assert.match((await page.getAttribute('#canvas', 'aria-label'))!, /Z Q S D A E drive/);
    await this.toScene();
  }

  private async press(key: Key, modifiers: Modifiers = {}): Promise<void> {
    await this.keyboard.down(key, modifiers);
    await this.keyboard.up(key, modifiers);
  }

  // From wherever a key has led.
  private toScene(): Promise<void> {
    return this.desk.page.evaluate(() => {
      (document.getElementById('help') as HTMLDialogElement).close();
      document.getElementById('canvas')!.focus();
    });
  }

  private stands(): Promise<void> {
    return until('the base to stand', () => this.twin.plant.velocity.every(v => v === 0));
  }

  private acts(since: Intent | undefined): Intent[] {
    return this.twin.intents.slice(since ? this.twin.intents.indexOf(since) + 1 : 0)
      .filter(i => i.act !== 'token');
  }
}

export function keySuite(desk: Desk, twin: TwinBox, keyboard: Keyboard,
  layouts: LayoutName[]): void {
  const trial = new Trial(desk, twin, keyboard);
  for (const name of layouts) {
    const keys = keysOf(name);
    test(`${name}: no key but those of driving moves the robot`, () => trial.noActMoves(keys));
    test(`${name}: acts by letter, tools by digits`, () => trial.eachActAndTool(keys));
    test(`${name}: driving places drive, and are no act`, () => trial.placesDrive(keys));
    test(`${name}: Space stops, while a place of driving is held too`,
      () => trial.spaceStops(keys));
  }
  test('while an input method has the keys no act is done, and Space stops',
    () => trial.inputMethod());
  test('the key of the system lets go of driving', () => trial.metaLetsGo());
  test('the help names the keys of this person', () => trial.helpNames());
}
