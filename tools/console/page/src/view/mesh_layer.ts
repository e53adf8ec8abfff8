// The reconstructed surface, kept by deltas. Blocks are drawn together in chunks: thousands of
// blocks one by one would cost more than their triangles. A delta is in the scene when take()
// returns: the surface is up to date for whoever points at it, drawn or not.
import * as THREE from 'three';
import { Block, MeshDelta, Vec3 } from '../wire/types';
import { Chunk } from './chunk';
import { dispose } from './shapes';

const side = 8;        // blocks of a chunk, in each direction
const margin = 0.125;  // block edges by which vertices may lie beyond their block

export interface Hit {
  point: Vec3;
  normal: Vec3;
  distance: number;
}

const names = (place: number[]) => place.join();

export class MeshLayer {
  readonly group = new THREE.Group();
  onApplied: (sequence: number) => void = () => {};
  private edge = 0;
  private readonly chunks = new Map<string, Chunk>();
  private readonly material = new THREE.MeshLambertMaterial({
    vertexColors: true, flatShading: true,
  });

  take(delta: MeshDelta): void {
    if (delta.restart) this.clear();
    this.edge = delta.edge;
    for (const block of delta.blocks) this.put(block);
    this.onApplied(delta.sequence);
  }

  // The nearest triangle that faces the ray. Only blocks whose box it meets are looked into.
  hit(ray: THREE.Ray): Hit | null {
    const local = ray.clone().applyMatrix4(this.group.matrixWorld.clone().invert());
    const nearest = { distance: Infinity, point: new THREE.Vector3(),
      normal: new THREE.Vector3() };
    for (const chunk of this.chunks.values()) {
      if (!local.intersectsSphere(chunk.sphere)) continue;
      for (const block of chunk.blocks()) {
        if (local.intersectsBox(this.boxOf(block))) hitBlock(local, block, nearest);
      }
    }
    if (nearest.distance === Infinity) return null;
    const { point: p, normal: n, distance } = nearest;
    return { point: [p.x, p.y, p.z], normal: [n.x, n.y, n.z], distance };
  }

  get blocks(): number {
    let count = 0;
    for (const chunk of this.chunks.values()) count += chunk.size;
    return count;
  }

  get triangles(): number {
    let count = 0;
    for (const chunk of this.chunks.values()) count += chunk.triangles;
    return count;
  }

  private clear(): void {
    for (const key of [...this.chunks.keys()]) this.drop(key);
  }

  private put(block: Block): void {
    const at = [block.x, block.y, block.z];
    const place = at.map(k => Math.floor(k / side));
    const key = names(place);
    let chunk = this.chunks.get(key);
    if (!chunk) {
      if (block.triangles.length === 0) return;
      this.chunks.set(key, chunk = new Chunk(this.material, this.boundsOf(place)));
      this.group.add(chunk.mesh);
    }
    chunk.put(names(at), block);
    if (chunk.size === 0) this.drop(key);
  }

  private drop(key: string): void {
    const chunk = this.chunks.get(key)!;
    this.group.remove(chunk.mesh);
    chunk.dispose();
    this.chunks.delete(key);
  }

  private boundsOf(place: number[]): THREE.Sphere {
    const middle = place.map(k => (k + 0.5) * side * this.edge) as Vec3;
    return new THREE.Sphere(new THREE.Vector3(...middle),
      Math.sqrt(3) * (side / 2 + margin) * this.edge);
  }

  private boxOf(block: Block): THREE.Box3 {
    const { edge } = this;
    box.min.set(block.x - margin, block.y - margin, block.z - margin).multiplyScalar(edge);
    box.max.set(block.x + 1 + margin, block.y + 1 + margin, block.z + 1 + margin)
      .multiplyScalar(edge);
    return box;
  }

  dispose(): void {
    this.clear();
    dispose(this.group);
  }
}

const box = new THREE.Box3();
const [a, b, c, at] = [new THREE.Vector3(), new THREE.Vector3(), new THREE.Vector3(),
  new THREE.Vector3()];

function hitBlock(ray: THREE.Ray, block: Block,
  nearest: { distance: number; point: THREE.Vector3; normal: THREE.Vector3 }): void {
  const { positions, triangles } = block;
  for (let i = 0; i < triangles.length; i += 3) {
    a.fromArray(positions, 3 * triangles[i]!);
    b.fromArray(positions, 3 * triangles[i + 1]!);
    c.fromArray(positions, 3 * triangles[i + 2]!);
    if (!ray.intersectTriangle(a, b, c, true, at)) continue;
    const distance = at.distanceTo(ray.origin);
    if (distance >= nearest.distance) continue;
    nearest.distance = distance;
    nearest.point.copy(at);
    nearest.normal.copy(b.sub(a).cross(c.sub(a)).normalize());
  }
}
