// When frames are drawn, and the surface as it is drawn and pointed at. Without a browser.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import * as THREE from 'three';
import { FrameBudget } from '../src/view/budget';
import { FloorLayer } from '../src/view/floor_layer';
import { MeshLayer } from '../src/view/mesh_layer';
import { Block } from '../src/wire/types';

// Calls of the browser every 16 ms for a second; one that draws makes the next one `late`.
function framesOf(budget: FrameBudget, late = 0, acts: number[] = []): number[] {
  const drawn: number[] = [];
  const waiting = [...acts];
  for (let now = 0; now < 1000; now += 16) {
    budget.called(now);
    while (waiting[0]! <= now) budget.acted(waiting.shift()!);
    if (!budget.due(now)) continue;
    budget.drawn(now);
    drawn.push(now);
    now += late;
  }
  return drawn;
}

test('a graphics chip draws in each call', () => {
  assert.equal(framesOf(new FrameBudget(false)).length, 63);
});
test('without one frames are few, and fewer where they are dear', () => {
  assert.equal(framesOf(new FrameBudget(true)).length, 9);
  const dear = framesOf(new FrameBudget(true), 100).length;
  assert.ok(dear >= 4 && dear < 8, String(dear));
});
test('while the view is turned they are more', () => {
  const budget = new FrameBudget(true);
  budget.turning = true;
  assert.equal(framesOf(budget).length, 16);
});
test('no frame begins right behind a press, and yet 5 a second are drawn', () => {
  const drawn = framesOf(new FrameBudget(true), 0, [100]);
  assert.ok(!drawn.some(t => t > 100 && t < 180), drawn.join());
  const always = framesOf(new FrameBudget(true), 0, Array.from({ length: 100 }, (_, i) => 10 * i));
  assert.ok(always.length >= 5, always.join());
});

const edge = 0.2;

// A square of `count` stripes across a block, at a share of its height.
function square(x: number, y: number, share: number, version: number, count = 1): Block {
  const z = share * edge;
  const positions: number[] = [];
  const triangles: number[] = [];
  for (let i = 0; i < count; ++i) {
    const [from, to] = [edge * (x + i / count), edge * (x + (i + 1) / count)];
    positions.push(from, y * edge, z, to, y * edge, z, from, (y + 1) * edge, z, to, (y + 1) * edge,
      z);
    const k = 4 * i;
    triangles.push(k, k + 1, k + 2, k + 1, k + 3, k + 2);
  }
  return { x, y, z: 0, version, positions: new Float32Array(positions),
    colours: new Uint8Array(positions.length), triangles: new Uint16Array(triangles) };
}

function gone(x: number, y: number, version: number): Block {
  return { x, y, z: 0, version, positions: new Float32Array(0), colours: new Uint8Array(0),
    triangles: new Uint16Array(0) };
}

let sequence = 0;
const put = (mesh: MeshLayer, blocks: Block[], restart = false) =>
  mesh.take({ sequence: ++sequence, restart, edge, blocks });

// Straight down in W, which the mesh is asked in as long as it hangs below nothing.
function height(mesh: MeshLayer, x: number, y: number): number | null {
  const ray = new THREE.Ray(new THREE.Vector3(x, y, 1), new THREE.Vector3(0, 0, -1));
  const hit = mesh.hit(ray);
  if (hit) assert.ok(hit.normal[2] > 0.99);
  return hit ? Math.round(1000 * hit.point[2]) / 1000 : null;
}

// Triangles with an area, in the buffers that are drawn.
function drawnTriangles(mesh: MeshLayer): number {
  let count = 0;
  for (const child of mesh.group.children) {
    const { index, drawRange } = (child as THREE.Mesh).geometry;
    for (let i = 0; i < drawRange.count; i += 3) {
      const corners = [0, 1, 2].map(k => index!.array[i + k]);
      if (new Set(corners).size === 3) ++count;
    }
  }
  return count;
}

test('a block is in the scene when it is taken, and is changed where it lies', () => {
  const mesh = new MeshLayer();
  const applied: number[] = [];
  mesh.onApplied = seq => applied.push(seq);
  put(mesh, [square(0, 0, 0.1, 1), square(1, 0, 0.2, 1)], true);
  assert.deepEqual(applied, [sequence]);
  assert.equal(height(mesh, 0.1, 0.1), 0.02);
  assert.equal(height(mesh, 0.3, 0.1), 0.04);
  assert.equal(height(mesh, 0.5, 0.1), null);
  const { geometry } = mesh.group.children[0] as THREE.Mesh;
  put(mesh, [square(0, 0, 0.5, 2, 2)]);
  assert.equal((mesh.group.children[0] as THREE.Mesh).geometry, geometry, 'no new buffers');
  assert.equal(height(mesh, 0.1, 0.1), 0.1);
  assert.equal(mesh.triangles, 6);
  assert.equal(drawnTriangles(mesh), 6);
  assert.equal(mesh.blocks, 2);
});
test('one that grew finds another place; an older one does not count; empty ones go', () => {
  const mesh = new MeshLayer();
  for (let n = 1; n <= 60; ++n) put(mesh, [square(n % 3, 0, 0.1, n, n)], n === 1);
  assert.equal(mesh.triangles, 2 * (58 + 59 + 60));
  assert.equal(drawnTriangles(mesh), mesh.triangles);
  put(mesh, [square(0, 0, 0.9, 3)]);
  assert.equal(height(mesh, 0.1, 0.1), 0.02);
  put(mesh, [gone(0, 0, 100), gone(1, 0, 100)]);
  assert.equal(height(mesh, 0.1, 0.1), null);
  assert.equal(drawnTriangles(mesh), mesh.triangles);
  put(mesh, [gone(2, 0, 100)]);
  assert.equal(mesh.group.children.length, 0);
  assert.equal(mesh.blocks + mesh.triangles, 0);
});
test('a restart begins with nothing', () => {
  const mesh = new MeshLayer();
  put(mesh, [square(0, 0, 0.1, 5), square(20, 0, 0.1, 5)], true);
  assert.equal(mesh.group.children.length, 2);
  put(mesh, [square(1, 0, 0.1, 1)], true);
  assert.equal(mesh.blocks, 1);
  assert.equal(height(mesh, 0.1, 0.1), null);
});

test('the cost map: what is free is clear, what is not known and what blocks are woven', () => {
  const floor = new FloorLayer();
  floor.takeCost({ width: 3, height: 2, resolution: 0.05, origin: [0, 0, 0, 1, 0, 0, 0],
    cost: new Uint8Array([0, 130, 255, 254, 253, 255]) });
  const { material } = (floor.cost.children[0] as THREE.Group).children[0] as
    THREE.Mesh<THREE.PlaneGeometry, THREE.MeshBasicMaterial>;
  const { data } = (material.map as THREE.DataTexture).image;
  const pixels = Array.from({ length: 6 }, (_, i) => [...data!.slice(4 * i, 4 * i + 4)]);
  assert.deepEqual(pixels, [[0, 158, 115, 0], [230, 159, 0, 80], [120, 120, 130, 70],
    [213, 94, 0, 110], [230, 159, 0, 127], [120, 120, 130, 20]]);
});
