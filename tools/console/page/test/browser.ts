// Debian's Chromium, headless, drawing in software, against a twin of the box or a real one.
import { existsSync, mkdirSync } from 'node:fs';
import { Browser, BrowserContext, chromium, Page } from 'playwright-core';
import { Vec3 } from '../src/wire/types';
import { TwinBox } from '../twin/box';

export const [site, artefacts] = process.argv.slice(2) as [string, string];
export const seed = Number(process.env.TELETACT_SEED ?? Date.now() % 100000);

const programs = ['/usr/bin/chromium', '/usr/lib/chromium/chromium'];
const flags = ['--no-sandbox', '--use-angle=swiftshader', '--enable-unsafe-swiftshader',
  '--disable-dev-shm-usage'];
const patience = 60000;  // ms; nothing is judged by how long it takes

export function chromiumProgram(): string | undefined { return programs.find(existsSync); }

export async function launch(): Promise<Browser> {
  return chromium.launch({ executablePath: chromiumProgram()!, args: flags });
}

// A new tab to which nothing listens that an operator's browser does not have: Playwright asks for
// every frame of the WebSocket, which the page's thread then writes as text, for Playwright to
// read: on two slow CPUs the page's timers of 20 ms came every 38 to 72 ms, and every 20 to 22 ms
// without. Playwright has no switch for it, so the question is taken back where it was asked.
export async function newPage(context: BrowserContext): Promise<Page> {
  const page = await context.newPage();
  if (context.browser()?.browserType().name() !== 'chromium') return page;
  const { _connection: connection } = page as unknown as Inner;
  await connection.toImpl(page).delegate._mainFrameSession._client.send('Network.disable');
  return page;
}

interface Inner {
  _connection: { toImpl(page: Page): { delegate: { _mainFrameSession: { _client: {
    send(method: string): Promise<unknown>;
  } } } } };
}

export async function until(what: string, holds: () => boolean | Promise<boolean>,
  longest = patience): Promise<void> {
  const end = Date.now() + longest;
  while (!await holds()) {
    if (Date.now() > end) throw new Error(`waited in vain for: ${what}`);
    await new Promise(done => setTimeout(done, 25));
  }
}

export interface Figures {
  frames: number;
  blocks: number;
  triangles: number;
  damaged: number;
  renderer: string;
}

// A page and what is asked of it.
export class Desk {
  readonly errors: string[] = [];

  private constructor(readonly page: Page, readonly twin: TwinBox | null) {
    page.on('pageerror', error => this.errors.push(String(error)));
    page.on('console', message => {
      if (message.text().includes('Content Security Policy')) this.errors.push(message.text());
    });
  }

  // `twin` null: a real box.
  static async open(context: BrowserContext, twin: TwinBox | null,
    url = twin!.url()): Promise<Desk> {
    const desk = new Desk(await newPage(context), twin);
    await desk.page.goto(url);
    await desk.ready();
    return desk;
  }

  async ready(): Promise<void> {
    await until('the page to draw the room', async () => {
      const f = await this.figures();
      return f !== null && f.blocks > 100 && f.triangles > 1000 && f.frames > 2;
    });
  }

  figures(): Promise<Figures | null> {
    return this.page.evaluate(() => (window.teletact?.figures() ?? null) as Figures | null);
  }

  async screen(p: Vec3): Promise<[number, number]> {
    const at = await this.page.evaluate(q => window.teletact.toScreen(q), p);
    if (!at) throw new Error(`${p.join()} is behind the camera`);
    return at;
  }

  async tool(name: string): Promise<void> {
    await this.page.click(`#rail button:has-text("${name}")`);
  }

  async click(p: Vec3): Promise<void> { await this.page.mouse.click(...await this.screen(p)); }

  // A click of Touch is two acts, press and release: a late release is not that of the next click.
  // A page that stood still between them lets go, rightly: clicked again.
  async touch(p: Vec3, acts: () => number | Promise<number>): Promise<void> {
    let before = 0;
    let again = 0;
    await until('press and release', async () => {
      const now = await acts();
      if (again > 0 && now >= before + 2) return true;
      if (Date.now() < again) return false;
      before = now;
      await this.click(p);
      again = Date.now() + 2000;
      return false;
    });
  }

  async drag(points: Vec3[]): Promise<void> {
    const { mouse } = this.page;
    await mouse.move(...await this.screen(points[0]!));
    await mouse.down();
    for (const p of points.slice(1)) await mouse.move(...await this.screen(p), { steps: 4 });
    await mouse.up();
  }

  async live(): Promise<void> {
    await until('a live picture', () => this.page.evaluate(() =>
      !document.getElementById('inset')!.classList.contains('frozen')));
  }

  async engage(): Promise<void> {
    // A machine too busy to send a token within 200 ms lets go, rightly: pressed again.
    await until('engaged', async () => {
      if (await this.engaged()) return true;
      await this.page.click('#commands button:has-text("Engage")');
      await this.page.waitForTimeout(this.twin ? 150 : 500);
      return this.engaged();
    });
  }

  private async engaged(): Promise<boolean> {
    if (this.twin) return this.twin.plant.mode === 'engaged';
    return (await this.page.textContent('#chips'))!.includes('engaged');
  }

  async shot(name: string): Promise<void> {
    mkdirSync(artefacts, { recursive: true });
    await this.page.screenshot({ path: `${artefacts}/${name}.jpg`, quality: 75, type: 'jpeg' });
  }
}
