// Driving by hand: by the pad and by keys, and all that ends it.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { besideOf, body, clicked } from './real_acts';
import {
  boxRate, desk, newestEvent, page, pose, pressing, standsStill, toasts, until,
} from './real_box';

const driven = 0.15;         // m
const frozenFor = 600;       // ms of the box's time that the browser freezes: three token lives
const longestFreeze = 6000;  // ms

async function way(from: number[]): Promise<number> {
  const { robot } = await pose();
  return Math.hypot(robot[0] - from[0]!, robot[1] - from[1]!);
}

// Backwards, into free floor, with the key down when it returns and the base on its way.
async function keyDown(): Promise<void> {
  const { keyboard } = page;
  await until('the base to drive', async () => {
    await keyboard.up('s');
    await desk.live();
    await desk.engage();
    await page.focus('#canvas');
    await keyboard.down('s');
    const end = Date.now() + 3000;
    while (Date.now() < end) {
      if ((await pose()).velocity[0] < -0.1) return true;
      await page.waitForTimeout(50);
    }
    return false;
  });
}

// Driven, until `take` ends it and sees the reason said: on a busy machine it may have ended
// before. Then it stands, and goes on standing while the key is still down.
async function endsBy(take: () => Promise<boolean>): Promise<void> {
  await until('the word', async () => {
    await keyDown();
    return take();
  });
  await standsStill();
  const presses = () => newestEvent(/driven by hand/);
  const [before, { robot }] = [await presses(), await pose()];
  await page.keyboard.down('s');  // repeats, as a key that is held does
  await page.waitForTimeout(700);
  const moved = await way(robot);
  assert.equal(await presses(), before, 'a key that was down before drives');
  assert.ok(moved < 0.05, `it goes on by ${moved} m`);
  await page.keyboard.up('s');
}

test('the base drives by the pad, and stands when it is let go', async () => {
  const from = (await pose()).robot;
  const pad = (await page.locator('#pad button[aria-label^="Drive backwards"]').boundingBox())!;
  await pressing('driving', [pad.x + pad.width / 2, pad.y + pad.height / 2], 0,
    async () => await way(from) > driven, async () => {
      await desk.live();
      await desk.engage();
    });
  await standsStill();
});

test('a key drives, and let go the base stands', async () => {
  await keyDown();
  await page.keyboard.up('s');
  await standsStill();
});

// By the rebuilt surface alone: where the camera is while it moves is known too late for its
// picture.
test('clicks while the base drives meet the surface where it is', async () => {
  const box = body('pedestal');
  await desk.tool('Touch');
  let onTheWay = 0;
  await until('clicks on the way', async () => {
    await keyDown();
    for (const p of await besideOf(box)) {
      if (onTheWay >= 2 || (await pose()).velocity[0] > -0.1) break;
      await clicked(box, [p]);
      if ((await pose()).velocity[0] < -0.1) ++onTheWay;
    }
    await page.keyboard.up('s');
    return onTheWay >= 2;
  });
  await standsStill();
  await desk.tool('Look');
});

test('a window that loses the focus ends it', async () => {
  await endsBy(async () => {
    await page.evaluate(() => { dispatchEvent(new Event('blur')); });
    await page.waitForTimeout(300);
    return /Let go of driving: the window lost the focus/.test(await toasts());
  });
});

// The page says what it has noticed, and the box, by itself, that no token came.
test('a browser that stands still ends it, on the box as well', async () => {
  const lost = /no longer held by the page: the base halts/;
  const ms = Math.min(frozenFor / await boxRate(), longestFreeze);
  await endsBy(async () => {
    const before = await newestEvent(lost);
    await page.evaluate(time => {
      const end = performance.now() + time;
      while (performance.now() < end);
    }, ms);
    await page.waitForTimeout(300);
    const said = /Let go of .*driving.*: the browser stood still for (\d+) ms/.exec(await toasts());
    if (!said) return false;
    const stood = Number(said[1]);
    assert.ok(stood > 0.8 * ms, `it stood still for ${stood} of ${ms} ms`);
    const end = Date.now() + 5000;  // events come once a second
    while (await newestEvent(lost) <= before && Date.now() < end) await page.waitForTimeout(100);
    return await newestEvent(lost) > before;
  });
});

test('Space stops', async () => {
  await keyDown();
  await page.keyboard.press('Space');
  await until('the stop', async () => (await page.textContent('#chips'))!.includes('Hold'));
  await page.keyboard.up('s');
  await standsStill();
});
