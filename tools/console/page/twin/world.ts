// The twin's world: a room with boxes, all analytic. It is the truth that tests hold the page
// against; rays, faces and colours come from it alone. Frame W, m; one box at a seeded place.
import { Vec3 } from '../src/wire/types';

export interface Body {
  id: number;
  name: string;
  centre: Vec3;
  half: Vec3;
  yaw: number;
  colour: Vec3;
}

export const room = { x: [-1, 4] as const, y: [-2, 2] as const, height: 1.6 };
export const floorId = 0;
export const wallId = 1;

// Small and repeatable; not for anything that must be random.
export function randomFrom(seed: number): () => number {
  let state = seed >>> 0;
  return () => {
    state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
    return state / 2 ** 32;
  };
}

export function makeBodies(seed: number): Body[] {
  const random = randomFrom(seed);
  for (let i = 0; i < 8; ++i) random();
  return [
    { id: 2, name: 'pedestal', centre: [1.4 + 0.4 * random(), -0.9 - 0.3 * random(), 0.25],
      half: [0.18, 0.18, 0.25], yaw: 0.6 * random(), colour: [70, 110, 190] },
    { id: 3, name: 'bin', centre: [2.5, 0.55, 0.27], half: [0.16, 0.16, 0.27], yaw: 0.3,
      colour: [150, 120, 60] },
    { id: 4, name: 'table', centre: [3.3, -1.2, 0.36], half: [0.4, 0.55, 0.36], yaw: 0,
      colour: [140, 95, 60] },
    { id: 5, name: 'crate', centre: [1.2, 1.3, 0.15], half: [0.2, 0.25, 0.15], yaw: -0.4,
      colour: [90, 150, 80] },
  ];
}

export function toBody(b: Body, p: Vec3): Vec3 {
  const d: Vec3 = [p[0] - b.centre[0], p[1] - b.centre[1], p[2] - b.centre[2]];
  const [c, s] = [Math.cos(b.yaw), Math.sin(b.yaw)];
  return [c * d[0] + s * d[1], c * d[1] - s * d[0], d[2]];
}

export function fromBody(b: Body, p: Vec3): Vec3 {
  const [c, s] = [Math.cos(b.yaw), Math.sin(b.yaw)];
  return [b.centre[0] + c * p[0] - s * p[1], b.centre[1] + s * p[0] + c * p[1],
    b.centre[2] + p[2]];
}

export interface RayHit { t: number; id: number; axis: number }

// Where a ray enters and leaves a box; the result lies in `slab`: a picture casts many rays.
const slab = { near: 0, far: 0, axisIn: 0, axisOut: 0 };

function meet(origin: Vec3, way: Vec3, low: Vec3, high: Vec3): void {
  slab.near = -Infinity;
  slab.far = Infinity;
  for (let k = 0; k < 3; ++k) {
    const a = (low[k]! - origin[k]!) / way[k]!;
    const b = (high[k]! - origin[k]!) / way[k]!;
    if (Math.min(a, b) > slab.near) {
      slab.near = Math.min(a, b);
      slab.axisIn = k;
    }
    if (Math.max(a, b) < slab.far) {
      slab.far = Math.max(a, b);
      slab.axisOut = k;
    }
  }
}

// Casts rays from one eye; the result is good until the next one.
export class Caster {
  private readonly low: Vec3 = [room.x[0], room.y[0], 0];
  private readonly high: Vec3 = [room.x[1], room.y[1], 100];
  private readonly eyes: Vec3[];
  private readonly lows: Vec3[];
  private readonly turns: [number, number][];
  private readonly way: Vec3 = [0, 0, 0];
  private readonly best: RayHit = { t: 0, id: 0, axis: 0 };

  constructor(private readonly bodies: Body[], private readonly origin: Vec3) {
    this.eyes = bodies.map(b => toBody(b, origin));
    this.lows = bodies.map(b => b.half.map(v => -v) as Vec3);
    this.turns = bodies.map(b => [Math.cos(b.yaw), Math.sin(b.yaw)]);
  }

  // The nearest thing on a ray that starts inside the room.
  cast(way: Vec3): RayHit {
    const { best } = this;
    meet(this.origin, way, this.low, this.high);
    best.t = slab.far;
    best.axis = slab.axisOut;
    best.id = slab.axisOut === 2 ? floorId : wallId;
    if (best.id === wallId && this.origin[2] + best.t * way[2] > room.height) best.t = Infinity;
    for (let i = 0; i < this.bodies.length; ++i) {
      const [c, s] = this.turns[i]!;
      this.way[0] = c * way[0] + s * way[1];
      this.way[1] = c * way[1] - s * way[0];
      this.way[2] = way[2];
      meet(this.eyes[i]!, this.way, this.lows[i]!, this.bodies[i]!.half);
      if (slab.near > 0 && slab.near < slab.far && slab.near < best.t) {
        best.t = slab.near;
        best.axis = slab.axisIn;
        best.id = this.bodies[i]!.id;
      }
    }
    return best;
  }
}

// Distance of a point from the nearest surface.
export function distanceToSurface(bodies: Body[], p: Vec3): number {
  const walls = [p[0] - room.x[0], room.x[1] - p[0], p[1] - room.y[0], room.y[1] - p[1], p[2]];
  let best = Math.min(...walls.map(Math.abs));
  for (const b of bodies) {
    const q = toBody(b, p).map((v, k) => Math.abs(v) - b.half[k]!);
    const outside = Math.hypot(...q.map(v => Math.max(v, 0)));
    best = Math.min(best, Math.abs(outside + Math.min(Math.max(...q), 0)));
  }
  return best;
}

export function colourAt(bodies: Body[], id: number, axis: number, p: Vec3): Vec3 {
  const checker = (size: number) => (Math.floor(p[0] / size) + Math.floor(p[1] / size)) % 2 === 0;
  if (id === floorId) return checker(0.25) ? [158, 142, 120] : [140, 126, 106];
  const shade = [0.86, 0.94, 1][axis]!;
  if (id === wallId) return [200 * shade, 205 * shade, 195 * shade];
  const body = bodies.find(b => b.id === id)!;
  const grain = Math.floor(p[2] / 0.06) % 2 === 0 ? 1 : 0.93;
  return body.colour.map(v => v * shade * grain) as Vec3;
}

export interface Face { origin: Vec3; u: Vec3; v: Vec3; id: number; axis: number; body?: Body }

// Rectangles: origin and two edges, u x v outwards, into free space. Of a body, in its own frame.
export function faces(bodies: Body[]): Face[] {
  const [w, d, h] = [room.x[1] - room.x[0], room.y[1] - room.y[0], room.height];
  const list: Face[] = [
    { origin: [room.x[0], room.y[0], 0], u: [w, 0, 0], v: [0, d, 0], id: floorId, axis: 2 },
    { origin: [room.x[0], room.y[0], 0], u: [0, d, 0], v: [0, 0, h], id: wallId, axis: 0 },
    { origin: [room.x[1], room.y[1], 0], u: [0, -d, 0], v: [0, 0, h], id: wallId, axis: 0 },
    { origin: [room.x[1], room.y[0], 0], u: [-w, 0, 0], v: [0, 0, h], id: wallId, axis: 1 },
    { origin: [room.x[0], room.y[1], 0], u: [w, 0, 0], v: [0, 0, h], id: wallId, axis: 1 },
  ];
  for (const body of bodies) {
    const [x, y, z] = body.half;
    const face = (origin: Vec3, u: Vec3, v: Vec3, axis: number) =>
      list.push({ origin, u, v, id: body.id, axis, body });
    face([-x, -y, z], [2 * x, 0, 0], [0, 2 * y, 0], 2);
    face([x, -y, -z], [0, 2 * y, 0], [0, 0, 2 * z], 0);
    face([-x, y, -z], [0, -2 * y, 0], [0, 0, 2 * z], 0);
    face([-x, -y, -z], [2 * x, 0, 0], [0, 0, 2 * z], 1);
    face([x, y, -z], [-2 * x, 0, 0], [0, 0, 2 * z], 1);
  }
  return list;
}
