// The page in a real browser against the real box, as a person's first run has it:
// real_test.mjs SITE ARTEFACTS TELETACT. Simulated time, paced by the real clock. 77: no browser.
import assert from 'node:assert/strict';
import { ChildProcess, spawn } from 'node:child_process';
import { mkdtempSync, rmSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { after, test } from 'node:test';
import { chromiumProgram, Desk, launch, site, until } from './browser';

if (!chromiumProgram()) {
  console.log('skipped: no chromium (apt-get install chromium)');
  process.exit(77);
}

const longestRun = 600;       // s
const longestStart = 240000;  // ms: a machine that was never calibrated is, at first
const restingTouch = 1000;    // ms at least
const driven = 0.15;          // m by the pad

const folder = mkdtempSync(join(tmpdir(), 'teletact_real_'));
const box: ChildProcess = spawn(process.argv[4]!, ['demo', '--console', '--console-port', '0',
  '--page', site, '--clock', 'paced', '--seconds', String(longestRun), '--report',
  join(folder, 'report')], { stdio: ['ignore', 'pipe', 'inherit'] });
let said = '';
box.stdout!.on('data', text => { said += String(text); });
const ended = new Promise(done => box.on('exit', done));
await until('the address of the page', () => {
  if (box.exitCode !== null) throw new Error(`the box ended:\n${said}`);
  return /console: \S+\n/.test(said);
}, longestStart);
const url = /console: (\S+)\n/.exec(said)![1]!;
const browser = await launch();
const context = await browser.newContext({ viewport: { width: 1000, height: 640 },
  colorScheme: 'dark' });
const desk = await Desk.open(context, null, url);
const { page } = desk;

after(async () => {
  await browser.close();
  box.kill('SIGINT');
  await ended;
  rmSync(folder, { recursive: true });
});

const row = (name: string) => page.textContent(`#pane-scene .row:has-text("${name}")`);

async function place(): Promise<[number, number]> {
  const numbers = /(-?\d+\.\d+), (-?\d+\.\d+)/.exec((await row('Robot'))!)!;
  return [Number(numbers[1]), Number(numbers[2])];
}

// What is held ends, rightly, where the machine is too busy to send a token within 200 ms: then
// it is pressed again.
async function pressing(what: string, at: [number, number], least: number,
  holds: () => Promise<boolean>): Promise<void> {
  await until(what, async () => {
    await page.mouse.move(...at);
    await page.mouse.down();
    const from = Date.now();
    let done = false;
    while (Date.now() - from < 8000 && !(done && Date.now() - from >= least)) {
      await page.waitForTimeout(100);
      done = done || await holds();
    }
    await page.mouse.up();
    return done;
  });
}

test('the border of the picture says that it is live', async () => {
  await until('a live picture', () => page.evaluate(() => {
    const inset = document.getElementById('inset')!;
    return inset.classList.contains('fresh') && inset.textContent!.includes('Live');
  }));
});

test('a pointer that rests on the floor touches it', async () => {
  await desk.tool('Touch');
  const ticked = () => page.evaluate(() =>
    document.querySelector('#steps li')!.classList.contains('done'));
  assert.equal(await ticked(), false);
  await pressing('the touch', await desk.screen([1, 0.9, 0]), restingTouch, ticked);
});

test('a mark is drawn, and undone it is none', async () => {
  await desk.tool('Mark');
  await desk.drag([[1.2, 0.9, 0], [1.25, 0.9, 0], [1.3, 0.85, 0]]);
  await until('the mark', async () => (await page.textContent('#pane-scene'))!.includes('Mark 1'));
  await until('its goal', async () => !(await row('Goal'))!.includes('not known'));
  await page.click('#commands button:has-text("Undo")');
  await until('no mark', async () => !(await page.textContent('#pane-scene'))!.includes('Mark 1'));
  await until('no goal', async () => (await row('Goal'))!.includes('not known'));
});

test('the base drives by the pad, and stands when it is let go', async () => {
  await desk.engage();
  const from = await place();
  const way = async () => {
    const [x, y] = await place();
    return Math.hypot(x - from[0], y - from[1]);
  };
  const pad = (await page.locator('#pad button[aria-label^="Drive forwards"]').boundingBox())!;
  await until('the way', async () => {
    await desk.live();
    await desk.engage();
    await pressing('driving', [pad.x + pad.width / 2, pad.y + pad.height / 2], 0,
      async () => await way() > driven);
    return true;
  });
  await page.keyboard.press('Space');
  await until('the stop', async () => (await page.textContent('#chips'))!.includes('Hold'));
  assert.deepEqual(desk.errors, []);
});
