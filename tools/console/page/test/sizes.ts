// From a telephone to a desk: the stop can be reached, and no panel lies on another.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { Browser } from 'playwright-core';
import { browser, twin } from './bench';
import { Desk, until } from './browser';

const all: [number, number, boolean][] = [[390, 844, true], [360, 640, true], [768, 1024, true],
  [1024, 768, true], [1280, 720, false]];
// Each second one in every run, all of them where TELETACT_WHOLE is set (tools/test --all).
const sizes = all.filter((_, i) => process.env.TELETACT_WHOLE || i % 2 === 0);
const panels = ['#steps', '#inset', '#options', '#pad', '#looks'];
const tools = ['Look', 'Touch', 'Mark', 'Object', 'Keep-out', 'Go to', 'Forget'];

interface Box { name: string; left: number; top: number; right: number; bottom: number }

async function boxes(desk: Desk, names: string[]): Promise<Box[]> {
  return desk.page.evaluate(all => all.flatMap(name => {
    const element = document.querySelector<HTMLElement>(name)!;
    const { left, top, right, bottom } = element.getBoundingClientRect();
    return element.checkVisibility() && right > left ? [{ name, left, top, right, bottom }] : [];
  }), names);
}

function over(a: Box, b: Box): boolean {
  return a.left < b.right - 1 && b.left < a.right - 1 && a.top < b.bottom - 1
    && b.top < a.bottom - 1;
}

async function check(from: Browser, width: number, height: number, touch: boolean) {
  const context = await from.newContext({ viewport: { width, height }, hasTouch: touch,
    colorScheme: 'dark' });
  const desk = await Desk.open(context, twin);
  const { page } = desk;
  await until('live', () => page.evaluate(() =>
    document.getElementById('inset')!.classList.contains('fresh')));
  for (const tool of tools) {
    await page.locator(`#rail button:has-text("${tool}")`)
      .evaluate(b => (b as HTMLElement).click());
    const seen = await boxes(desk, panels);
    const view = (await boxes(desk, ['#view']))[0]!;
    assert.ok(seen.length >= 4, seen.map(b => b.name).join());
    for (const a of seen) {
      assert.ok(a.left >= view.left && a.right <= view.right && a.top >= view.top
        && a.bottom <= view.bottom, `${width}x${height} ${tool}: ${a.name} is not within the view`);
      for (const b of seen) {
        assert.ok(a === b || !over(a, b), `${width}x${height} ${tool}: ${a.name} on ${b.name}`);
      }
    }
  }
  const areas = await boxes(desk, ['#top', '#rail', '#view', '#side']);
  assert.equal(areas.length, 4);
  for (const a of areas) {
    for (const b of areas) assert.ok(a === b || !over(a, b), `${width}: ${a.name} on ${b.name}`);
  }
  for (const name of ['#stop', '#commands button:nth-child(1)', '#commands button:nth-child(5)']) {
    const box = (await boxes(desk, [name]))[0]!;
    assert.ok(box.left >= 0 && box.right <= width && box.top >= 0 && box.bottom <= height,
      `${width}: ${name} is not within the window`);
    const hit = await page.evaluate(([x, y]) => document.elementFromPoint(x!, y!)?.closest('button')
      ?.textContent, [(box.left + box.right) / 2, (box.top + box.bottom) / 2]);
    assert.ok(hit, `${width}: something lies on ${name}`);
  }
  const before = twin.stops;
  await page.locator('#stop').dispatchEvent('pointerdown');
  await until('the stop', () => twin.stops > before);
  await desk.shot(`size_${width}x${height}`);
  await context.close();
}

for (const [width, height, touch] of sizes) {
  test(`panels at ${width} x ${height}`, () => check(browser, width, height, touch));
}
