// Seeing and acting, with the pointer and with the keyboard alone.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { Vec3 } from '../src/wire/types';
import { distanceToSurface, fromBody } from '../twin/world';
import { desk, plant, twin } from './bench';
import { until } from './browser';

const clickError = 0.03;   // m
const arrival = 0.1;       // m

function at(x: number, y: number): number {
  return Math.hypot(twin.plant.robot[0] - x, twin.plant.robot[1] - y);
}

test('the room is seen, and not a blank canvas', async () => {
  const figures = (await desk.figures())!;
  console.log(`renderer ${figures.renderer}, ${figures.triangles} triangles`);
  assert.equal(figures.damaged, 0);
  await desk.live();
  await desk.shot('room_dark');
});

test('three clicked points of a box at a random place', async () => {
  const box = twin.bodies[0]!;
  const [x, y, z] = box.half;
  await desk.tool('Touch');
  for (const p of [[0, 0, z], [0.5 * x, -0.5 * y, z], [-0.5 * x, 0.4 * y, z]] as Vec3[]) {
    const aimed = fromBody(box, p);
    await desk.touch(aimed, () => twin.count('hand'));
    const touched = twin.newest('hand')!.p as Vec3;
    assert.ok(distanceToSurface(twin.bodies, touched) < clickError);
    assert.ok(Math.hypot(...touched.map((v, k) => v - aimed[k]!)) < clickError,
      `${touched.join()} for ${aimed.join()}`);
  }
  assert.ok(twin.desk.steps.touch);
});

test('a touch goes on while the pointer rests', async () => {
  const { mouse } = desk.page;
  await desk.tool('Touch');
  // A machine too busy to send a token within 200 ms lets go, rightly: pressed again.
  await until('a touch that rests', async () => {
    await mouse.move(...await desk.screen([1, -0.2, 0]));
    await mouse.down();
    await until('the touch', () => plant.hand?.press === true || plant.lost.includes('hand'));
    const said = twin.count('hand');
    await desk.page.waitForTimeout(600);  // three lives of a token
    assert.equal(twin.count('hand'), said, 'nothing is said by a pointer that rests');
    const rests = plant.hand?.press === true;
    await mouse.up();
    return rests;
  });
  await until('the end', () => plant.hand === null);
});

// Outside the room: no camera has looked there.
test('a touch where the map has no surface says that nothing may be felt', async () => {
  await desk.touch([2, -2.3, 0], () => twin.count('hand'));
  await until('the word', async () =>
    (await desk.page.textContent('#toasts'))!.includes('no surface here yet'));
});

test('a mark by the pointer: the robot arrives', async () => {
  await desk.tool('Mark');
  await desk.drag([[0.75, -0.3, 0], [0.8, -0.25, 0], [0.85, -0.2, 0]]);
  await until('the mark', () => twin.count('mark') === 1);
  await desk.shot('mark');
  await desk.engage();
  await until('the arrival', async () => {
    if (plant.phase !== 'arrived') await desk.engage();
    return plant.phase === 'arrived';
  });
  assert.ok(at(0.8, -0.25) < arrival, `${at(0.8, -0.25)} m off`);
  await desk.page.click('#pane-scene .row:has-text("Mark 1") button:has-text("Delete")');
  await until('no mark', () => twin.desk.marks.length === 0);
});

test('a keep-out on the way: the robot goes round it', async () => {
  await desk.tool('Keep-out');
  await desk.drag([[1.5, 0, 0], [1.7, 0, 0]]);
  await until('the keep-out', () => plant.obstacles.length === 1);
  const disc = plant.obstacles[0]!;
  assert.ok(Math.abs(disc.half[0] - 0.2) < 0.03, `radius ${disc.half[0]}`);
  await desk.tool('Go to');
  await desk.click([2.2, 0.25, 0]);
  await until('the goal', () => twin.count('go_to') === 1);
  await desk.page.locator('.row:has-text("Keep-out 1")').waitFor();
  await desk.page.waitForTimeout(300);  // drawn as well
  await desk.shot('keep_out');
  let nearest = Infinity;
  await until('the arrival', async () => {
    nearest = Math.min(nearest, at(disc.centre[0], disc.centre[1]));
    if (plant.phase !== 'arrived') await desk.engage();
    return plant.phase === 'arrived';
  });
  assert.ok(at(2.2, 0.25) < arrival);
  assert.ok(nearest > disc.half[0] + 0.2, `passed at ${nearest} m`);
});

test('a goal within a keep-out: told as not reached, and by how much', async () => {
  const disc = plant.obstacles[0]!;
  await desk.tool('Go to');
  await desk.click([disc.centre[0] + 0.1, disc.centre[1], 0]);
  await until('the goal', () => twin.count('go_to') === 2);
  await until('the end of the way', async () => {
    if (plant.phase === 'driving') await desk.engage();
    return plant.phase === 'short of the goal';
  });
  await until('the word on top', async () =>
    (await desk.page.textContent('#chips'))!.includes(`${plant.off.toFixed(2)} m short`));
  assert.ok(!(await desk.page.textContent('#chips'))!.includes('arrived'));
  assert.ok(at(disc.centre[0], disc.centre[1]) > disc.half[0] + 0.3);
});

test('a keep-out is moved, resized by numbers, deleted, and taken back', async () => {
  await desk.tool('Keep-out');
  await desk.drag([[1.5, 0, 0], [1.5, -0.3, 0]]);
  await until('the move', () => Math.abs(plant.obstacles[0]!.centre[1] + 0.3) < 0.05);
  await desk.page.click('#pane-scene button:has-text("Change")');
  await desk.page.fill('input[aria-label="radius m"]', '0.35');
  await desk.page.click('button:has-text("Apply")');
  await until('the size', () => plant.obstacles[0]!.half[0] === 0.35);
  await desk.page.click('#pane-scene .row button:has-text("Delete")');
  await until('none', () => plant.obstacles.length === 0);
  await desk.page.click('#commands button:has-text("Undo")');
  await until('it again', () => plant.obstacles.length === 1);
});

test('the bin by clicks: shown, taken away, accepted', async () => {
  plant.robot = [0.9, 0.1, 0.1];
  const bin = twin.bodies.find(b => b.name === 'bin')!;
  await desk.tool('Object');
  await desk.live();
  const shown = twin.newest('select') ? twin.count('select') : 0;
  await until('a proposal of the bin', async () => {
    await desk.page.keyboard.press('Escape');
    await desk.click(fromBody(bin, [-bin.half[0], 0, 0.05]));
    await desk.page.waitForTimeout(400);
    return twin.desk.mask.filter(Boolean).length > 20 && twin.count('select') > shown;
  });
  const mask = twin.desk.mask.filter(Boolean).length;
  await desk.page.click('#options button:has-text("take away")');
  assert.ok(mask > 20);
  await until('its size in words', async () =>
    /^1 click, \d\.\d\d × \d\.\d\d × \d\.\d\d m$/.test(
      (await desk.page.textContent('#options [role=status]')) ?? ''));
  await desk.page.fill('#options input', 'bin');
  await desk.shot('object');
  await desk.page.click('#options button:has-text("Accept")');
  await until('the object', () => twin.desk.objects.some(o => o.name === 'bin'));
  await until('it in the list', async () =>
    (await desk.page.textContent('#pane-scene'))!.includes('bin'));
});

test('what was hardly measured can not be accepted, and the words say so', async () => {
  await desk.tool('Object');
  await desk.click([1.5, 0.3, 0]);  // the floor: of no size
  await until('the words', async () => /^1 click, too little of it was measured/.test(
    (await desk.page.textContent('#options [role=status]')) ?? ''));
  assert.ok(await desk.page.locator('#options button:has-text("Accept")').isDisabled());
  await desk.page.keyboard.press('Escape');
});

test('a region is forgotten only after a yes', async () => {
  await desk.tool('Forget');
  await desk.drag([[1.6, -0.2, 0], [2, 0.2, 0]]);
  assert.equal(twin.count('forget'), 0);
  await desk.page.click('#options button:has-text("Forget what is in the box")');
  await until('the forgetting', () => twin.count('forget') === 1);
  const { centre, half } = twin.newest('forget') as unknown as { centre: Vec3; half: Vec3 };
  assert.ok(Math.abs(centre[0] - 1.8) < 0.05 && Math.abs(half[0] - 0.2) < 0.05);
  await desk.page.click('#commands button:has-text("Undo")');
  await until('the refusal', async () =>
    (await desk.page.textContent('#toasts'))!.includes('does not come back'));
});

test('an object is chosen and accepted in the picture by keys alone', async () => {
  const { keyboard } = desk.page;
  // The bin ahead, above the middle of the picture, where the floor is: upwards until it is met.
  plant.robot = [0.9, 0.1, Math.atan2(0.45, 1.6)];
  await until('a proposal', async () => {
    await keyboard.press('Escape');  // out of the picture
    await keyboard.press('Escape');  // nothing chosen: the camera may have moved since
    await desk.page.focus('#picture');
    await keyboard.press('ArrowUp');
    await keyboard.press('Enter');
    await desk.page.waitForTimeout(400);
    return desk.page.locator('#options button:has-text("Accept"):enabled').isVisible();
  });
  const accepted = twin.count('accept');
  await keyboard.press('y');
  await until('the accept', () => twin.count('accept') === accepted + 1);
  const clicks = () => desk.page.textContent('#options');
  // The page knows it by the answer; until then the proposal's own clicks are still told.
  await until('nothing chosen', async () => !(await clicks())!.includes('click'));
  await desk.page.focus('#picture');
  await keyboard.press('Enter');
  await until('a click', async () => (await clicks())!.includes('click'));
  await keyboard.press('Escape');
  assert.match((await clicks())!, /click/, 'the way out keeps what was chosen');
  await keyboard.press('Escape');
  await until('none', async () => !/\d click/.test((await clicks())!));
});

test('a session is saved, and opened after the keep-outs are gone', async () => {
  const { page } = desk;
  await page.click('#commands button:has-text("Hold")');
  await page.click('#tabs button:has-text("Session")');
  await page.fill('input[aria-label="Name of the saved session"]', 'Not a name');
  await page.click('#pane-session button:has-text("Save")');
  assert.equal(twin.count('save'), 0);
  const before = plant.obstacles.map(o => o.id);
  assert.ok(before.length > 0);
  await page.fill('input[aria-label="Name of the saved session"]', 'lab-1');
  await page.click('#pane-session button:has-text("Save")');
  await until('what was saved, in words', async () =>
    (await page.textContent('#toasts'))!.includes('The map follows'));
  await page.click('#tabs button:has-text("Scene")');
  await page.click('#pane-scene .row button:has-text("Delete")');
  await until('none', () => plant.obstacles.length === 0);
  await page.click('#tabs button:has-text("Session")');
  await page.click('#pane-session button[aria-label="Open lab-1"]');
  await until('them again', () => plant.obstacles.length === before.length);
  assert.deepEqual(plant.obstacles.map(o => o.id), before);
  // One of another map has no button, and a line that says how to start with it.
  const other = page.locator('#pane-session .row', { hasText: 'yesterday' });
  assert.match((await other.textContent())!, /teletact demo --console --session yesterday/);
  assert.ok(await other.locator('button').isHidden());
  await desk.shot('session');
  await page.click('#tabs button:has-text("Scene")');
});

test('the acts by keyboard alone', async () => {
  const { keyboard } = desk.page;
  await keyboard.press('Escape');
  await keyboard.press('6');
  const before = twin.count('go_to');
  for (let i = 0; i < 6; ++i) await keyboard.press('ArrowDown');
  await keyboard.press('Enter');
  await until('a goal', () => twin.count('go_to') === before + 1);
  await keyboard.press('3');
  const marks = twin.count('mark');
  await keyboard.down('Enter');
  for (let i = 0; i < 4; ++i) await keyboard.press('ArrowRight');
  await keyboard.up('Enter');
  await until('a mark', () => twin.count('mark') === marks + 1);
  assert.ok((twin.newest('mark')!.points as Vec3[]).length > 2);
  const undone = twin.count('undo');
  await keyboard.press('Control+z');
  await until('the undo', () => twin.count('undo') === undone + 1);
  await keyboard.press('r');
  await until('the recording', () => twin.desk.recording);
  await keyboard.press('?');
  await until('the keys', () => desk.page.isVisible('#help'));
  await desk.shot('keys');
  await keyboard.press('Escape');
});
