// The real box, as a person's first run has it, and a browser on its page: one for all tests of
// real_test.mjs SITE ARTEFACTS TELETACT SCENE [replays]. Simulated time, paced by the real clock.
import { ChildProcess, spawn } from 'node:child_process';
import { mkdtempSync, rmSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { after } from 'node:test';
import { readHead, readJson, readPicture, readPose, readSelection } from '../src/wire/decode';
import { Kind, Picture, Pose, Selection, Slow } from '../src/wire/types';
import { chromiumProgram, Desk, launch, seed, site, until as waitUntil } from './browser';
import { realBodies, writeScene } from './real_scene';

if (!chromiumProgram()) {
  console.log('skipped: no chromium (apt-get install chromium)');
  process.exit(77);
}
console.log(`seed ${seed}`);

const longestRun = 900;       // s
const longestStart = 240000;  // ms: a machine that was never calibrated is, at first
const longestPress = 8000;    // ms
const patient = 120000;       // ms, of a way that is driven

type Act = Record<string, unknown> & { act: string };

declare global {
  interface Window {
    newest: Record<number, ArrayBuffer>;
    pictures: ArrayBuffer[];  // the newest ones
    acts: string[];           // that were sent, but for tokens
    toasts: string[];         // that were shown
  }
}

// In the page, before its own code.
function keepViews(): void {
  window.newest = {};
  window.pictures = [];
  window.acts = [];
  window.toasts = [];
  addEventListener('DOMContentLoaded', () => new MutationObserver(all => all.forEach(m =>
    m.addedNodes.forEach(n => window.toasts.push(n.textContent ?? '')))).observe(
    document.getElementById('toasts')!, { childList: true }));
  window.WebSocket = class extends WebSocket {
    constructor(url: string | URL, protocols?: string | string[]) {
      super(url, protocols);
      this.addEventListener('message', event => {
        const bytes = event.data as ArrayBuffer;
        const kind = new DataView(bytes).getUint8(0);
        window.newest[kind] = bytes;
        if (kind !== 4) return;
        window.pictures.push(bytes);
        if (window.pictures.length > 60) window.pictures.shift();
      });
    }

    override send(data: string): void {
      if (!data.includes('"token"')) window.acts.push(data);
      super.send(data);
    }
  };
}

export const [program, plainScene, last] = process.argv.slice(4) as [string, string, string?];
export const folder = mkdtempSync(join(tmpdir(), 'teletact_real_'));
export const bodies = realBodies(seed);
writeScene(plainScene, bodies, join(folder, 'scene.toml'));

const box: ChildProcess = spawn(program, ['demo', '--console', '--console-port', '0', '--page',
  site, '--clock', 'paced', '--seconds', String(longestRun), '--scene', join(folder, 'scene.toml'),
  '--report', join(folder, 'report'), ...last === 'replays' ? ['--record'] : []],
{ stdio: ['ignore', 'pipe', 'pipe'] });
let said = '';
for (const stream of [box.stdout!, box.stderr!]) {
  stream.on('data', text => { said += String(text); });
}
const gone = new Promise(done => box.on('exit', done));
await waitUntil('the address of the page', () => {
  if (box.exitCode !== null) throw new Error(`the box ended:\n${said}`);
  return /console: \S+\n/.test(said);
}, longestStart);
const browser = await launch();
const context = await browser.newContext({ viewport: { width: 1000, height: 640 },
  colorScheme: 'dark' });
await context.addInitScript(keepViews);
export const desk = await Desk.open(context, null, /console: (\S+)\n/.exec(said)![1]!);
export const { page } = desk;

export async function end(): Promise<void> {
  await browser.close();
  box.kill('SIGINT');
  await gone;
}

after(async () => {
  await end();
  rmSync(folder, { recursive: true });
});

// What fails says what the page said last.
export async function until(what: string, holds: () => boolean | Promise<boolean>,
  longest?: number): Promise<void> {
  try {
    await waitUntil(what, holds, longest);
  } catch (error) {
    const { events, phase, mode, held, tracking, faults } = await slow();
    throw new Error(`seed ${seed}: ${String(error)}\n${JSON.stringify({ phase, mode, held, tracking,
      faults: faults?.map(f => f.id),
      events: events?.slice(-8).map(e => `${e.t.toFixed(1)} ${e.text}`),
      toasts: (await page.evaluate(() => window.toasts)).slice(-5) }, null, 1)}`);
  }
}

async function bytesOf(text: Promise<string>): Promise<ArrayBuffer> {
  const bytes = Buffer.from(await text, 'latin1');
  return bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length) as ArrayBuffer;
}

function newest(kind: number): Promise<ArrayBuffer> {
  return bytesOf(page.evaluate(k => {
    let text = '';
    new Uint8Array(window.newest[k]!).forEach(b => { text += String.fromCharCode(b); });
    return text;
  }, kind));
}

export const pose = async (): Promise<Pose> => readPose(await newest(Kind.pose));
export const slow = async (): Promise<Slow> => readJson<Slow>(await newest(Kind.text));

export const newestPicture = async (): Promise<Picture> => readPicture(await newest(Kind.picture));

// Seconds of the box in one of this machine: below 1 where it can not keep up.
export async function boxRate(): Promise<number> {
  const time = async () => readHead(await newest(Kind.pose)).time;
  const [box, here] = [await time(), Date.now()];
  await page.waitForTimeout(700);
  return Math.max(0.01, (await time() - box) / (1e-3 * (Date.now() - here)));
}

// When the newest event that says so was, s of the box's clock; -1: there is none.
export async function newestEvent(what: RegExp): Promise<number> {
  const { events } = await slow();
  return Math.max(-1, ...(events ?? []).filter(e => what.test(e.text)).map(e => e.t));
}

// To a control, by Tab alone: by its text and that of its row, or by its id.
export async function tabTo(text: string, row = '', id = ''): Promise<void> {
  for (let i = 0; i < 120; ++i) {
    await page.keyboard.press('Tab');
    if (await page.evaluate(([t, r, name]) => {
      const at = document.activeElement!;
      return name ? at.id === name : at.textContent === t
        && (!r || (at.closest('.row')?.textContent ?? '').includes(r));
    }, [text, row, id] as const)) return;
  }
  throw new Error(`no way by Tab to: ${text}${id}`);
}

export async function sent(act: string): Promise<Act[]> {
  const all = await page.evaluate(() => window.acts);
  return all.map(text => JSON.parse(text) as Act).filter(a => a.act === act);
}

// The newest proposal, and the picture nearest to what it is about: not each goes to the page.
export async function proposal(): Promise<{ selection: Selection; picture: Picture }> {
  const bytes = await newest(Kind.selection);
  const { data } = readHead(bytes);
  const picture = await bytesOf(page.evaluate(t => {
    const far = (p: ArrayBuffer) => Math.abs(new DataView(p).getFloat64(16, true) - t);
    const one = window.pictures.reduce((a, b) => far(b) < far(a) ? b : a);
    let text = '';
    new Uint8Array(one).forEach(b => { text += String.fromCharCode(b); });
    return text;
  }, data));
  return { selection: readSelection(bytes), picture: readPicture(picture) };
}

// What is held ends, rightly, where the machine is too busy to send a token within 200 ms: then
// it is pressed again, after `before`. `least`, ms: a press lasts so long.
export async function pressing(what: string, at: [number, number], least: number,
  holds: () => Promise<boolean>, before = async () => {}): Promise<void> {
  await until(what, async () => {
    await before();
    await page.mouse.move(...at);
    await page.mouse.down();
    const from = Date.now();
    let done = false;
    while (Date.now() - from < longestPress && !(done && Date.now() - from >= least)) {
      await page.waitForTimeout(100);
      done = done || await holds();
    }
    await page.mouse.up();
    return done;
  });
}

// The surface of all that is seen from here.
export async function wholeMesh(): Promise<void> {
  let triangles = 0;
  await until('a surface that no longer grows', async () => {
    const before = triangles;
    ({ triangles } = (await desk.figures())!);
    await page.waitForTimeout(500);
    return Math.abs(triangles - before) < 0.01 * triangles;
  });
}

export async function distanceTo(p: number[]): Promise<number> {
  const { robot } = await pose();
  return Math.hypot(robot[0] - p[0]!, robot[1] - p[1]!);
}

// Sets a goal by `ask` and stays engaged until the robot stands at it. Where a busy machine lets
// the engagement go, the goal is dropped with it, rightly: then it is asked for again. The
// smallest distance from `beside`.
export async function drivesTo(goal: number[], ask: () => Promise<void>,
  beside = goal): Promise<number> {
  let nearest = Infinity;
  let asked = -Infinity;
  await until('the arrival', async () => {
    nearest = Math.min(nearest, await distanceTo(beside));
    const { phase, path } = await slow();
    const at = path && path.length > 0 ? path[path.length - 1]! : [Infinity, Infinity];
    // Of the goal before, it may still say that it has arrived.
    const ours = Math.hypot(at[0]! - goal[0]!, at[1]! - goal[1]!) < 0.15;
    if (ours && phase === 'arrived') return true;
    if (ours && phase === 'failed') throw new Error('the way was given up');
    await desk.engage();
    if (!ours && Date.now() - asked > 3000) {
      await ask();
      asked = Date.now();
    }
    await page.waitForTimeout(50);
    return false;
  }, patient);
  return nearest;
}

// For half a second: after a freeze of the page the newest pose that it has read may be an old one.
export async function standsStill(): Promise<void> {
  let still = 0;
  await until('the base to stand', async () => {
    const { velocity } = await pose();
    still = Math.hypot(...velocity) < 0.01 ? still + 1 : 0;
    await page.waitForTimeout(50);
    return still > 6;
  });
}

export const toasts = async (): Promise<string> => (await page.textContent('#toasts'))!;
