// Seeing, touching, marking, choosing and placing things, with the pointer.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { Vec3 } from '../src/wire/types';
import { Body, distanceToSurface, fromBody, toBody } from '../twin/world';
import { seed } from './browser';
import {
  bodies, desk, distanceTo, drivesTo, newestPicture, page, pressing,
  proposal, sent, slow, tabTo, until, wholeMesh,
} from './real_box';
import { nextClick, overlap, truthOf } from './real_scene';

const clickError = 0.03;    // m
const arrival = 0.1;        // m
const restingTouch = 1000;  // ms at least
const robotRadius = 0.19;   // m: half of its width
const leastOverlap = 0.8;   // of a proposed mask and the truth
const mostClicks = 3;
const keyStep = 0.025;      // of the picture, an arrow key

const scene = async () => (await page.textContent('#pane-scene'))!;
const row = (name: string) => page.textContent(`#pane-scene .row:has-text("${name}")`);
export const body = (name: string) => bodies.find(b => b.name === name)!;

test('the border of the picture says that it is live', async () => {
  await until('a live picture', () => page.evaluate(() => {
    const inset = document.getElementById('inset')!;
    return inset.classList.contains('fresh') && inset.textContent!.includes('Live');
  }));
});

// Before any click: on a slow machine a click lasts long enough to touch too.
test('a pointer that rests on the floor touches it', async () => {
  await wholeMesh();
  await desk.tool('Touch');
  const ticked = () => page.evaluate(() =>
    document.querySelector('#steps li')!.classList.contains('done'));
  assert.equal(await ticked(), false);
  await pressing('the touch', await desk.screen([1, 0.9, 0]), restingTouch, ticked);
});

// Where the line of sight to a point on a thing enters it: there, or on a nearer side.
function entered(thing: Body, eye: Vec3, aimed: Vec3): Vec3 {
  const [from, to] = [toBody(thing, eye), toBody(thing, aimed)];
  const t = Math.max(...thing.half.map((half, k) => {
    const way = to[k]! - from[k]!;
    return (-Math.sign(way) * half - from[k]!) / way;
  }));
  return eye.map((v, k) => v + t * (aimed[k]! - v)) as Vec3;
}

export async function clicked(thing: Body, points: Vec3[]): Promise<void> {
  for (const p of points) {
    const aimed = entered(thing, await page.evaluate(() => window.teletact.eye()),
      fromBody(thing, p));
    await desk.touch(aimed, async () => (await sent('hand')).length);
    const touched = (await sent('hand')).pop()!.p as Vec3;
    const off = Math.hypot(...touched.map((v, k) => v - aimed[k]!));
    assert.ok(distanceToSurface(bodies, touched) < clickError && off < clickError,
      `seed ${seed}: ${touched.join()} for ${aimed.join()}`);
  }
}

async function showPicture(on: boolean): Promise<void> {
  await page.click('#tabs button:has-text("Session")');
  const shown = page.locator('#pane-session button:has-text("live picture")');
  if (await shown.getAttribute('aria-pressed') !== String(on)) await shown.click();
  await page.click('#tabs button:has-text("Scene")');
}

// Three points on the side that both the robot, where it began, and the eye see well: a side that
// the eye only grazes is met behind an edge, which the rebuilt surface rounds.
export async function besideOf(box: Body): Promise<Vec3[]> {
  const eye = await page.evaluate(() => window.teletact.eye());
  const sides: Vec3[] = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]];
  const facing = (n: Vec3, from: Vec3) => {
    const to = toBody(box, from);
    const away = n.map((v, k) => (v ? to[k]! - v * box.half[k]! : to[k]!));
    return n.reduce((sum, v, k) => sum + v * away[k]!, 0) / Math.hypot(away[0]!, away[1]!);
  };
  const worst = (n: Vec3) => Math.min(facing(n, [0, 0, 0]), facing(n, eye));
  const n = sides.sort((a, b) => worst(b) - worst(a))[0]!;
  const on = (across: number, up: number): Vec3 => [
    box.half[0] * (n[0] || across), box.half[1] * (n[1] || across), up * box.half[2]];
  return [on(0, 0), on(0.4, 0.5), on(-0.4, -0.3)];
}

test('three clicked points of a box at a random place, on the rebuilt surface', async () => {
  const box = body('pedestal');
  await wholeMesh();
  await showPicture(false);
  await desk.tool('Touch');
  await clicked(box, await besideOf(box));
  await showPicture(true);
});

test('and of its flat top, seen at a grazing angle', async () => {
  const box = body('pedestal');
  const [x, y, z] = box.half;
  await until('a camera that stands', () => page.evaluate(() =>
    document.getElementById('inset')!.classList.contains('fresh')));
  await clicked(box, [[0, 0, z], [0.5 * x, -0.5 * y, z], [-0.5 * x, 0.4 * y, z]]);
});

// The proposal after the next click, which `run` makes, and its words. A click that the box was too
// busy to answer is dropped by the page, which says so: clicked again.
async function proposed(run: () => Promise<void>): Promise<Awaited<ReturnType<typeof proposal>>> {
  let clicks = (await sent('select')).length;
  let dropped = await unanswered() - 1;
  await until('a proposal', async () => {
    if (await unanswered() > dropped) {
      dropped = await unanswered();
      ++clicks;
      await run();
    }
    return (await sent('select')).length === clicks
      && /( m|of it)$/.test(await proposedWords())
      && (await proposal()).selection.proposal !== shownBefore;
  });
  const shown = await proposal();
  shownBefore = shown.selection.proposal;
  return shown;
}
let shownBefore = -1;
const proposedWords = async () =>
  (await page.locator('#options [role=status]').allTextContents()).join();
const unanswered = async () => page.evaluate(() =>
  window.toasts.filter(text => text.includes('the box did not answer')).length);

test('the bin by clicks: shown, corrected by a click at the largest error, accepted', async () => {
  const bin = body('bin');
  await desk.tool('Object');
  await desk.live();
  let { selection, picture } = await proposed(async () =>
    desk.click(fromBody(bin, [-bin.half[0], 0, 0.05])));
  const shares: number[] = [];
  for (;;) {
    const truth = truthOf(selection, picture, bodies, bin);
    const share = overlap(selection.mask, truth);
    shares.push(share);
    if (share >= leastOverlap || shares.length === mostClicks) break;
    const next = nextClick(selection, truth);
    const canvas = (await page.locator('#picture').boundingBox())!;
    await page.click(`#options button:has-text("${next.adds ? 'add' : 'take away'}")`);
    ({ selection, picture } = await proposed(async () => page.mouse.click(
      canvas.x + next.u * canvas.width, canvas.y + next.v * canvas.height)));
  }
  console.log(`the bin, common with the truth after each click: ${
    shares.map(s => s.toFixed(3)).join(', ')}`);
  assert.ok(shares.pop()! >= leastOverlap, `seed ${seed}`);
  await desk.shot('real_object');
  await page.fill('#options input', 'bin');
  await page.click('#options button:has-text("Accept")');
  await until('the object', async () =>
    ((await slow()).objects ?? []).some(o => o.name === 'bin'));
});

test('another object by keys alone, in the picture; and taken back', async () => {
  const { keyboard } = page;
  const seen = await newestPicture();
  const none = new Uint8Array(seen.width * seen.height);
  const blank = { width: seen.width, height: seen.height, proposal: 0, mask: none };
  const truth = truthOf(blank, seen, bodies, body('table'));
  await keyboard.press('Escape');
  await tabTo('', '', 'picture');
  const go = async (way: number, back: string, forth: string) => {
    const steps = Math.round(way / keyStep);
    for (let i = 0; i < Math.abs(steps); ++i) await keyboard.press(steps < 0 ? back : forth);
    return steps * keyStep;
  };
  // Far away a click may give a patch of it: as a person does, on until it has a size.
  let next = nextClick(blank, truth);
  let [u, v] = [0.5, 0.5];
  for (let clicks = 1; ; ++clicks) {
    u += await go(next.u - u, 'ArrowLeft', 'ArrowRight');
    v += await go(next.v - v, 'ArrowUp', 'ArrowDown');
    const { selection } = await proposed(async () => keyboard.press('Enter'));
    if (/ m$/.test(await proposedWords()) || clicks === mostClicks) break;
    const more = truth.map((t, i) => t || selection.mask[i]!);  // a key adds, and takes none away
    next = nextClick(selection, more);
  }
  await keyboard.press('y');
  const objects = async () => ((await slow()).objects ?? []).length;
  await until('the object', async () => await objects() === 2);
  await keyboard.press('Escape');
  await keyboard.press('Control+z');
  await until('the bin alone', async () => await objects() === 1);
});

test('a mark is drawn, and undone it is none', async () => {
  await desk.tool('Mark');
  await desk.drag([[1.2, 0.9, 0], [1.25, 0.9, 0], [1.3, 0.85, 0]]);
  await until('the mark', async () => (await scene()).includes('Mark 1'));
  await until('its goal', async () => !(await row('Goal'))!.includes('not known'));
  await page.click('#commands button:has-text("Undo")');
  await until('no mark', async () => !(await scene()).includes('Mark 1'));
  await until('no goal', async () => (await row('Goal'))!.includes('not known'));
});

test('a mark by the pointer: the robot arrives', async () => {
  await drivesTo([0.7, 0.1], async () =>
    desk.drag([[0.65, 0.05, 0], [0.7, 0.1, 0], [0.75, 0.15, 0]]));
  const off = await distanceTo([0.7, 0.1]);
  console.log(`arrived ${off.toFixed(3)} m from the middle of the mark`);
  assert.ok(off < arrival, `${off} m off`);
  await until('no mark', async () => {
    const marks = page.locator('#pane-scene .row:has-text("Mark") button:has-text("Delete")');
    // Its row may go just then.
    if (await marks.count() > 0) await marks.first().click({ timeout: 1000 }).catch(() => {});
    return !/Mark \d/.test(await scene());
  });
});

test('a keep-out on the way: the robot goes round it', async () => {
  await desk.tool('Keep-out');
  await desk.drag([[1.3, 0.1, 0], [1.45, 0.1, 0]]);
  await until('the keep-out', async () => ((await slow()).obstacles ?? []).length === 1);
  const disc = (await slow()).obstacles![0]!;
  assert.ok(Math.abs(disc.half[0] - 0.15) < 0.03, `radius ${disc.half[0]}`);
  await desk.tool('Go to');
  const nearest = await drivesTo([1.9, 0.1], async () => desk.click([1.9, 0.1, 0]), disc.centre);
  const off = await distanceTo([1.9, 0.1]);
  console.log(`passed at ${nearest.toFixed(3)} m, arrived ${off.toFixed(3)} m off`);
  assert.ok(off < arrival, `${off} m off`);
  assert.ok(nearest > disc.half[0] + robotRadius, `passed at ${nearest} m`);
  await desk.shot('real_keep_out');
  await page.click('#pane-scene .row:has-text("Keep-out") button:has-text("Delete")');
  await until('none', async () => ((await slow()).obstacles ?? []).length === 0);
});
