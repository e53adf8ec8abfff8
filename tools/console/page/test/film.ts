// A film of the five first steps, as a newcomer takes them, against the twin of the box:
//
//   node film.mjs SITE OUT.mp4
//
// 30 s, at most 3 MB: frames by CDP screencast, joined by ffmpeg with the times at which they came.
// 77: no browser or no ffmpeg here.
import { spawnSync } from 'node:child_process';
import { mkdtempSync, rmSync, statSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { Page } from 'playwright-core';
import { Vec3 } from '../src/wire/types';
import { TwinBox } from '../twin/box';
import { fromBody } from '../twin/world';
import { chromiumProgram, Desk, launch, until } from './browser';

const length = 30;            // s
const most = 3 * 1024 * 1024; // bytes
const seed = 1;
const size = { width: 1280, height: 720 };
const startOf: Record<string, number> = { touch: 1, mark: 5, obstacle: 12, object: 19, stop: 26 };

interface Frame { file: string; at: number }  // s

// Frames come when the page has drawn anew; each lasts until the next one.
class Film {
  readonly frames: Frame[] = [];
  private readonly folder = mkdtempSync(join(tmpdir(), 'teletact_film_'));
  private begin = 0;
  private ended = false;

  get now(): number { return (performance.now() - this.begin) / 1000; }

  async start(page: Page): Promise<void> {
    const session = await page.context().newCDPSession(page);
    session.on('Page.screencastFrame', ({ data, sessionId }) => {
      if (this.ended) return;
      const file = join(this.folder, `${String(this.frames.length).padStart(5, '0')}.jpg`);
      writeFileSync(file, Buffer.from(data, 'base64'));
      this.frames.push({ file, at: this.now });
      void session.send('Page.screencastFrameAck', { sessionId }).catch(() => {});
    });
    this.begin = performance.now();
    await session.send('Page.startScreencast', { format: 'jpeg', quality: 85,
      maxWidth: size.width, maxHeight: size.height });
  }

  until(at: number): Promise<void> {
    return new Promise(done => setTimeout(done, Math.max(0, 1000 * (at - this.now))));
  }

  write(out: string): void {
    this.ended = true;
    const list = this.frames.map(({ file, at }, i) =>
      `file '${file}'\nduration ${((this.frames[i + 1]?.at ?? length) - at).toFixed(3)}`);
    writeFileSync(join(this.folder, 'list'), `${list.join('\n')}\n`);
    const ffmpeg = spawnSync('ffmpeg', ['-y', '-loglevel', 'error', '-f', 'concat', '-safe', '0',
      '-i', join(this.folder, 'list'), '-t', String(length), '-vf', 'fps=12,format=yuv420p',
      '-c:v', 'libx264', '-preset', 'slow', '-crf', '30', '-threads', '1', '-movflags',
      '+faststart', out]);
    if (ffmpeg.status !== 0) throw new Error(`ffmpeg: ${ffmpeg.stderr?.toString() ?? ''}`);
  }

  remove(): void {
    this.ended = true;
    rmSync(this.folder, { recursive: true });
  }
}

// A screencast shows no pointer: a dot goes where it is. Its style is set by script, which the
// page's policy allows where it allows no style sheet.
async function showPointer(page: Page): Promise<void> {
  await page.evaluate(() => {
    const dot = document.createElement('div');
    Object.assign(dot.style, { position: 'fixed', zIndex: '99', width: '18px', height: '18px',
      borderRadius: '50%', border: '3px solid white', background: 'rgba(230, 60, 60, 0.8)',
      pointerEvents: 'none', transform: 'translate(-50%, -50%)', left: '-50px', top: '0' });
    document.body.append(dot);
    for (const kind of ['pointermove', 'pointerdown'] as const) {
      addEventListener(kind, event => {
        dot.style.left = `${event.clientX}px`;
        dot.style.top = `${event.clientY}px`;
      }, true);
    }
  });
}

class Newcomer {
  constructor(private readonly desk: Desk, private readonly twin: TwinBox) {}

  // One of the five, which ticks itself off.
  async take(step: string): Promise<void> {
    const ways: Record<string, () => Promise<void>> = {
      touch: () => this.touch(), mark: () => this.mark(), obstacle: () => this.obstacle(),
      object: () => this.object(), stop: () => this.stop() };
    await ways[step]!();
    const { steps } = this.twin.desk;
    await until(step, () => Boolean(steps[step as keyof typeof steps]));
  }

  private async press(button: string): Promise<void> {
    const { page } = this.desk;
    const box = (await page.locator(button).first().boundingBox())!;
    await page.mouse.move(box.x + box.width / 2, box.y + box.height / 2, { steps: 8 });
    await page.mouse.down();
    await page.mouse.up();
  }

  private tool(name: string): Promise<void> {
    return this.press(`#rail button:has-text("${name}")`);
  }

  private async slowly(points: Vec3[]): Promise<void> {
    const { mouse } = this.desk.page;
    await mouse.move(...await this.desk.screen(points[0]!), { steps: 8 });
    await mouse.down();
    for (const p of points.slice(1)) {
      await mouse.move(...await this.desk.screen(p), { steps: 6 });
    }
    await this.desk.page.waitForTimeout(300);
    await mouse.up();
  }

  private async touch(): Promise<void> {
    const box = this.twin.bodies[0]!;
    const at = (u: number) => fromBody(box, [u * box.half[0], 0, box.half[2]]);
    await this.tool('Touch');
    await this.slowly([at(-0.6), at(-0.2), at(0.2), at(0.6)]);
  }

  private async mark(): Promise<void> {
    await this.tool('Mark');
    await this.slowly([[0.75, -0.3, 0], [0.8, -0.25, 0], [0.85, -0.2, 0]]);
    await this.engage();
  }

  private async obstacle(): Promise<void> {
    await this.tool('Keep-out');
    await this.slowly([[1.5, 0, 0], [1.7, 0, 0]]);
    await this.tool('Go to');
    await this.slowly([[2.2, 0.25, 0]]);
    await this.engage();
  }

  // A page that stood still for a moment has let go.
  private async engage(): Promise<void> {
    if (this.twin.plant.mode !== 'engaged') {
      await this.press('#commands button:has-text("Engage")');
    }
  }

  private async object(): Promise<void> {
    const bin = this.twin.bodies.find(b => b.name === 'bin')!;
    await this.tool('Object');
    await until('a proposal', async () => {
      await this.slowly([fromBody(bin, [-bin.half[0], 0, 0.05])]);
      await this.desk.page.waitForTimeout(400);
      return this.twin.desk.mask.filter(Boolean).length > 20;
    });
    await this.press('#options button:has-text("Accept")');
  }

  private stop(): Promise<void> { return this.press('#stop'); }
}

async function main(site: string, out: string): Promise<void> {
  const twin = new TwinBox(site, seed);
  await twin.listen();
  const browser = await launch();
  const context = await browser.newContext({ viewport: size, colorScheme: 'dark' });
  const desk = await Desk.open(context, twin);
  await desk.live();
  await showPointer(desk.page);
  const film = new Film();
  try {
    await film.start(desk.page);
    const newcomer = new Newcomer(desk, twin);
    for (const [step, at] of Object.entries(startOf)) {
      await film.until(at);
      await newcomer.take(step);
      console.log(`${step}: ticked off at ${film.now.toFixed(1)} s`);
    }
    if (film.now > length) throw new Error(`the steps took ${film.now.toFixed(1)} s`);
    await film.until(length);
    film.write(out);
  } finally {
    film.remove();
    await browser.close();
    await twin.close();
  }
  const bytes = statSync(out).size;
  console.log(`${out}: ${film.frames.length} frames, ${(bytes / 1e6).toFixed(2)} MB`);
  if (bytes > most) throw new Error('more than 3 MB');
}

const [site, out] = process.argv.slice(2);
if (!site || !out) {
  console.error('usage: film.mjs SITE OUT.mp4');
  process.exit(2);
}
if (!chromiumProgram() || spawnSync('ffmpeg', ['-version']).status !== 0) {
  console.log('skipped: no chromium or no ffmpeg');
  process.exit(77);
}
await main(site, out);
