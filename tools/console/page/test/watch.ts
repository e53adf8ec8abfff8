// What a page in a browser does with the views and the acts of a box, by the machine's monotonic
// clock, which the box stamps with too: pointer events, what is sent, what comes, what is applied.
import { Page } from 'playwright-core';

export interface Sent { act: string; id: number; pointer: number; at: number }
export interface Answered { id: number; ok: boolean; why: string; made: number; came: number }
export interface MeshSeen {
  seq: number;
  made: number;
  came: number;
  applied: number;  // -1: not yet
  drawn: number;
}
export interface Watched {
  sent: Sent[];
  answered: Answered[];
  mesh: MeshSeen[];
  pointer: number;
}

declare global {
  interface Window { watched: Watched; borders: Record<string, number> }
}

// In the page: how often the border of the picture was of each kind, looked at 20 times a second.
export function watchBorder(): void {
  window.borders = { fresh: 0, late: 0, frozen: 0 };
  setInterval(() => {
    for (const kind of Object.keys(window.borders)) {
      if (document.getElementById('inset')!.classList.contains(kind)) ++window.borders[kind]!;
    }
  }, 50);
}

// In the page, before its own code. Times: ms of performance.now(); `made`: s of the box's clock,
// since the epoch of its run. Self-contained: it crosses into the browser as text.
export function watchPage(): void {
  const seen: Watched = { sent: [], answered: [], mesh: [], pointer: -1 };
  window.watched = seen;
  const stamp = (event: Event) => { seen.pointer = event.timeStamp; };
  for (const kind of ['pointerdown', 'pointerup']) addEventListener(kind, stamp, true);
  const quiet = ['token', 'note'];
  const held = new Set<string>();
  window.WebSocket = class extends WebSocket {
    constructor(url: string | URL, protocols?: string | string[]) {
      super(url, protocols);
      this.addEventListener('message', event => this.take(event.data as ArrayBuffer));
    }

    override send(data: string): void {
      const { act, id, press } = JSON.parse(data) as { act: string; id: number; press?: boolean };
      // Of a touch the first one after the press is what answers the pointer.
      const again = act === 'hand' && (!press || held.has(String(seen.pointer)));
      if (act === 'hand') held.add(String(seen.pointer));
      if (!quiet.includes(act) && !again) {
        seen.sent.push({ act, id, pointer: seen.pointer, at: performance.now() });
      }
      super.send(data);
    }

    private take(bytes: ArrayBuffer): void {
      const came = performance.now();
      const head = new DataView(bytes);
      const made = head.getFloat64(8, true);
      if (head.getUint8(0) === 3) {
        seen.mesh.push({ seq: head.getUint32(24, true), made, came, applied: -1, drawn: -1 });
      } else if (head.getUint8(0) === 7) {
        const answer = JSON.parse(new TextDecoder().decode(bytes.slice(24))) as
          { id: number; ok: boolean; why?: string };
        seen.answered.push({ id: answer.id, ok: answer.ok, why: answer.why ?? '', made, came });
      }
    }
  };
}

// Once the page stands: when each piece of the mesh is in its scene, and when a frame after it has
// been handed over to be shown.
export async function watchMesh(page: Page): Promise<void> {
  await page.evaluate(() => {
    window.teletact.applied = sequence => {
      const at = performance.now();
      const now = window.watched.mesh.filter(m => m.applied < 0 && m.seq <= sequence);
      for (const m of now) m.applied = at;
      requestAnimationFrame(() => requestAnimationFrame(() => {
        const shown = performance.now();
        for (const m of now) m.drawn = shown;
      }));
    };
  });
}

// Added to performance.now() it is the machine's monotonic clock, ms; off by `within` at most. The
// narrowest of many questions tells.
export async function clockOf(page: Page): Promise<{ offset: number; within: number }> {
  let best = { offset: 0, within: Infinity };
  const now = () => Number(process.hrtime.bigint()) / 1e6;
  for (let i = 0; i < 100; ++i) {
    const before = now();
    const there = await page.evaluate(() => performance.now());
    const within = (now() - before) / 2;
    if (within < best.within) best = { offset: before + within - there, within };
  }
  return best;
}
