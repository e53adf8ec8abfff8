// The browser's side of `teletact bench console` (tools/measure/bench/console):
//
//   node measure.mjs acts URL ROUNDS            acts by the pointer, and the mesh, by the clock
//   node measure.mjs drawn URL SECONDS          frames a second at 640x360
//   node measure.mjs grow URL RELOADS           a line of memory every second, until stdin ends
//
// The last line (of grow: each) is JSON. 77: no browser here.
import { readFileSync } from 'node:fs';
import { Browser, CDPSession, Page } from 'playwright-core';
import { Vec3 } from '../src/wire/types';
import { chromiumProgram, Figures, launch, newPage, until } from './browser';
import { clockOf, watchBorder, watchMesh, watchPage } from './watch';

const pause = 250;         // ms between acts: each one alone
const settle = 3000;       // ms until the first mesh has come whole
const touchHold = 500;     // ms that a touch is held
const touchPause = 1200;   // ms in which the hand goes back: still before the next touch
const mostTouches = 20;    // within the newest minute of the hand, which the box keeps whole
const driveFor = 9000;     // ms in which the base drives and new surface comes

type All = Figures & { messages: number };

function figures(page: Page): Promise<All | null> {
  return page.evaluate(() => (window.teletact?.figures() ?? null) as All | null);
}

async function open(browser: Browser, url: string, width: number, height: number,
  watched = false): Promise<Page> {
  const context = await browser.newContext({ viewport: { width, height } });
  if (watched) await context.addInitScript(watchPage);
  const page = await newPage(context);
  await page.goto(url);
  await until('the page to draw', async () => {
    const f = await figures(page);
    return f !== null && f.messages > 10 && f.frames > 2;
  });
  return page;
}

async function screen(page: Page, p: Vec3): Promise<[number, number]> {
  const at = await page.evaluate(q => window.teletact.toScreen(q), p);
  if (!at) throw new Error(`${p.join()} is behind the camera`);
  return at;
}

async function drag(page: Page, from: Vec3, to: Vec3, hold = 0): Promise<void> {
  await page.mouse.move(...await screen(page, from));
  await page.mouse.down();
  await page.mouse.move(...await screen(page, to), { steps: 2 });
  await page.waitForTimeout(hold);
  await page.mouse.up();
}

const tool = (page: Page, name: string) => page.click(`#rail button:has-text("${name}")`);
const command = (page: Page, name: string) =>
  page.click(`#commands button:has-text("${name}")`);

async function act(page: Page, rounds: number): Promise<void> {
  await tool(page, 'Keep-out');
  for (let i = 0; i < rounds; ++i) {
    await drag(page, [0.3, -1.6, 0], [0.45, -1.6, 0]);
    await page.waitForTimeout(pause);
    await command(page, 'Undo');
    await page.waitForTimeout(pause);
    await command(page, 'Hold');
    await page.waitForTimeout(pause);
  }
  await tool(page, 'Go to');
  for (let i = 0; i < rounds; ++i) {
    await page.mouse.click(...await screen(page, [1.43, 0.6 + 0.1 * (i % 2), 0]));
    await page.waitForTimeout(pause + 17 * (i % 6));  // over all of a 10 Hz task's period
  }
  // It drives to the last goal, and sees what it has not seen.
  await command(page, 'Engage');
  await page.waitForTimeout(driveFor);
  await command(page, 'Hold');
  await page.waitForTimeout(pause);
  await tool(page, 'Touch');
  for (let i = 0; i < Math.min(rounds, mostTouches); ++i) {
    const p: Vec3 = [1.6, 0.1 * (i % 2), 0];
    await drag(page, p, p, touchHold);
    await page.waitForTimeout(touchPause);
  }
}

async function acts(url: string, rounds: number): Promise<void> {
  const browser = await launch();
  const page = await open(browser, url, 1280, 720, true);
  await watchMesh(page);
  await page.waitForTimeout(settle);
  const settled = await page.evaluate(() => performance.now());
  await page.evaluate(watchBorder);
  await act(page, rounds);
  const clock = await clockOf(page);
  const watched = await page.evaluate(() => window.watched);
  const { renderer } = (await figures(page))!;
  const borders = await page.evaluate(() => window.borders);
  console.log(JSON.stringify({ ...watched, settled, clock, renderer, borders }));
  await browser.close();
}

async function drawn(url: string, seconds: number): Promise<void> {
  const browser = await launch();
  const page = await open(browser, url, 640, 360);
  await page.waitForTimeout(settle);
  const from = (await figures(page))!;
  const since = performance.now();
  await page.waitForTimeout(1000 * seconds);
  const to = (await figures(page))!;
  const passed = (performance.now() - since) / 1000;
  console.log(JSON.stringify({ fps: (to.frames - from.frames) / passed, seconds: passed,
    renderer: to.renderer, triangles: to.triangles }));
  await browser.close();
}

// Resident memory of the largest drawing process of a browser, kB.
async function rendererMemory(browser: Browser): Promise<number> {
  const session = await browser.newBrowserCDPSession();
  const { processInfo } = await session.send('SystemInfo.getProcessInfo');
  await session.detach();
  let most = 0;
  for (const { type, id } of processInfo) {
    if (type !== 'renderer') continue;
    try {
      const status = readFileSync(`/proc/${id}/status`, 'utf8');
      most = Math.max(most, Number(/VmRSS:\s+(\d+)/.exec(status)?.[1] ?? 0));
    } catch {
      continue;  // it has just ended
    }
  }
  return most;
}

interface HeapSnapshot {
  snapshot: { meta: { node_fields: string[]; node_types: [string[], ...unknown[]] } };
  nodes: number[];
}

// What the page holds, MB: every node of a snapshot of the collected heap, those of the DOM too,
// but for the code that the engine compiles. That goes on for a minute (0.3 MB of 4.7), then it
// stands.
async function heldHeap(session: CDPSession): Promise<number> {
  const parts: string[] = [];
  const take = ({ chunk }: { chunk: string }): void => { parts.push(chunk); };
  session.on('HeapProfiler.addHeapSnapshotChunk', take);
  await session.send('HeapProfiler.takeHeapSnapshot', { reportProgress: false });
  session.off('HeapProfiler.addHeapSnapshotChunk', take);
  const { snapshot: { meta }, nodes } = JSON.parse(parts.join('')) as HeapSnapshot;
  const [step, type, size] = [meta.node_fields.length, meta.node_fields.indexOf('type'),
    meta.node_fields.indexOf('self_size')];
  const code = meta.node_types[0].indexOf('code');
  let bytes = 0;
  for (let at = 0; at < nodes.length; at += step)
    if (nodes[at + type] !== code) bytes += nodes[at + size]!;
  return bytes / 1e6;
}

// One page stays, a viewer's is loaded again and again: in a browser of its own, so that the memory
// of the first is its own.
async function grow(url: string, reloads: number): Promise<void> {
  const [first, second] = [await launch(), await launch()];
  const stays = await open(first, url, 640, 360);
  const link = await stays.evaluate(async () => {
    const answer = await fetch('/view-link', { method: 'POST', credentials: 'same-origin',
      headers: { 'Content-Type': 'application/json' }, body: '{}' });
    return `${location.origin}/#code=${(await answer.json() as { code: string }).code}`;
  });
  const again = await open(second, link, 640, 360);
  const session = await stays.context().newCDPSession(stays);
  let ended = false;
  process.stdin.on('end', () => { ended = true; });
  process.stdin.resume();
  let reloaded = 0;
  let due = 0;
  while (!ended) {
    if (reloaded < reloads) {
      await again.reload();
      await until('views', async () => ((await figures(again))?.messages ?? 0) > 3);
      ++reloaded;
    } else {
      await stays.waitForTimeout(200);
    }
    if (performance.now() < due) continue;
    due = performance.now() + 2000;
    const heap_MB = await heldHeap(session);
    const { messages } = (await figures(stays))!;
    console.log(JSON.stringify({ heap_MB, messages, reloads: reloaded,
      renderer_MB: await rendererMemory(first) / 1e3 }));
  }
  await Promise.all([first.close(), second.close()]);
}

const [mode, url, count] = process.argv.slice(2) as [string, string, string];
const modes: Record<string, (url: string, count: number) => Promise<void>> = { acts, drawn, grow };
if (!chromiumProgram()) process.exit(77);
await modes[mode]!(url, Number(count));
