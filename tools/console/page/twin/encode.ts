// Views as bytes, written from docs/console_protocol.md and not from the page's reader.
import jpeg from 'jpeg-js';
import { Body, Caster, colourAt, faces } from './world';
import { Vec3 } from '../src/wire/types';

export function view(kind: number, sequence: number, time: number, data: number,
  body: Buffer): Buffer {
  const head = Buffer.alloc(24);
  head.writeUInt8(kind, 0);
  head.writeUInt8(1, 1);
  head.writeUInt32LE(sequence, 4);
  head.writeDoubleLE(time, 8);
  head.writeDoubleLE(data, 16);
  return Buffer.concat([head, body]);
}

export function floats(...values: number[]): Buffer {
  return Buffer.from(new Float32Array(values).buffer);
}

interface Cell {
  at: Vec3;
  vertices: { p: Vec3; colour: Vec3 }[];
  triangles: number[];
}

const edge = 0.32;   // m of a block
const tile = 0.08;   // m; half of it fits into the margin of a block

function place(face: ReturnType<typeof faces>[number], a: number, b: number): Vec3 {
  const p = face.origin.map((o, k) => o + a * face.u[k]! + b * face.v[k]!) as Vec3;
  if (!face.body) return p;
  const { body } = face;
  const [c, s] = [Math.cos(body.yaw), Math.sin(body.yaw)];
  return [body.centre[0] + c * p[0] - s * p[1], body.centre[1] + s * p[0] + c * p[1],
    body.centre[2] + p[2]];
}

export function cutBlocks(bodies: Body[]): Cell[] {
  const cells = new Map<string, Cell>();
  for (const face of faces(bodies)) {
    const m = Math.ceil(Math.hypot(...face.u) / tile);
    const n = Math.ceil(Math.hypot(...face.v) / tile);
    for (let i = 0; i < m; ++i) {
      for (let j = 0; j < n; ++j) {
        const at = place(face, (i + 0.5) / m, (j + 0.5) / n)
          .map(v => Math.floor(v / edge)) as Vec3;
        const cell = cells.get(at.join()) ?? { at, vertices: [], triangles: [] };
        cells.set(at.join(), cell);
        const first = cell.vertices.length;
        for (const [a, b] of [[i, j], [i + 1, j], [i + 1, j + 1], [i, j + 1]] as const) {
          const p = place(face, a / m, b / n);
          const middle = place(face, (i + 0.5) / m, (j + 0.5) / n);
          cell.vertices.push({ p, colour: colourAt(bodies, face.id, face.axis, middle) });
        }
        cell.triangles.push(first, first + 1, first + 2, first, first + 2, first + 3);
      }
    }
  }
  return [...cells.values()];
}

export function meshBody(cells: Cell[], sequence: number, restart: boolean): Buffer {
  const head = Buffer.alloc(12);
  head.writeUInt32LE(sequence, 0);
  head.writeUInt8(restart ? 1 : 0, 4);
  head.writeUInt32LE(cells.length, 8);
  const heads = cells.map(cell => {
    const b = Buffer.alloc(20);
    cell.at.forEach((v, k) => b.writeInt32LE(v, 4 * k));
    b.writeUInt32LE(sequence, 12);
    b.writeUInt16LE(cell.vertices.length, 16);
    b.writeUInt16LE(cell.triangles.length / 3, 18);
    return b;
  });
  const vertices = cells.flatMap(cell => cell.vertices.map(({ p, colour }) => {
    const b = Buffer.alloc(10);
    p.forEach((v, k) => {
      const corner = cell.at[k]! * edge - edge / 8;
      b.writeUInt16LE(Math.max(0, Math.min(65535,
        Math.round((v - corner) / (1.25 * edge) * 65535))), 2 * k);
    });
    colour.forEach((v, k) => b.writeUInt8(Math.max(0, Math.min(255, Math.round(v))), 6 + k));
    return b;
  }));
  const triangles = cells.map(cell => Buffer.from(new Uint16Array(cell.triangles).buffer));
  return Buffer.concat([head, ...heads, floats(edge), ...vertices, ...triangles]);
}

export interface Shot {
  body: Buffer;
  ids: Uint8Array;  // of the thing in each pixel
}

export const lens = { width: 96, height: 72, fx: 78, fy: 78, cx: 47.5, cy: 35.5 };

// Axes of the camera (x right, y down, z forward) in W.
export function cameraAxes(q: number[]): [Vec3, Vec3, Vec3] {
  const [w, x, y, z] = q as [number, number, number, number];
  return [
    [1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)],
    [2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)],
    [2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)],
  ];
}

export function shoot(bodies: Body[], eye: Vec3, q: number[]): Shot {
  const { width, height, fx, fy, cx, cy } = lens;
  const [right, down, forward] = cameraAxes(q);
  const depth = new Uint16Array(width * height);
  const ids = new Uint8Array(width * height);
  const rgba = Buffer.alloc(4 * width * height);
  const caster = new Caster(bodies, eye);
  const way: Vec3 = [0, 0, 0];
  const p: Vec3 = [0, 0, 0];
  for (let v = 0; v < height; ++v) {
    for (let u = 0; u < width; ++u) {
      const [a, b] = [(u - cx) / fx, (v - cy) / fy];
      for (let k = 0; k < 3; ++k) way[k] = a * right[k]! + b * down[k]! + forward[k]!;
      const hit = caster.cast(way);
      const i = v * width + u;
      const there = Number.isFinite(hit.t) && hit.t < 8;
      depth[i] = there ? Math.round(1000 * hit.t) : 0;
      ids[i] = there ? hit.id : 255;
      for (let k = 0; k < 3; ++k) p[k] = eye[k]! + hit.t * way[k]!;
      const colour = there ? colourAt(bodies, hit.id, hit.axis, p) : [30, 34, 40];
      for (let k = 0; k < 3; ++k) rgba[4 * i + k] = colour[k]!;
    }
  }
  const picture = jpeg.encode({ data: rgba, width, height }, 80).data;
  const head = Buffer.alloc(88);
  head.writeUInt16LE(width, 0);
  head.writeUInt16LE(height, 2);
  [fx, fy, cx, cy].forEach((f, k) => head.writeFloatLE(f, 4 + 4 * k));
  [...eye, ...q].forEach((f, k) => head.writeDoubleLE(f, 20 + 8 * k));
  head.writeUInt32LE(2 * depth.length, 76);
  head.writeUInt32LE(picture.length, 80);
  head.writeUInt8(1, 84);
  return { body: Buffer.concat([head, Buffer.from(depth.buffer), picture]), ids };
}

// A picture as a robot sends it that saves colour, or whose colour is damaged on the way.
export function recoloured(body: Buffer, colour: 'none' | 'broken'): Buffer {
  const copy = Buffer.from(body);
  const start = 88 + copy.readUInt32LE(76);
  if (colour === 'broken') return copy.fill(0x55, start);
  copy.writeUInt32LE(0, 80);
  copy.writeUInt8(0, 84);
  return copy.subarray(0, start);
}

export function bits(mask: boolean[]): Buffer {
  const packed = Buffer.alloc(Math.ceil(mask.length / 8));
  mask.forEach((on, i) => { if (on) packed[i >> 3]! |= 1 << (i & 7); });
  return packed;
}
