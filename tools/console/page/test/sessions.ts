// Driving and what ends it, the stop, frozen pictures, who may act, coming back.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { browser, context, desk, plant, twin } from './bench';
import { Desk, newPage, until } from './browser';

const standing = 0.001;  // m/s

const { keyboard } = desk.page;
const stands = () => Math.hypot(...plant.velocity) < standing;

async function drives(): Promise<void> {
  await until('driving', async () => {
    await keyboard.up('w');
    await desk.live();
    await desk.page.focus('#canvas');
    await keyboard.down('w');
    await desk.page.waitForTimeout(100);
    return plant.holds('drive') && !stands();
  });
}

test('keys drive, and stop when they go up', async () => {
  await keyboard.press('1');
  await drives();
  await keyboard.up('w');
  await until('standing', () => stands() && !plant.holds('drive'));
});

test('the pad drives from the first press of each button', async () => {
  const { mouse } = desk.page;
  await desk.page.focus('#canvas');
  let drove = false;
  // A machine too busy to send a token within 200 ms lets go, rightly: another button.
  for (const name of ['Turn left', 'Drive backwards', 'Drive to the left', 'Drive to the right']) {
    const box = (await desk.page.locator(`#pad button[aria-label^="${name}"]`).boundingBox())!;
    await desk.live();
    const before = twin.count('drive');
    await mouse.move(box.x + box.width / 2, box.y + box.height / 2);
    await mouse.down();
    await desk.page.waitForTimeout(400);
    drove = drove || (plant.holds('drive') && !stands() && twin.count('drive') > before + 3);
    await mouse.up();
    await until('standing', () => stands() && !plant.holds('drive'));
  }
  assert.ok(drove);
});

test('driven into a keep-out: said at the pad, and no longer when it is let go', async () => {
  const [x, y, yaw] = plant.robot;
  plant.obstacles = [{ id: 7, kind: 'disc', half: [0.2, 0.2, 0.1], yaw: 0,
    centre: [x + 0.6 * Math.cos(yaw), y + 0.6 * Math.sin(yaw), 0] }];
  await until('the warning', async () => {
    if (!plant.holds('drive')) await drives();
    return /keep-out 7/i.test((await desk.page.textContent('#pad [role=alert]'))!);
  });
  await keyboard.up('w');
  await until('none', () => desk.page.isHidden('#pad [role=alert]'));
  plant.obstacles = [];
  plant.robot = [x, y, yaw];
});

test('no key drives while a control has the focus', async () => {
  await desk.page.focus('#commands button');
  const before = twin.count('drive');
  await keyboard.press('w');
  await keyboard.press('a');
  await keyboard.press('3');
  assert.equal(twin.count('drive'), before);
  assert.equal(await desk.page.getAttribute('#rail button:has-text("Look")', 'aria-pressed'),
    'true');
});

const losses: [string, () => Promise<unknown>][] = [
  ['a blur', () => desk.page.evaluate(() => dispatchEvent(new Event('blur')))],
  ['a pointercancel', () => desk.page.evaluate(() =>
    dispatchEvent(new PointerEvent('pointercancel')))],
  ['a frozen browser', () => desk.page.evaluate(() => {
    const from = performance.now();
    while (performance.now() - from < 500);
  })],
];
for (const [name, lose] of losses) {
  test(`${name} ends driving, and a new press is needed`, async () => {
    await drives();
    await lose();
    await until('standing', () => stands() && !plant.holds('drive'));
    const before = twin.count('drive');
    await keyboard.down('w');  // playwright: a repeat of the key that is down
    await desk.page.waitForTimeout(150);
    assert.ok(stands());
    assert.equal(twin.count('drive'), before);
    await keyboard.up('w');
  });
}

test('the stop, by key and by button', async () => {
  await desk.page.focus('#commands button');
  for (const press of [() => keyboard.press('Space'), () => desk.page.click('#stop')]) {
    const before = twin.stops;
    await press();
    await until('the stop', () => twin.stops > before);
    await until('the ramp down', () => plant.mode === 'hold' && stands());
  }
  assert.ok(twin.desk.steps.stop);
});

test('the robot is lost: locked, said why; back: engaged by a new press', async () => {
  plant.linkUp = false;
  await until('the lock', () => desk.page.evaluate(() =>
    document.getElementById('view')!.classList.contains('frozen')));
  await desk.page.click('#tabs button:has-text("Health")');
  await until('the reason', async () =>
    (await desk.page.textContent('#pane-health'))!.includes('The robot is silent'));
  const before = twin.count('drive');
  await desk.page.focus('#canvas');
  await keyboard.press('w');
  assert.equal(twin.count('drive'), before);
  await desk.shot('frozen');
  plant.linkUp = true;
  await desk.live();
  assert.notEqual(plant.mode, 'engaged');
  await until('the ramp down to end', () => plant.mode === 'hold');
  await desk.engage();
});

test('a lost socket is dialled again; nothing is held after it', async () => {
  twin.dropSockets();
  await until('no engagement', () => plant.mode === 'hold');
  await until('the connection', () => desk.page.isHidden('#banner'));
  await until('the role', async () => (await desk.page.textContent('#chips'))!
    .includes('Operator'));
  assert.equal(plant.mode, 'hold');
});

test('reload resumes; a second window takes over and the first stays away', async () => {
  await desk.page.reload();
  await desk.ready();
  assert.ok(!desk.page.url().includes('code'));
  const other = await newPage(context);
  await other.goto(new URL(desk.page.url()).origin);
  await until('the note', () => desk.page.isVisible('#banner'));
  assert.match((await desk.page.textContent('#banner'))!, /another window/);
  await desk.page.waitForTimeout(700);  // longer than the first delay of dialling again
  assert.ok(await desk.page.isVisible('#banner'));
  await other.close();
  await desk.page.click('#banner button');
  await until('the connection', () => desk.page.isHidden('#banner'));
});

test('a viewer sees, does not act, and may stop; on a tablet, in light', async () => {
  await desk.page.click('#tabs button:has-text("Session")');
  await desk.page.click('button:has-text("Link for a viewer")');
  await until('the link', () => desk.page.isVisible('.sayable'));
  const url = (await desk.page.textContent('.sayable'))!;
  const tablet = await browser.newContext({ viewport: { width: 1024, height: 768 },
    hasTouch: true, colorScheme: 'light' });
  const viewer = await Desk.open(tablet, twin, url);
  await until('the role', async () => (await viewer.page.getAttribute(
    '#rail button:has-text("Touch")', 'aria-disabled')) === 'true');
  const hands = twin.count('hand');
  await viewer.page.click('#rail button:has-text("Touch")', { force: true });
  await viewer.click([1, 0, 0]);
  assert.equal(twin.count('hand'), hands);
  const before = twin.stops;
  await viewer.page.tap('#stop');
  await until('the stop', () => twin.stops > before);
  await viewer.shot('tablet_light');
  assert.deepEqual(viewer.errors, []);
  await tablet.close();
});

test('a used code opens nothing', async () => {
  const stranger = await browser.newContext();
  const page = await newPage(stranger);
  await page.goto(`${new URL(desk.page.url()).origin}/#code=00`);
  await until('the refusal', () => page.isVisible('#banner'));
  assert.match((await page.textContent('#banner'))!, /no session/);
  await stranger.close();
});

test('names for a screen reader, and no error all along', async () => {
  const nameless = await desk.page.evaluate(() =>
    [...document.querySelectorAll('button, input, canvas, select')].filter(element =>
      !element.textContent?.trim() && !element.getAttribute('aria-label')
      && !element.closest('label')).map(element => element.outerHTML));
  assert.deepEqual(nameless, []);
  assert.deepEqual(desk.errors, []);
});
