// Pointing at what the newest picture shows, against planes in closed form.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import * as THREE from 'three';
import { pictureHit } from '../src/view/picture_hit';
import { Standing } from '../src/wire/standing';
import { Picture, Vec3 } from '../src/wire/types';
import { randomFrom } from '../twin/world';
import { seed } from './browser';

const [width, height, f] = [320, 240, 262];
// A camera at `eye` that looks along +x of the room, `down` radians below the horizon.
function camera(eye: Vec3, down: number): { camera: number[]; turn: THREE.Quaternion } {
  // Columns: the camera's right, down and forward in the room.
  const [s, c] = [Math.sin(down), Math.cos(down)];
  const turn = new THREE.Quaternion().setFromRotationMatrix(
    new THREE.Matrix4().set(0, -s, c, 0, -1, 0, 0, 0, 0, -c, -s, 0, 0, 0, 0, 1));
  return { camera: [...eye, turn.w, turn.x, turn.y, turn.z], turn };
}

// The depth of the nearest surface that `cast` finds: metres along the ray; Infinity: none.
function picture(eye: Vec3, down: number, cast: (from: Vec3, way: Vec3) => number,
  noise: () => number = () => 0): Picture {
  const { camera: place, turn } = camera(eye, down);
  const depth = new Uint16Array(width * height);
  for (let v = 0; v < height; ++v) {
    for (let u = 0; u < width; ++u) {
      const way = new THREE.Vector3((u - width / 2) / f, (v - height / 2) / f, 1)
        .applyQuaternion(turn).toArray() as Vec3;
      const z = cast(eye, way);
      depth[v * width + u] = z < 60 ? Math.round(1000 * (z + noise())) : 0;
    }
  }
  return { width, height, fx: f, fy: f, cx: width / 2, cy: height / 2, camera: place, depth,
    jpeg: null };
}

const top = 0.5, near = 1.3, far = 2.3;  // a flat top before a floor: m
const table = (from: Vec3, way: Vec3): number => {
  const onTop = (top - from[2]) / way[2];
  const x = from[0] + onTop * way[0];
  if (onTop > 0 && x >= near && x <= far) return onTop;
  const front = (near - from[0]) / way[0];
  const z = from[2] + front * way[2];
  if (front > 0 && z >= 0 && z <= top) return front;
  return way[2] < 0 ? -from[2] / way[2] : Infinity;
};
const unit = (a: Vec3, b: Vec3): Vec3 => {
  const way = b.map((v, k) => v - a[k]!) as Vec3;
  const size = Math.hypot(...way);
  return way.map(v => v / size) as Vec3;
};

test('a flat top at 8 to 15 degrees is met where it is, from other eyes too', () => {
  const random = randomFrom(seed);
  const eye: Vec3 = [0, 0, 0.82];
  const seen = picture(eye, 0.2, table, () => 0.003 * (random() - 0.5));
  const eyes: Vec3[] = [eye, [-1, 0.5, 1.5], [1.5, -1, 2.5], [0.5, 0, 3]];
  for (let i = 0; i < 400; ++i) {
    const at: Vec3 = [near + 0.1 + (far - near - 0.2) * random(), 0.6 * (random() - 0.5), top];
    const from = eyes[i % eyes.length]!;
    const hit = pictureHit(seen, from, unit(from, at));
    assert.ok(hit, `seed ${seed}: ${at.join()} from ${from.join()} is met by nothing`);
    const off = Math.hypot(...hit.point.map((v, k) => v - at[k]!));
    assert.ok(off < 0.02, `seed ${seed}: ${off} m off at ${at.join()} from ${from.join()}`);
    assert.ok(hit.normal[2] > 0.9, `seed ${seed}: normal ${hit.normal.join()}`);
    assert.ok(Math.abs(Math.hypot(...hit.point.map((v, k) => v - from[k]!)) - hit.distance) < 1e-9);
  }
});

test('what no pixel shows is met by nothing: behind the top, out of view, where depth is 0', () => {
  const eye: Vec3 = [0, 0, 0.82];
  const seen = picture(eye, 0.2, table);
  // From above through the shadow behind the table: between its edge and the floor that is seen.
  const shadow = pictureHit(seen, [2.8, 0, 2], [0, 0, -1]);
  assert.equal(shadow, null);
  // From below, the side that the camera does not see.
  assert.equal(pictureHit(seen, [1.8, 0, 0.2], [0, 0, 1]), null);
  assert.equal(pictureHit(seen, [-3, 0, 1], [-1, 0, 0]), null);
  const blind = { ...seen, depth: new Uint16Array(width * height) };
  assert.equal(pictureHit(blind, eye, unit(eye, [1.8, 0, top])), null);
  assert.equal(pictureHit({ ...seen, depth: new Uint16Array(0) }, eye, [1, 0, 0]), null);
});

// The same by each triangle of each cell, whatever the ray passes.
function byEach(p: Picture, lifted: THREE.Vector3[], from: Vec3, way: Vec3): number {
  const ray = new THREE.Ray(new THREE.Vector3(...from), new THREE.Vector3(...way));
  let nearest = Infinity;
  for (let v = 0; v + 1 < height; ++v) {
    for (let u = 0; u + 1 < width; ++u) {
      const i = v * width + u;
      const four = [i, i + 1, i + width, i + width + 1];
      const depths = four.map(k => p.depth[k]! / 1000);
      const least = Math.min(...depths);
      if (least === 0 || Math.max(...depths) - least > 0.04 * least) continue;
      const [a, b, c, d] = four.map(k => lifted[k]!) as [THREE.Vector3, THREE.Vector3,
        THREE.Vector3, THREE.Vector3];
      for (const [x, y, z] of [[a, c, b], [d, b, c]] as const) {
        const at = ray.intersectTriangle(x, y, z, true, new THREE.Vector3());
        if (at) nearest = Math.min(nearest, at.distanceTo(ray.origin));
      }
    }
  }
  return nearest;
}

test('rays at random meet what a ray against each triangle meets', () => {
  const random = randomFrom(seed + 1);
  const eye: Vec3 = [0, 0, 0.82];
  const seen = picture(eye, 0.2, table);
  const { turn } = camera(eye, 0.2);
  const lifted = Array.from(seen.depth, (mm, i) => new THREE.Vector3(
    (i % width - seen.cx) / f, (Math.floor(i / width) - seen.cy) / f, 1)
    .multiplyScalar(mm / 1000).applyQuaternion(turn).add(new THREE.Vector3(...eye)));
  let met = 0;
  for (let i = 0; i < 30; ++i) {
    const from: Vec3 = [4 * random() - 2, 2 * random() - 1, 0.9 + 2 * random()];
    const way = unit(from, [0.8 + 2.5 * random(), random() - 0.5, 0]);
    const hit = pictureHit(seen, from, way)?.distance ?? Infinity;
    const truth = byEach(seen, lifted, from, way);
    met += hit < Infinity ? 1 : 0;
    assert.ok(hit === truth || Math.abs(hit - truth) < 1e-3,
      `seed ${seed}: ${hit} for ${truth} from ${from.join()} along ${way.join()}`);
  }
  assert.ok(met > 5, `${met} of 30`);
});

test('the camera stands when its pictures have been of one place for long enough', () => {
  const at = (x: number, yaw = 0) => [x, 0, 0.8, Math.cos(yaw / 2), 0, 0, Math.sin(yaw / 2)];
  const standing = new Standing();
  assert.equal(standing.stands, false);
  let t = 10;
  for (let i = 0; i < 8; ++i) {
    standing.take(at(0.002 * (i % 2)), t += 0.066);
    standing.take(at(0), t - 0.2);  // an older one, with colour
  }
  assert.equal(standing.stands, true);
  standing.take(at(0, 0.01), t += 0.066);  // it turns
  assert.equal(standing.stands, false);
  for (let i = 0; i < 30; ++i) standing.take(at(0.002 * i, 0.01), t += 0.066);  // 3 cm/s
  assert.equal(standing.stands, false);
  for (let i = 0; i < 8; ++i) standing.take(at(0.06, 0.01), t += 0.066);
  assert.equal(standing.stands, true);
  standing.take(at(0.06, 0.01), 3);  // a box that was started again
  assert.equal(standing.stands, false);
  standing.forget();
  assert.equal(standing.stands, false);
});
