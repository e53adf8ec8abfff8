// What is drawn of a picture, and that its age is that of what is drawn.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import * as THREE from 'three';
import { greyOf } from '../src/panel/inset';
import { PictureLayer } from '../src/view/picture_layer';
import { Head, Picture } from '../src/wire/types';
import { desk, plant, twin } from './bench';
import { until } from './browser';

const { page } = desk;
const state = () => page.evaluate(() => ({
  frozen: document.getElementById('inset')!.classList.contains('frozen'),
  age: document.getElementById('age')!.textContent!,
}));
const pixels = () => page.evaluate(() => {
  const canvas = document.getElementById('picture') as HTMLCanvasElement;
  return [...canvas.getContext('2d')!.getImageData(0, 0, canvas.width, canvas.height).data];
});
const isGrey = (rgba: number[]) => rgba.every((v, i) => i % 4 === 3 || v === rgba[i - i % 4]);

test('colour that can not be read: frozen though pictures come, and nothing drives', async () => {
  await desk.live();
  twin.colour = 'broken';
  await until('the freeze', async () => (await state()).frozen);
  const before = twin.count('drive');
  await page.focus('#canvas');
  await page.keyboard.press('w');
  assert.equal(twin.count('drive'), before);
  assert.match((await page.textContent('#toasts'))!, /the picture is frozen/);
  twin.colour = 'each';
  await desk.live();
});

test('no colour any more: the depth as grey, told so, and it follows the robot', async () => {
  assert.ok(!isGrey(await pixels()));
  twin.colour = 'none';
  await until('the word', async () => (await state()).age.includes('no colour'));
  await desk.live();
  const grey = await pixels();
  assert.ok(isGrey(grey));
  assert.ok(new Set(grey).size > 20, 'things at different distances');
  const yaw = plant.robot[2];
  plant.robot[2] = yaw + 0.5;
  await until('another picture', async () => (await pixels()).join() !== grey.join());
  await desk.shot('no_colour');
  plant.robot[2] = yaw;
  twin.colour = 'each';
  await until('colour', async () => !(await state()).age.includes('no colour')
    && !isGrey(await pixels()));
});

test('colour in every third picture is colour', async () => {
  twin.colour = 'third';
  await page.waitForTimeout(2500);
  assert.ok(!(await state()).age.includes('no colour'));
  assert.ok(!isGrey(await pixels()));
  await desk.live();
  twin.colour = 'each';
});

test('grey: near is bright, and what was not measured is black', () => {
  const rgba = greyOf(new Uint16Array([0, 300, 2000, 5000, 9000]));
  const greys = [0, 1, 2, 3, 4].map(i => rgba[4 * i]!);
  assert.equal(greys[0], 0);
  assert.equal(greys[1], 255);
  assert.ok(greys[2]! < 255 && greys[2]! > greys[3]! && greys[3] === greys[4] && greys[3]! > 0);
});

test('colours lie where they were seen from, and old ones are left out', async () => {
  const before = globalThis.createImageBitmap;
  globalThis.createImageBitmap = (async () =>
    ({ width: 2, height: 2, close: () => {} })) as unknown as typeof createImageBitmap;
  const layer = new PictureLayer(() => {}, false);
  const { uniforms } = layer.points.material as THREE.ShaderMaterial;
  const take = async (data: number, x: number, colour: boolean) => {
    const picture: Picture = { width: 2, height: 2, fx: 1, fy: 1, cx: 0.5, cy: 0.5,
      camera: [x, 0, 0, 1, 0, 0, 0], depth: new Uint16Array(4),
      jpeg: colour ? new Uint8Array(1) : null };
    const head: Head = { kind: 4, flags: 0, sequence: 1, time: data, data, made: 0 };
    layer.take(picture, head, 100);
    await new Promise(done => setTimeout(done, 5));
  };
  const shift = () => (uniforms.to_colour!.value as THREE.Matrix4).elements[12];
  await take(10, 0, true);
  assert.equal(uniforms.has_colour!.value, 1);
  assert.equal(shift(), 0);
  await take(10.4, 0.3, false);  // the camera has moved; the colours have not
  assert.equal(uniforms.has_colour!.value, 1);
  assert.ok(Math.abs(shift()! - 0.3) < 1e-9);
  await take(11.1, 0.3, false);
  assert.equal(uniforms.has_colour!.value, 0);
  await take(11.2, 0.3, true);
  assert.equal(uniforms.has_colour!.value, 1);
  layer.forget();
  assert.equal(uniforms.has_colour!.value, 0);
  globalThis.createImageBitmap = before;
});

test('points of a picture: whole pixels apart, no more than who draws may have', () => {
  for (const [width, height] of [[640, 480], [320, 240], [640, 360], [7, 5], [1, 1]] as const) {
    const least = new Map<boolean, number>();
    for (const software of [false, true]) {
      const layer = new PictureLayer(() => {}, software);
      const most = software ? 10000 : 60000;
      layer.take({ width, height, fx: 1, fy: 1, cx: 0, cy: 0, camera: [0, 0, 0, 1, 0, 0, 0],
        depth: new Uint16Array(width * height), jpeg: null },
      { kind: 4, flags: 0, sequence: 1, time: 0, data: 0, made: 0 }, 100);
      const { step_px: step } = (layer.points.material as THREE.ShaderMaterial).uniforms;
      const drawn = (by: number) => Math.floor(width / by) * Math.floor(height / by);
      assert.equal(layer.points.geometry.drawRange.count, drawn(step!.value));
      assert.ok(drawn(step!.value) <= most);
      assert.ok(step!.value === 1 || drawn(step!.value - 1) > most, 'fewer than need be');
      least.set(software, step!.value);
    }
    assert.ok(least.get(true)! >= least.get(false)!);
  }
});
