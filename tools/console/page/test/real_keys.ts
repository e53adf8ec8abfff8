// The acts by the keyboard alone: no pointer from here on.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import {
  desk, distanceTo, newestEvent, page, pose, sent, slow, standsStill, tabTo, toasts, until,
} from './real_box';

const { keyboard } = page;
const longestTurn = 15000;  // ms: once round

async function press(key: string, times = 1): Promise<void> {
  for (let i = 0; i < times; ++i) await keyboard.press(key);
}


async function answered(act: string, key: string, run: () => Promise<void>): Promise<void> {
  const before = (await sent(act)).length;
  await press(key);
  await run();
  await until(act, async () => (await sent(act)).length > before);
}

test('a keep-out by keys, chosen in the list, deleted, taken back', async () => {
  await keyboard.press('Escape');  // to the scene, from wherever the focus is
  await answered('draw', '5', async () => {
    await press('ArrowDown', 8);
    await keyboard.down('Enter');
    await press('ArrowRight', 6);
    await keyboard.up('Enter');
  });
  const keepOuts = async () => ((await slow()).obstacles ?? []).length;
  await until('it', async () => await keepOuts() === 1);
  await page.locator('.row:has-text("Keep-out")').waitFor();
  await tabTo('Look at', 'Keep-out');
  await press('Enter');
  await press('Delete');
  await until('none', async () => await keepOuts() === 0);
  await press('Escape');
  await press('Control+z');
  await until('it again', async () => await keepOuts() === 1);
  await press('Control+z');
  await until('none', async () => await keepOuts() === 0);
});

test('a touch by keys', async () => {
  await press('Escape');
  await press('2');
  await press('ArrowDown', 4);
  await until('the hand on a surface', async () => {
    // Told that the map has no surface there, a person tries beside it.
    if (/no surface here yet/.test(await toasts())) await press('ArrowRight', 2);
    await keyboard.down('Enter');
    const end = Date.now() + 6000;
    let contact = false;
    while (!contact && Date.now() < end) {
      await page.waitForTimeout(50);
      contact = (await pose()).contact;
    }
    await keyboard.up('Enter');
    return contact;
  });
});

test('a mark by keys, and taken back', async () => {
  await answered('mark', '3', async () => {
    await keyboard.down('Enter');
    await press('ArrowRight', 4);
    await keyboard.up('Enter');
  });
  assert.ok(((await sent('mark')).pop()!.points as unknown[]).length > 1);
  await until('it', async () => ((await slow()).marks ?? []).length === 1);
  await press('Control+z');
  await until('none', async () => ((await slow()).marks ?? []).length === 0);
});

test('a region is forgotten by keys, after a yes', async () => {
  const told = await newestEvent(/forgotten/);
  await press('Escape');
  await press('7');
  await keyboard.down('Enter');
  await press('ArrowRight', 4);
  await press('ArrowUp', 4);
  await keyboard.up('Enter');
  const before = (await sent('forget')).length;
  await tabTo('Forget what is in the box');
  await press('Enter');
  await until('the forgetting', async () => (await sent('forget')).length === before + 1);
  await until('the word', async () => await newestEvent(/forgotten/) > told);
});

// Told to turn the camera to a place that it has seen, a person turns until the box knows where it
// is. What is driven by hand drops the goal, so it is asked for again.
async function turnedAsTold(): Promise<void> {
  const told = async () => /turn the camera/.test((await slow()).held ?? '');
  const end = Date.now() + longestTurn;
  while (await told() && Date.now() < end) {
    console.log('told to turn the camera, and turns');
    await keyboard.down('q');
    for (let i = 0; i < 10 && await told(); ++i) await page.waitForTimeout(200);
    await keyboard.up('q');
  }
}

test('to a place by keys: engaged, driven there, held', async () => {
  await press('Escape');
  await answered('go_to', '6', async () => {
    await press('ArrowUp', 2);
    await press('Enter');
  });
  const { x, y } = (await sent('go_to')).pop()! as unknown as { x: number; y: number };
  const whole = await distanceTo([x, y]);
  await until('the way', async () => {
    if (!(await page.textContent('#chips'))!.includes('engaged')) await press('g');
    await page.waitForTimeout(300);
    await turnedAsTold();
    // Let go by a busy machine, the goal is dropped with the engagement.
    // Where the floor was forgotten too, nothing is planned until it is seen again.
    if (['idle', 'failed'].includes((await slow()).phase as string)) await press('Enter');
    return await distanceTo([x, y]) < Math.max(0.1, 0.5 * whole);
  }, 120000);
  await press('h');
  await until('the hold', async () => (await page.textContent('#chips'))!.includes('Hold'));
  await standsStill();
  assert.deepEqual(desk.errors, []);
});
