// Lists and figures beside the scene.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { moving } from '../src/panel/moving';
import { browser, desk, twin } from './bench';
import { newPage, until } from './browser';

test('cells that move close together are one thing, the largest first', () => {
  assert.deepEqual(moving([]), []);
  const things = moving([[5, 1], [1, 1], [1.05, 1], [1.1, 1.05], [1.2, 1.05], [-3, -2.02]]);
  assert.deepEqual(things.map(t => [t.x.toFixed(3), t.y.toFixed(3), t.width.toFixed(2)]),
    [['1.100', '1.025', '0.25'], ['5.000', '1.000', '0.05'], ['-3.000', '-2.020', '0.05']]);
  const many = Array.from({ length: 20 }, (_, i): [number, number] => [i, 0]);
  assert.equal(moving(many).length, 8);
});

test('what moves is in the list', async () => {
  const list = desk.page.locator('#pane-scene [aria-label="What moves"] .row');
  await until('a row', async () => await list.count() === 1);
  assert.match((await list.textContent())!, /0\.15 m wide at 3\.60, /);
});

test('figures of a simulated clock are not told as measured', async () => {
  await desk.page.click('#tabs button:has-text("Health")');
  const word = desk.page.locator('#pane-health >> text=Simulated clock');
  assert.equal(await word.isVisible(), false);
  twin.clock = 'paced';
  await until('the word', () => word.isVisible());
  await until('live, by the rule of that clock', () => desk.page.evaluate(() =>
    document.getElementById('inset')!.classList.contains('fresh')));
  twin.clock = 'real';
  await until('no word', () => word.isHidden());
  await desk.page.click('#tabs button:has-text("Scene")');
});

test('a browser that draws no scene says so, and that its STOP does nothing', async () => {
  const context = await browser.newContext();
  await context.addInitScript(() => {
    HTMLCanvasElement.prototype.getContext = () => null;
  });
  const page = await newPage(context);
  await page.goto(twin.url());
  await until('the words', async () =>
    (await page.textContent('#banner'))!.includes('its STOP does nothing'));
  assert.ok(await page.isVisible('#banner') && await page.isDisabled('#stop'));
  await context.close();
});
