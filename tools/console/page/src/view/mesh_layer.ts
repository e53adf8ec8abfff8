// The reconstructed surface, kept by deltas. Blocks are drawn together in chunks: thousands of
// blocks one by one would cost more than their triangles.
import * as THREE from 'three';
import { Block, MeshDelta, Vec3 } from '../wire/types';
import { dispose } from './shapes';

const side = 8;             // blocks of a chunk, in each direction
const mostAFrame = 12;      // chunks built anew in one frame

interface Chunk {
  blocks: Map<string, Block>;
  mesh: THREE.Mesh | null;
}

export interface Hit {
  point: Vec3;
  normal: Vec3;
  distance: number;
}

export class MeshLayer {
  readonly group = new THREE.Group();
  sequence = 0;
  triangles = 0;
  onApplied: (sequence: number) => void = () => {};
  private readonly chunks = new Map<string, Chunk>();
  private readonly stale = new Set<string>();
  private readonly material = new THREE.MeshLambertMaterial({
    vertexColors: true, flatShading: true,
  });

  take(delta: MeshDelta): void {
    if (delta.restart) this.clear();
    for (const block of delta.blocks) this.put(block);
    this.sequence = delta.sequence;
  }

  // Builds what changed, some in each frame. True: there is something new to draw.
  update(): boolean {
    if (this.stale.size === 0) return false;
    let left = mostAFrame;
    for (const key of this.stale) {
      if (left-- === 0) break;
      this.stale.delete(key);
      this.build(key);
    }
    if (this.stale.size === 0) this.onApplied(this.sequence);
    return true;
  }

  hit(ray: THREE.Ray): Hit | null {
    const caster = new THREE.Raycaster(ray.origin, ray.direction);
    const first = caster.intersectObjects(this.group.children, false)[0];
    if (!first?.face) return null;
    const point = this.group.worldToLocal(first.point.clone());
    const n = first.face.normal;
    return { point: [point.x, point.y, point.z], normal: [n.x, n.y, n.z],
      distance: first.distance };
  }

  get blocks(): number {
    let count = 0;
    for (const chunk of this.chunks.values()) count += chunk.blocks.size;
    return count;
  }

  private clear(): void {
    for (const chunk of this.chunks.values()) this.drop(chunk);
    this.chunks.clear();
    this.stale.clear();
  }

  private put(block: Block): void {
    const place = [block.x, block.y, block.z];
    const key = place.map(k => Math.floor(k / side)).join();
    let chunk = this.chunks.get(key);
    if (!chunk) this.chunks.set(key, chunk = { blocks: new Map(), mesh: null });
    const name = place.join();
    // A replacement that came before a newer one was overtaken: versions only grow.
    const known = chunk.blocks.get(name);
    if (known && known.version > block.version) return;
    if (block.triangles.length === 0) chunk.blocks.delete(name);
    else chunk.blocks.set(name, block);
    this.stale.add(key);
  }

  private drop(chunk: Chunk): void {
    if (!chunk.mesh) return;
    this.triangles -= (chunk.mesh.geometry.index?.count ?? 0) / 3;
    chunk.mesh.geometry.dispose();
    this.group.remove(chunk.mesh);
    chunk.mesh = null;
  }

  private build(key: string): void {
    const chunk = this.chunks.get(key);
    if (!chunk) return;
    this.drop(chunk);
    if (chunk.blocks.size === 0) {
      this.chunks.delete(key);
      return;
    }
    const blocks = [...chunk.blocks.values()];
    const vertices = blocks.reduce((sum, b) => sum + b.positions.length, 0);
    const corners = blocks.reduce((sum, b) => sum + b.triangles.length, 0);
    const positions = new Float32Array(vertices);
    const colours = new Uint8Array(vertices);
    const indices = vertices / 3 > 65535 ? new Uint32Array(corners) : new Uint16Array(corners);
    let v = 0;
    let t = 0;
    for (const block of blocks) {
      positions.set(block.positions, v);
      colours.set(block.colours, v);
      for (const index of block.triangles) indices[t++] = index + v / 3;
      v += block.positions.length;
    }
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute('position', new THREE.BufferAttribute(positions, 3));
    geometry.setAttribute('color', new THREE.BufferAttribute(colours, 3, true));
    geometry.setIndex(new THREE.BufferAttribute(indices, 1));
    geometry.computeBoundingSphere();
    chunk.mesh = new THREE.Mesh(geometry, this.material);
    this.triangles += corners / 3;
    this.group.add(chunk.mesh);
  }

  dispose(): void {
    this.clear();
    dispose(this.group);
  }
}
