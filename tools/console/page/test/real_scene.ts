// The scene of the tests against the real box, as config/scenes has it, but with things at seeded
// places, all boxes: twin/world.ts then knows the truth about it.
import { readFileSync, writeFileSync } from 'node:fs';
import { Picture, Selection, Vec3 } from '../src/wire/types';
import { Body, Caster, makeBodies, randomFrom } from '../twin/world';

// What the tests need free: the robot's way along y = 0.1 and round a keep-out on it, at its left.
// Of a flat top 1.75 m away the far half is seen at 12 to 13 degrees, where the fused surface has
// holes until the camera comes nearer.
export function realBodies(seed: number): Body[] {
  const random = randomFrom(seed);
  for (let i = 0; i < 8; ++i) random();
  const places: Record<string, Vec3> = {
    pedestal: [1.2 + 0.6 * random(), -0.6 - 0.1 * random(), 0.25], crate: [0.9, 1.6, 0.15] };
  return makeBodies(seed).map(b => ({ ...b, centre: places[b.name] ?? b.centre }));
}

// Without the shapes of `from`.
export function writeScene(from: string, bodies: Body[], file: string): void {
  const sections = readFileSync(from, 'utf8').split(/^(?=\[)/m);
  const shape = /^\[\[(world\.(box|cylinder|sphere)|hand\.segment)\]\]/;
  const kept = sections.filter(s => !shape.test(s));
  const shapes = bodies.map(b => `[[world.box]]
name = "${b.name}"
size_m = [${b.half.map(v => (2 * v).toFixed(4)).join()}]
position_m = [${b.centre.map(v => v.toFixed(4)).join()}]
yaw_deg = ${(b.yaw * 180 / Math.PI).toFixed(3)}
colour = [${b.colour.join()}]
`);
  writeFileSync(file, [...kept, ...shapes].join('\n'));
}

// v turned by the quaternion w x y z.
function turned(q: number[], v: Vec3): Vec3 {
  const [w, x, y, z] = q as [number, number, number, number];
  const t: Vec3 = [2 * (y * v[2] - z * v[1]), 2 * (z * v[0] - x * v[2]), 2 * (x * v[1] - y * v[0])];
  return [v[0] + w * t[0] + y * t[2] - z * t[1], v[1] + w * t[1] + z * t[0] - x * t[2],
    v[2] + w * t[2] + x * t[1] - y * t[0]];
}

// What a body truly covers in the picture that a proposed mask is about: 1 a pixel of the mask.
export function truthOf(selection: Selection, picture: Picture, bodies: Body[],
  body: Body): Uint8Array {
  const { width, height } = selection;
  const { camera, fx, fy, cx, cy } = picture;
  const caster = new Caster(bodies, camera.slice(0, 3) as Vec3);
  return Uint8Array.from({ length: width * height }, (_, i) => {
    // The middle of a pixel, in the picture that the intrinsics are of.
    const u = (i % width + 0.5) * picture.width / width - 0.5;
    const v = (Math.floor(i / width) + 0.5) * picture.height / height - 0.5;
    const way = turned(camera.slice(3), [(u - cx) / fx, (v - cy) / fy, 1]);
    return caster.cast(way).id === body.id ? 1 : 0;
  });
}

// Common pixels by all.
export function overlap(mask: Uint8Array, truth: Uint8Array): number {
  let [both, either] = [0, 0];
  mask.forEach((m, i) => {
    both += m & truth[i]!;
    either += m | truth[i]!;
  });
  return both / either;
}

// Where a person would click next: the middle of the largest error, by the widest square in it.
export function nextClick(selection: Selection, truth: Uint8Array): { u: number; v: number;
  adds: boolean } {
  const { width, height, mask } = selection;
  let best = { size: 0, u: 0, v: 0, adds: true };
  for (const adds of [true, false]) {
    const wrong = (i: number) => adds ? truth[i]! > mask[i]! : mask[i]! > truth[i]!;
    // Of each pixel: the side of the largest wrong square whose last corner it is.
    const side = new Int32Array(width * height);
    for (let i = 0; i < side.length; ++i) {
      if (!wrong(i)) continue;
      const inner = i % width > 0 && i >= width;
      side[i] = inner ? 1 + Math.min(side[i - 1]!, side[i - width]!, side[i - width - 1]!) : 1;
      if (side[i]! <= best.size) continue;
      const half = Math.floor(side[i]! / 2);
      best = { size: side[i]!, adds, u: (i % width - half + 0.5) / width,
        v: (Math.floor(i / width) - half + 0.5) / height };
    }
  }
  return best;
}
