// WebXR without a headset: iwer takes the place of the browser's.
import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { test } from 'node:test';
import { browser, desk as first, twin } from './bench';
import { Desk, until } from './browser';

const iwer = 'node_modules/iwer/build/iwer.min.js';

test('nothing of it where there is none', async () => {
  assert.equal(await first.page.locator('.headset').count(), 0);
});

test('a controller marks the floor, and the end of the session stops', async () => {
  const other = await browser.newContext({ viewport: { width: 640, height: 360 } });
  await other.addInitScript(`${readFileSync(iwer, 'utf8')};
    window.device = new IWER.XRDevice(IWER.metaQuest3);
    window.device.installRuntime({ forceInstall: true });
    window.device.stereoEnabled = true;`);
  const desk = await Desk.open(other, twin);
  const { page } = desk;
  await page.click('#rail button:has-text("Mark")', { force: true });
  await page.click('.headset:has-text("VR")', { force: true });
  const device = 'window.device';
  await until('the session', () => page.evaluate(`!!${device}.activeSession`));
  await page.evaluate(`{
    const right = ${device}.controllers.right;
    right.position.set(0.2, 1.4, -0.3);
    right.quaternion.set(-0.5, 0, 0, 0.866);
  }`);
  // A value of the controllers is taken at the next frame.
  const seen = async () => {
    const { frames } = (await desk.figures())!;
    await until('two frames', async () => (await desk.figures())!.frames >= frames + 2);
  };
  const hold = async (button: string, value: number) => {
    await page.evaluate(`${device}.controllers.right.updateButtonValue('${button}', ${value})`);
    await seen();
  };
  const marks = twin.count('mark');
  await seen();
  await hold('trigger', 1);
  await hold('trigger', 0);
  await until('the mark', () => twin.count('mark') > marks);
  const points = twin.newest('mark')!.points as number[][];
  assert.ok(Math.abs(points[0]![2]!) < 0.05, `on the floor: ${points[0]!.join()}`);
  // The grip stops, however often; the stick takes the next tool; the label says so.
  const label = () => page.evaluate(() =>
    (window.teletact.figures() as { headset: string }).headset);
  assert.match(await label(), /^Mark/);
  const grip = twin.stops;
  await hold('squeeze', 1);
  await hold('squeeze', 0);
  await until('the stop of the grip', () => twin.stops > grip);
  await until('its answer at the controller', async () => (await label()).includes('ramps down'));
  const push = async (x: number) => {
    await page.evaluate(`${device}.controllers.right.updateAxes('thumbstick', ${x}, 0)`);
    await seen();
  };
  await push(1);
  await until('the next tool', async () => (await label()).startsWith('Object'));
  await push(0.5);
  await push(1);  // not let go between
  assert.match(await label(), /^Object/);
  await push(0);
  await push(-1);
  await push(0);
  await until('the one before', async () => (await label()).startsWith('Mark'));
  assert.equal(await page.getAttribute('#rail button:has-text("Mark")', 'aria-pressed'), 'true');
  const stops = twin.stops;
  await page.evaluate(`void ${device}.activeSession.end()`);
  await until('the stop', () => twin.stops > stops);
  // A second session, with the same controllers: a push is still one tool.
  await page.click('.headset:has-text("VR")', { force: true });
  await until('the session', () => page.evaluate(`!!${device}.activeSession`));
  await seen();
  await push(1);
  await push(0);
  await until('one tool further', async () => (await label()).startsWith('Object'));
  await page.evaluate(`void ${device}.activeSession.end()`);
  assert.deepEqual(desk.errors, []);
  await other.close();
});
