// The pictures of the documents, of the page as it is with a real box: the demo on the paced clock.
//
//   node pictures.mjs TELETACT FOLDER
//
// starts `TELETACT demo --clock paced --console` and leaves FOLDER/console_*.jpg, at most 120 kB
// each. 77: no browser here.
import { ChildProcess, spawn } from 'node:child_process';
import { mkdirSync, mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { Page } from 'playwright-core';
import { Vec3 } from '../src/wire/types';
import { chromiumProgram, Figures, launch, newPage, until } from './browser';

const most = 120000;  // bytes
const size = { width: 1280, height: 720 };
const scratch = mkdtempSync(join(tmpdir(), 'teletact_pictures_'));

function start(program: string): { box: ChildProcess; url: Promise<string> } {
  const box = spawn(program, ['demo', '--clock', 'paced', '--console', '--quiet', '--report',
    join(scratch, 'report')], { env: { ...process.env, XDG_STATE_HOME: scratch },
    stdio: ['ignore', 'pipe', 'inherit'] });
  const url = new Promise<string>((done, failed) => {
    let said = '';
    box.stdout!.on('data', bytes => {
      const found = /console: (\S+)/.exec(said += String(bytes));
      if (found) done(found[1]!);
    });
    box.on('exit', status => failed(new Error(`the demo ended with ${status}`)));
  });
  return { box, url };
}

class Photographer {
  private quality = 70;

  constructor(private readonly page: Page, private readonly folder: string) {}

  // With a live picture of the camera, and what is to be seen still there: on a busy machine not at
  // the first attempt.
  async shoot(name: string, again = async () => {}, still = async () => true): Promise<void> {
    await until(`${name}, live`, async () => {
      await again();
      const good = async () => await still() && await this.page.evaluate(() =>
        document.getElementById('inset')!.classList.contains('fresh'));
      if (!await good()) return false;
      const bytes = await this.picture();
      if (!await good()) return false;
      writeFileSync(join(this.folder, `console_${name}.jpg`), bytes);
      console.log(`console_${name}.jpg: ${bytes.length} bytes`);
      return true;
    });
  }

  private async picture(): Promise<Buffer> {
    for (; ; this.quality -= 5) {
      const bytes = await this.page.screenshot({ type: 'jpeg', quality: this.quality });
      if (bytes.length <= most || this.quality <= 30) return bytes;
    }
  }

  tool(name: string): Promise<void> { return this.page.click(`#rail button:has-text("${name}")`); }

  async at(p: Vec3): Promise<[number, number]> {
    return (await this.page.evaluate(q => window.teletact.toScreen(q), p))!;
  }

  says(where: string, what: string): Promise<boolean> {
    return this.page.evaluate(([place, text]) =>
      document.querySelector(place!)!.textContent!.includes(text!), [where, what]);
  }

  async drag(points: Vec3[]): Promise<void> {
    const { mouse } = this.page;
    await mouse.move(...await this.at(points[0]!));
    await mouse.down();
    for (const p of points.slice(1)) await mouse.move(...await this.at(p), { steps: 5 });
    await mouse.up();
  }

  // Nothing of the step before is in the picture of the next one.
  quiet(): Promise<void> {
    return until('old answers to go', () => this.page.evaluate(() =>
      document.getElementById('toasts')!.children.length === 0));
  }

  async live(): Promise<void> {
    await until('a picture that is new', () => this.page.evaluate(() =>
      !document.getElementById('inset')!.classList.contains('frozen')));
  }

  async engage(): Promise<void> {
    await until('engaged', async () => {
      if (await this.says('#chips', 'engaged')) return true;
      await this.page.click('#commands button:has-text("Engage")');
      await this.page.waitForTimeout(500);
      return this.says('#chips', 'engaged');
    });
  }

  async touch(): Promise<void> {
    await this.tool('Touch');
    const { mouse } = this.page;
    await mouse.move(...await this.at([1.0, 0.9, 0]));
    await mouse.down();
    let side = 1;
    await this.shoot('touch', async () => {
      await mouse.move(...await this.at([1.0, 0.9 + 0.002 * (side = -side), 0]));
    }, () => this.says('#pane-scene', 'touches'));
    await mouse.up();
  }

  // The picture of README.md too: a mark, and the robot on its way.
  async mark(): Promise<void> {
    await this.tool('Mark');
    await this.engage();
    await this.quiet();
    await this.drag([[1.25, 0.6, 0], [1.3, 0.65, 0], [1.35, 0.75, 0], [1.43, 0.8, 0]]);
    await until('the way', () => this.says('#chips', 'driving'));
    await this.page.waitForTimeout(1000);
    await this.shoot('page', () => this.engage());
  }

  async goTo(): Promise<void> {
    await this.tool('Go to');
    await this.drag([[1.2, 0.4, 0], [1.45, 0.4, 0]]);
    await this.engage();
    await this.shoot('go_to', () => this.engage(), () => this.says('#chips', 'driving'));
    await this.page.click('#options button:has-text("Drop goal")');
  }

  async forget(): Promise<void> {
    await this.tool('Forget');
    await this.drag([[1.1, 0.5, 0], [1.5, 0.9, 0]]);
    await until('the question', () => this.says('#options', 'Forget what is in the box'));
    await this.page.waitForTimeout(500);
    await this.shoot('forget');
    await this.page.click('#options button:has-text("Cancel")');
  }

  async drive(): Promise<void> {
    const { keyboard } = this.page;
    await this.page.click('#tabs button:has-text("Timeline")');
    await this.engage();
    await this.quiet();
    const driven = () => this.page.evaluate(() => /driven by hand$/.test(
      document.querySelector('#pane-timeline .event')?.textContent ?? ''));
    // A machine too busy for its tokens lets go, rightly: pressed again.
    await this.shoot('driving', async () => {
      if (await driven()) return;
      await keyboard.up('e');
      await this.live();
      await this.engage();
      await this.page.focus('#canvas');
      await keyboard.down('e');
      await this.page.waitForTimeout(700);
    }, driven);
    await keyboard.up('e');
    await this.page.click('#tabs button:has-text("Scene")');
  }

  async stop(): Promise<void> {
    await this.engage();
    await this.quiet();
    await this.engage();
    await this.page.focus('#canvas');
    await this.page.keyboard.press('Space');
    await until('the stop', async () => await this.says('#toasts', 'ramps down')
      && !await this.says('#chips', 'engaged'));
    await this.shoot('stop');
  }

  async session(): Promise<void> {
    const { page } = this;
    await page.click('#tabs button:has-text("Session")');
    await page.fill('input[aria-label="Name of the saved session"]', 'lab-1');
    await page.click('#pane-session button:has-text("Save")');
    await until('its row', () => page.isVisible('#pane-session button[aria-label="Open lab-1"]'));
    await page.locator('#pane-session button[aria-label="Open lab-1"]').scrollIntoViewIfNeeded();
    await this.shoot('session');
  }
}

async function main(program: string, folder: string): Promise<void> {
  mkdirSync(folder, { recursive: true });
  const { box, url } = start(program);
  const ended = new Promise(done => box.on('exit', done));
  const browser = await launch();
  try {
    const context = await browser.newContext({ viewport: size, colorScheme: 'dark' });
    const page = await newPage(context);
    await page.goto(await url);
    await until('the room', async () => {
      const f = await page.evaluate(() => (window.teletact?.figures() ?? null) as Figures | null);
      return f !== null && f.blocks > 100 && f.frames > 2;
    });
    const photographer = new Photographer(page, folder);
    await photographer.live();
    for (const step of ['touch', 'mark', 'goTo', 'forget', 'session', 'drive', 'stop'] as const) {
      await photographer.quiet();
      await photographer[step]();
      await page.keyboard.press('Escape');
    }
  } finally {
    await browser.close();
    box.kill('SIGINT');
    await ended;
    rmSync(scratch, { recursive: true });
  }
}

const [program, folder] = process.argv.slice(2);
if (!program || !folder) {
  console.error('usage: pictures.mjs TELETACT FOLDER');
  process.exit(2);
}
if (!chromiumProgram()) {
  console.log('skipped: no chromium');
  process.exit(77);
}
await main(program, folder);
