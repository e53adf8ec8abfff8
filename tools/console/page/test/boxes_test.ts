// The page of `teletact operator`, in a real browser, while the robot's box is killed and started
// again: boxes_test.mjs SITE ARTEFACTS TELETACT COSTS. Two processes on the real clock that know
// each other only by the road. 77: no browser, or no cores for them here.
import assert from 'node:assert/strict';
import { ChildProcess, spawn } from 'node:child_process';
import { mkdtempSync, rmSync } from 'node:fs';
import { AddressInfo, createServer } from 'node:net';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { after, test } from 'node:test';
import { chromiumProgram, Desk, launch, site, until as waitUntil } from './browser';

if (!chromiumProgram()) {
  console.log('skipped: no chromium (apt-get install chromium)');
  process.exit(77);
}

const [program, costs] = process.argv.slice(4) as [string, string];
const driven = 0.1;  // m by the pad
const longestPress = 8000;  // ms
const patient = 150000;     // ms, of a way that is driven

const folder = mkdtempSync(join(tmpdir(), 'teletact_boxes_'));

async function unusedPort(): Promise<number> {
  const server = createServer();
  await new Promise<void>(done => server.listen(0, '127.0.0.1', done));
  const { port } = server.address() as AddressInfo;
  await new Promise(done => server.close(done));
  return port;
}
const place = `127.0.0.1:${await unusedPort()}`;

// A box's program, started as often as the story wants.
class BoxProgram {
  said = '';
  private child: ChildProcess | null = null;
  private ended: Promise<unknown> = Promise.resolve();

  constructor(private readonly box: string, private readonly words: string[]) {}

  start(): void {
    const child = spawn(program, [this.box, '--plain', ...this.words, '--calibration', costs,
      '--report', join(folder, this.box)],
    { env: { ...process.env, XDG_RUNTIME_DIR: folder }, stdio: ['ignore', 'pipe', 'pipe'] });
    for (const stream of [child.stdout!, child.stderr!])
      stream.on('data', text => { this.said += String(text); });
    this.ended = new Promise(done => child.on('exit', done));
    this.child = child;
  }

  send(signal: NodeJS.Signals): void { this.child!.kill(signal); }

  async kill(signal: NodeJS.Signals): Promise<void> {
    this.child!.kill(signal);
    await this.ended;
  }

  // What is left of it, if a test threw.
  end(): void { if (this.runs()) this.child!.kill('SIGKILL'); }

  runs(): boolean { return this.child!.exitCode === null; }
}

const robot = new BoxProgram('robot', ['--listen', place]);
const op = new BoxProgram('operator', ['--robot-address', place, '--console', '--console-port',
  '0', '--page', site, '--set', 'operator.engage_after_s=3600', '--set',
  'operator.re_engage_after_s=0', '--set', 'hand.start_after_s=3600']);
process.on('exit', () => { for (const box of [op, robot]) box.end(); });
robot.start();
op.start();
await waitUntil('the address of the page', () => {
  for (const box of [op, robot]) {
    if (box.runs()) continue;
    if (!box.said.includes('not registered')) throw new Error(`a box ended:\n${box.said}`);
    console.log('skipped: the cores are taken');
    process.exit(77);
  }
  return /console: \S+\n/.test(op.said);
});
const browser = await launch();
const context = await browser.newContext({ viewport: { width: 800, height: 540 },
  colorScheme: 'dark' });
const desk = await Desk.open(context, null, /console: (\S+)\n/.exec(op.said)![1]!);
const { page } = desk;

after(async () => {
  await browser.close();
  await op.kill('SIGTERM');
  await robot.kill('SIGTERM');
  rmSync(folder, { recursive: true });
});

// What fails says what the page said last.
async function until(what: string, holds: () => boolean | Promise<boolean>,
  longest?: number): Promise<void> {
  try {
    await waitUntil(what, holds, longest);
  } catch (error) {
    const texts = [];
    for (const id of ['chips', 'toasts', 'pane-health', 'pane-timeline'])
      texts.push(`${id}: ${await page.textContent(`#${id}`)}`);
    throw new Error(`${String(error)}\n${texts.join('\n')}`);
  }
}

const chips = async () => (await page.textContent('#chips'))!;
// The reason that the page gives for what does not move.
async function saysSilent(): Promise<void> {
  await page.click('#tabs button:has-text("Health")');
  await until('the reason', async () =>
    (await page.textContent('#pane-health'))!.includes('the link is silent'));
}
const locked = () => page.evaluate(() =>
  document.getElementById('view')!.classList.contains('frozen'));

async function position(): Promise<[number, number]> {
  const row = (await page.textContent('#pane-scene .row:has-text("Robot")'))!;
  const numbers = /(-?\d+\.\d+), (-?\d+\.\d+)/.exec(row)!;
  return [Number(numbers[1]), Number(numbers[2])];
}

// A box whose tasks this machine keeps from running for too long goes into a safe stop, rightly:
// the page says why, and a person clears it and engages again.
async function engages(): Promise<void> {
  await until('engaged', async () => {
    if ((await chips()).includes('engaged')) return true;
    if ((await chips()).includes('safe stop')) {
      console.log(`cleared: ${await page.getAttribute('#chips > :first-child', 'title')}`);
      await page.click('#commands button:has-text("Clear")');
      await page.waitForTimeout(1500);
    }
    await page.click('#commands button:has-text("Engage")');
    await page.waitForTimeout(500);
    return (await chips()).includes('engaged');
  }, patient);
}

// What is held ends, rightly, where the machine is too busy to send a token within 200 ms: then it
// is pressed again.
async function drives(): Promise<void> {
  await page.click('#tabs button:has-text("Scene")');
  const from = await position();
  const pad = (await page.locator('#pad button[aria-label^="Drive forwards"]').boundingBox())!;
  await until('the way', async () => {
    await desk.live();
    await engages();
    await page.mouse.move(pad.x + pad.width / 2, pad.y + pad.height / 2);
    await page.mouse.down();
    const end = Date.now() + longestPress;
    let way = 0;
    while (way < driven && Date.now() < end) {
      await page.waitForTimeout(100);
      const [x, y] = await position();
      way = Math.hypot(x - from[0], y - from[1]);
    }
    await page.mouse.up();
    return way >= driven;
  }, patient);
}

test('the base drives by the pad', async () => {
  await engages();
  await drives();
});

test('the robot\'s box stands still for 2 s: its safe stop is told, cleared, and driven after',
  async () => {
    await page.click('#commands button:has-text("Hold")');
    robot.send('SIGSTOP');
    await until('the lock', locked);
    await page.waitForTimeout(2000);
    robot.send('SIGCONT');
    await until('the chip', async () => (await chips()).includes('Robot safe stop'));
    await page.click('#tabs button:has-text("Health")');
    await until('the cause', async () =>
      (await page.textContent('#pane-health'))!.includes('at the robot: '));
    await desk.shot('robot_stopped');
    await until('the lock to end', async () => !await locked());
    // Just after it, nothing comes from it yet, or the modes have not settled: asked again.
    let asked = 0;
    await until('the reason', async () => {
      if (Date.now() - asked > 1500) {
        await page.click('#commands button:has-text("Engage")');
        asked = Date.now();
      }
      return /the robot's box is in a safe stop, F-.*: clear it first/.test(
        (await page.textContent('#toasts'))!);
    });
    await drives();
  });

test('the operator\'s box stands still for 2 s: driven after, by who clears it', async () => {
  await engages();
  op.send('SIGSTOP');
  await page.waitForTimeout(2000);
  op.send('SIGCONT');
  await drives();
});

test('the robot is killed: locked, and said why', async () => {
  await robot.kill('SIGKILL');
  await until('the lock', locked);
  await until('no engagement', async () => !(await chips()).includes('engaged'));
  await saysSilent();
  await page.click('#commands button:has-text("Engage")');
  await page.waitForTimeout(1000);
  assert.ok(!(await chips()).includes('engaged'), 'engaged with a robot that is not there');
  await desk.shot('robot_killed');
});

test('it is started again: live, not engaged by itself, and driven after a new press', async () => {
  robot.start();
  await until('the lock to end', async () => !await locked());
  await page.waitForTimeout(1000);
  assert.ok(!(await chips()).includes('engaged'), 'engaged by itself');
  await drives();
  await page.keyboard.press('Space');
  await until('the stop', async () => (await chips()).includes('Hold'));
});

test('it is killed in hold, where no mode changes: locked, and said why', async () => {
  await robot.kill('SIGKILL');
  await until('the lock', locked);
  await saysSilent();
  robot.start();
  await until('the lock to end', async () => !await locked());
  assert.deepEqual(desk.errors, []);
});
