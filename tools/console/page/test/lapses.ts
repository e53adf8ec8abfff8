// What does not arrive, arrives late, or is refused while it is held; and what Delete is about.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { Obstacle, Vec3 } from '../src/wire/types';
import { context, desk, plant, twin } from './bench';
import { newPage, until } from './browser';

const { page } = desk;
const { keyboard, mouse } = page;
const toasts = async () => (await page.textContent('#toasts'))!;
const note = async () => await page.isVisible('#stop-note')
  ? (await page.textContent('#stop-note'))! : '';
const engagePressed = () => page.getAttribute('#commands button:has-text("Engage")',
  'aria-pressed');

async function toastsAdded(run: () => Promise<void>): Promise<string[]> {
  await page.evaluate(() => {
    const seen: string[] = [];
    Object.assign(window, { seenToasts: seen });
    new MutationObserver(all => all.forEach(m => m.addedNodes.forEach(n =>
      seen.push(n.textContent ?? '')))).observe(document.getElementById('toasts')!,
      { childList: true });
  });
  await run();
  return page.evaluate(() => (window as unknown as { seenToasts: string[] }).seenToasts);
}

test('a stop that no answer follows is told, at once and then loud, until one comes', async () => {
  await page.focus('#canvas');
  twin.hang();
  await keyboard.press('Space');
  assert.match(await note(), /no answer yet/);
  await until('the loud word', async () =>
    /did not reach the box.*on the robot/.test(await note()));
  twin.goOn();
  await until('its end', async () => await note() === '');
  await until('the late word', async () => (await toasts()).includes('arrived late'));
  await until('the ramp down', () => plant.mode === 'hold');
});

test('a stop that is answered by the WebSocket alone has arrived', async () => {
  twin.hangPosts = true;
  await keyboard.press('Space');
  await until('the answer', async () => (await toasts()).includes('Stop: the box ramps down'));
  await page.waitForTimeout(1500);
  assert.equal(await note(), '');
  twin.hangPosts = false;
});

test('an answer that comes late is told', async () => {
  await until('the connection', () => page.isHidden('#banner'));
  twin.hang();
  await keyboard.press('n');
  await page.keyboard.type('late');
  await keyboard.press('Enter');
  await until('that it is missing', async () =>
    (await toasts()).includes('did not answer in 5 s'));
  twin.goOn();
  await until('that it came', async () => /Late, after \d+\.\d s, note: done/.test(await toasts()));
  await page.click('#tabs button:has-text("Scene")');
});

test('a touch that rests and has lapsed on the box ends here too, told once', async () => {
  await desk.tool('Touch');
  await mouse.move(...await desk.screen([1, -0.2, 0]));
  await until('the touch', async () => {
    await mouse.up();
    await mouse.down();
    await page.waitForTimeout(200);
    return plant.hand?.press === true;
  });
  const added = await toastsAdded(async () => {
    plant.lose(['hand']);
    await until('a token without it', () => !plant.lost.includes('hand'));
    await page.waitForTimeout(500);
  });
  assert.equal(added.filter(text => text.includes('Let go of touching')).length, 1, added.join());
  assert.equal(plant.hand, null);
  await mouse.up();
});

test('a robot that stopped while this box holds is told', async () => {
  const chips = async () => (await page.textContent('#chips'))!;
  plant.robotMode = 'safe stop';
  await until('the chip', async () => (await chips()).includes('Robot safe stop'));
  plant.robotMode = null;
  await until('the chip', async () => (await chips()).includes('Hold'));
});

// A machine too busy for a token within 200 ms lets go, rightly: engaged again until it is shown.
const engagedHere = () => until('the button', async () => {
  await desk.engage();
  return await engagePressed() === 'true';
});

test('a stop by somebody else leaves no pressed button', async () => {
  await engagedHere();
  plant.stop();
  await until('the button', async () => await engagePressed() === 'false');
});

test('an engagement that has lapsed on the box is no pressed button, and one press engages',
  async () => {
    await engagedHere();
    plant.lose(['engage']);
    await until('the end', () => plant.mode === 'hold');
    await until('the button', async () => await engagePressed() === 'false');
    await until('the mode on the page', async () => {
      await desk.engage();
      return (await page.textContent('#chips'))!.includes('engaged');
    });
    // Before the page can know of it.
    twin.tellsLost = false;
    plant.lose(['engage']);
    await until('the mode on the page', async () =>
      !(await page.textContent('#chips'))!.includes('engaged'));
    const added = await toastsAdded(async () => {
      await page.click('#commands button:has-text("Engage")');
      await until('an answer', async () => /Engaged while|Refused/.test(await toasts()));
    });
    twin.tellsLost = true;
    assert.ok(!added.some(text => text.includes('let go first')), added.join());
    await page.click('#commands button:has-text("Hold")');
  });

test('a touch that is refused lets go and is told once', async () => {
  twin.desk.haptic = true;
  await desk.tool('Touch');
  const [x, y] = await desk.screen([1, -0.2, 0]);
  let told: string[] = [];
  // Where browser or line stood still the page lets go by itself, and says so: pressed again. Of
  // other acts, such as the hold of the test before, an answer may still come.
  await until('a press without a stall', async () => {
    const added = await toastsAdded(async () => {
      await mouse.move(x, y);
      await mouse.down();
      for (let i = 0; i < 30; ++i) {
        await mouse.move(x + i, y);
        await page.waitForTimeout(20);
      }
      await mouse.up();
      await page.waitForTimeout(300);
    });
    told = added.filter(text => text.includes('Let go of touching'));
    return told.length > 0 && !told.some(text => /stood still|heard too late/.test(text));
  });
  twin.desk.haptic = false;
  assert.equal(told.length, 1, told.join(' | '));
  assert.match(told[0]!, /a haptic device is in its place/);
});

const disc: Obstacle = { id: 0, kind: 'disc', centre: [1.5, 0, 0], half: [0.2, 0.2, 0.25],
  yaw: 0 };

async function clickWithLook(p: Vec3): Promise<void> {
  await keyboard.press('1');
  await desk.click(p);
}
const chosen = () => page.locator('#pane-scene .row.chosen').count();

test('Delete takes what is chosen in the scene: a keep-out, a mark; of an object it says how',
  async () => {
    await keyboard.press('Escape');
    plant.obstacles = [{ ...disc, id: 1 }];
    twin.desk.marks = [{ id: 1, points: [[1, -0.6, 0], [1.2, -0.6, 0]] }];
    twin.desk.objects = [{ id: 9, name: 'cup', centre: [1.2, 0.6, 0.1], extent: [0.2, 0.2, 0.2],
      quat: [1, 0, 0, 0], seen: true }];
    await page.locator('.row:has-text("cup")').waitFor();
    await page.waitForTimeout(400);  // drawn as well
    await clickWithLook([1.5, 0, 0]);
    await until('the choice', async () => await chosen() === 1);
    await keyboard.press('Delete');
    await until('no keep-out', () => plant.obstacles.length === 0);
    await clickWithLook([1.1, -0.6, 0]);
    await until('the choice', async () => await chosen() === 1);
    await keyboard.press('Delete');
    await until('no mark', () => twin.desk.marks.length === 0);
    await clickWithLook([1.2, 0.6, 0.1]);
    await until('the choice', async () => await chosen() === 1);
    await keyboard.press('Delete');
    await until('the word', async () => (await toasts()).includes('Undo takes an object back'));
    // By the tool that draws them, and by the list's button alone.
    plant.obstacles = [{ ...disc, id: 2 }];
    await page.locator('.row:has-text("Keep-out 2")').waitFor();
    await page.waitForTimeout(400);
    await desk.tool('Keep-out');
    await desk.click([1.5, 0, 0]);
    await until('the choice', async () => await chosen() === 1);
    await page.focus('#canvas');
    await keyboard.press('Delete');
    await until('no keep-out', () => plant.obstacles.length === 0);
    twin.desk.marks = [{ id: 5, points: [[1, -0.6, 0]] }];
    await page.focus('.row:has-text("Mark 5") button:has-text("Look at")');
    await keyboard.press('Enter');
    await keyboard.press('Delete');
    await until('no mark', () => twin.desk.marks.length === 0);
    twin.desk.objects = [];
    await page.focus('#canvas');
    await keyboard.press('Escape');
  });

test('the right link, pasted into the tab of a wrong one, opens the room', async () => {
  const other = await context.browser()!.newContext();
  const tab = await newPage(other);
  const origin = new URL(page.url()).origin;
  await tab.goto(`${origin}/#code=00`);
  await until('the refusal', () => tab.isVisible('#banner'));
  await tab.goto(twin.url('viewer'));
  await until('no banner', () => tab.isHidden('#banner'));
  assert.equal(tab.url(), `${origin}/`);
  await until('the role', async () => (await tab.textContent('#chips'))!.includes('Viewer'));
  await other.close();
});

test('the page says of each large view that it was seen, by connection', async () => {
  const all = () => twin.seen().some(b => b.seen > 1e5 && b.not === 0);
  await until('that all is seen', all);
  twin.dropSockets();
  await until('that it is gone', () => !all());
  await until('that all is seen again', all);
});
