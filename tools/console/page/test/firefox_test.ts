// The page in Debian's Firefox, by WebDriver BiDi: firefox_test.mjs SITE ARTEFACTS. Firefox draws
// only with a display: Xvfb's. 77: no such browser here.
import assert from 'node:assert/strict';
import { ChildProcess, spawn } from 'node:child_process';
import { existsSync } from 'node:fs';
import { after, test } from 'node:test';
import { firefox } from 'playwright-core';
import { TwinBox } from '../twin/box';
import { Desk, seed, site, until } from './browser';
import { Key, LayoutName, triedLayouts } from './layouts';
import { Keyboard, keySuite, Modifiers } from './key_suite';

const program = '/usr/bin/firefox-esr';
const display = '/usr/bin/Xvfb';
const inputMethodCode = 229;

for (const file of [program, display]) {
  if (existsSync(file)) continue;
  console.log(`skipped: no ${file} (apt-get install firefox-esr xvfb)`);
  process.exit(77);
}
console.log(`seed ${seed}`);

// The number of a display that nobody has, told by Xvfb itself.
async function openDisplay(): Promise<{ child: ChildProcess; name: string }> {
  const child = spawn(display, ['-displayfd', '3', '-screen', '0', '1300x800x24', '-nolisten',
    'tcp'], { stdio: ['ignore', 'ignore', 'ignore', 'pipe'] });
  const name = await new Promise<string>((done, failed) => {
    child.stdio[3]!.once('data', text => done(`:${String(text).trim()}`));
    child.once('exit', code => failed(new Error(`Xvfb ended with ${code}`)));
  });
  return { child, name };
}

const screen = await openDisplay();
process.on('exit', () => screen.child.kill());
const twin = new TwinBox(site, seed);
await twin.listen();
const browser = await firefox.launch({ executablePath: program, channel: 'moz-firefox',
  headless: false, env: { ...process.env, DISPLAY: screen.name, LIBGL_ALWAYS_SOFTWARE: '1' } });
const context = await browser.newContext({ viewport: { width: 1280, height: 720 } });
const desk = await Desk.open(context, twin);
const { page } = desk;

after(async () => {
  await browser.close();
  await twin.close();
  screen.child.kill();
});

// BiDi's own keys know the place of a sign on a US keyboard alone.
async function send(type: 'keydown' | 'keyup', { key, code }: Key,
  { shift, ctrl, inputMethod }: Modifiers = {}): Promise<void> {
  await page.evaluate(([kind, init]) => {
    (document.activeElement ?? document.body).dispatchEvent(new KeyboardEvent(kind,
      { ...init, bubbles: true, cancelable: true, composed: true }));
  }, [type, { key, code, shiftKey: shift ?? false, ctrlKey: ctrl ?? false,
    keyCode: inputMethod ? inputMethodCode : 0 }] as const);
}

const keyboard: Keyboard = {
  down: (key, modifiers) => send('keydown', key, modifiers),
  up: (key, modifiers) => send('keyup', key, modifiers),
};

test('Firefox draws the room, and the picture is live', async () => {
  const figures = (await desk.figures())!;
  console.log(`renderer ${figures.renderer}, ${figures.triangles} triangles`);
  assert.equal(figures.damaged, 0);
  await desk.live();
});

test('Firefox: its own keys drive, and Space stops', async () => {
  await desk.engage();
  await page.focus('#canvas');
  await until('driving', async () => {
    await page.keyboard.down('w');
    await page.waitForTimeout(150);
    const driven = twin.plant.velocity[0] > 0;
    await page.keyboard.up('w');
    if (!driven) await desk.engage();
    return driven;
  });
  const stops = twin.count('stop');
  await page.keyboard.press('Space');
  await until('the stop, by socket and by request', () =>
    twin.count('stop') === stops + 1 && twin.stops > 0);
  await until('the base to stand', () => twin.plant.velocity.every(v => v === 0));
});

test('Firefox: a touch, a keep-out and its undo, by the pointer', async () => {
  await desk.tool('Touch');
  await desk.touch([1, -0.2, 0], () => twin.count('hand'));
  await desk.tool('Keep-out');
  await desk.drag([[1.5, 0, 0], [1.7, 0, 0]]);
  await until('the keep-out', () => twin.plant.obstacles.length === 1);
  await page.focus('#canvas');
  await page.keyboard.press('Control+z');
  await until('none', () => twin.plant.obstacles.length === 0);
});

const few: LayoutName[] = ['Russian'];
keySuite(desk, twin, keyboard, process.env.TELETACT_WHOLE ? triedLayouts : few);

test('Firefox: nothing went wrong', () => assert.deepEqual(desk.errors, []));
