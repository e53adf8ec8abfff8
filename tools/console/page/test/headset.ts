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
  const marks = twin.count('mark');
  await page.waitForTimeout(300);
  await page.evaluate(`${device}.controllers.right.updateButtonValue('trigger', 1)`);
  await page.waitForTimeout(400);
  await page.evaluate(`${device}.controllers.right.updateButtonValue('trigger', 0)`);
  await until('the mark', () => twin.count('mark') > marks);
  const points = twin.newest('mark')!.points as number[][];
  assert.ok(Math.abs(points[0]![2]!) < 0.05, `on the floor: ${points[0]!.join()}`);
  const stops = twin.stops;
  await page.evaluate(`void ${device}.activeSession.end()`);
  await until('the stop', () => twin.stops > stops);
  assert.deepEqual(desk.errors, []);
  await other.close();
});
