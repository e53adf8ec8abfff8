// Views from bytes. Throws RangeError where a message is shorter than it says: it is then left out.
import {
  Block, CostMap, Head, MeshDelta, Picture, Pose, Selection, Vec3,
} from './types';

export const headBytes = 24;
const version = 1;
const spread = 1.25;     // block edges that 65535 steps of a vertex cover
const margin = 0.125;    // block edges by which vertices may lie below their block
const vertexBytes = 10;  // three steps, a colour, padding

class Reader {
  private at = headBytes;
  private readonly view: DataView;

  constructor(private readonly bytes: ArrayBuffer) {
    this.view = new DataView(bytes);
  }

  u8(): number { return this.view.getUint8(this.step(1)); }
  u16(): number { return this.view.getUint16(this.step(2), true); }
  u32(): number { return this.view.getUint32(this.step(4), true); }
  i32(): number { return this.view.getInt32(this.step(4), true); }
  f32(): number { return this.view.getFloat32(this.step(4), true); }
  f64(): number { return this.view.getFloat64(this.step(8), true); }
  skip(count: number): void { this.step(count); }
  many(count: number, one: () => number): number[] { return Array.from({ length: count }, one); }
  vec3(): Vec3 { return [this.f32(), this.f32(), this.f32()]; }

  // A copy, so that a large message is not kept alive by a small part of it.
  take(count: number): Uint8Array<ArrayBuffer> { return this.part(count).slice(); }

  // In place: of what is used up at once, or is most of its message.
  part(count: number): Uint8Array<ArrayBuffer> {
    return new Uint8Array(this.bytes, this.step(count), count);
  }

  private step(count: number): number {
    const start = this.at;
    this.at += count;
    return start;
  }
}

export function readHead(bytes: ArrayBuffer): Head {
  const view = new DataView(bytes);
  if (view.getUint8(1) !== version) throw new RangeError('another version of the protocol');
  return {
    kind: view.getUint8(0),
    flags: view.getUint16(2, true),
    sequence: view.getUint32(4, true),
    time: view.getFloat64(8, true),
    data: view.getFloat64(16, true),
    made: -Infinity,
  };
}

export function readJson<T>(bytes: ArrayBuffer): T {
  return JSON.parse(new TextDecoder().decode(new Uint8Array(bytes, headBytes))) as T;
}

export function readPose(bytes: ArrayBuffer): Pose {
  const r = new Reader(bytes);
  const [hand, proxy, force, normal] = [r.vec3(), r.vec3(), r.vec3(), r.vec3()];
  const flags = r.u32();
  const bit = (n: number) => (flags & (1 << n)) !== 0;
  return {
    hand, proxy, force, normal,
    handValid: bit(0), contact: bit(1), button: bit(2), clutch: bit(3), robotValid: bit(4),
    cameraClaimed: bit(5), cameraValid: bit(6), goalEngaged: bit(7), rendersForce: bit(8),
    reach: r.f32(),
    robot: r.vec3(), velocity: r.vec3(), predicted: r.vec3(),
    wheels: r.many(4, () => r.f32()),
    error: r.f32(),
    camera: r.many(7, () => r.f32()),
    goal: r.vec3(),
    mode: r.u8(), robotMode: r.u8(), phase: r.u8(), tracking: r.u8(),
    pathSequence: r.u32(),
  };
}

interface BlockHead { x: number; y: number; z: number; version: number; nv: number; nt: number }

// In little endian, as all machines with a browser have it.
function readVertices(r: Reader, b: BlockHead, edge: number): [Float32Array, Uint8Array] {
  const positions = new Float32Array(3 * b.nv);
  const colours = new Uint8Array(3 * b.nv);
  const scale = spread * edge / 65535;
  const bytes = r.part(vertexBytes * b.nv);
  const steps = new Uint16Array(bytes.buffer, bytes.byteOffset, vertexBytes / 2 * b.nv);
  const [x, y, z] = [(b.x - margin) * edge, (b.y - margin) * edge, (b.z - margin) * edge];
  for (let v = 0; v < b.nv; ++v) {
    const from = vertexBytes / 2 * v;
    positions[3 * v] = x + scale * steps[from]!;
    positions[3 * v + 1] = y + scale * steps[from + 1]!;
    positions[3 * v + 2] = z + scale * steps[from + 2]!;
    for (let k = 0; k < 3; ++k) colours[3 * v + k] = bytes[vertexBytes * v + 6 + k]!;
  }
  return [positions, colours];
}

export function readMesh(bytes: ArrayBuffer): MeshDelta {
  const r = new Reader(bytes);
  const sequence = r.u32();
  const restart = r.u8() !== 0;
  r.skip(3);
  const count = r.u32();
  if (count * 20 > bytes.byteLength) throw new RangeError('more blocks than bytes');
  const heads: BlockHead[] = [];
  for (let i = 0; i < count; ++i) {
    heads.push({ x: r.i32(), y: r.i32(), z: r.i32(), version: r.u32(), nv: r.u16(), nt: r.u16() });
  }
  const edge = r.f32();
  const blocks: Block[] = heads.map(b => {
    const [positions, colours] = readVertices(r, b, edge);
    return { x: b.x, y: b.y, z: b.z, version: b.version, positions, colours,
      triangles: new Uint16Array(0) };
  });
  blocks.forEach((block, i) => {
    const { nv, nt } = heads[i]!;
    block.triangles = new Uint16Array(r.take(6 * nt).buffer);
    if (block.triangles.some(k => k >= nv)) throw new RangeError('a triangle without its vertex');
  });
  return { sequence, restart, edge, blocks };
}

export function readPicture(bytes: ArrayBuffer): Picture {
  const r = new Reader(bytes);
  const [width, height] = [r.u16(), r.u16()];
  const [fx, fy, cx, cy] = [r.f32(), r.f32(), r.f32(), r.f32()];
  const camera = r.many(7, () => r.f64());
  const [depthBytes, colourBytes, colourKind] = [r.u32(), r.u32(), r.u8()];
  r.skip(3);
  if (depthBytes !== 0 && depthBytes !== 2 * width * height) throw new RangeError('depth size');
  const depth = r.part(depthBytes);
  const colour = r.part(colourBytes);
  return {
    width, height, fx, fy, cx, cy, camera,
    depth: new Uint16Array(depth.buffer, depth.byteOffset, depthBytes / 2),
    jpeg: colourKind === 1 ? colour : null,
  };
}

export function readCostMap(bytes: ArrayBuffer): CostMap {
  const r = new Reader(bytes);
  const [width, height, resolution] = [r.u16(), r.u16(), r.f32()];
  const origin = r.many(7, () => r.f64());
  return { width, height, resolution, origin, cost: r.take(width * height) };
}

export function readMoving(bytes: ArrayBuffer): [number, number][] {
  const r = new Reader(bytes);
  const count = r.u16();
  return Array.from({ length: count }, () => [r.f32(), r.f32()]);
}

// Bits are row-major, the first pixel in the lowest bit of the first byte.
export function readSelection(bytes: ArrayBuffer): Selection {
  const r = new Reader(bytes);
  const [width, height, proposal] = [r.u16(), r.u16(), r.u32()];
  const bits = r.take(Math.ceil(width * height / 8));
  const mask = new Uint8Array(width * height);
  for (let i = 0; i < mask.length; ++i) mask[i] = (bits[i >> 3]! >> (i & 7)) & 1;
  return { width, height, proposal, mask };
}
