// Blocks of the surface that are drawn together. Each has a place in the chunk's buffers, with some
// room to grow: a block that changes is written there, and only that goes to the graphics. When
// nothing is left the chunk is packed anew.
import * as THREE from 'three';
import { Block } from '../wire/types';

const roomier = 1.25;    // of a block's place
const spare = 8;         // and so many more
const growth = 1.5;      // of a chunk's buffers, when it is packed
const mostRanges = 32;   // to be sent; more are sent as one

interface Slot {
  block: Block;
  vertex: number;        // the first
  vertexRoom: number;
  corner: number;        // the first
  cornerRoom: number;
}

const room = (count: number) => Math.ceil(roomier * count) + spare;

// A part of what is drawn has changed.
function changed(attribute: THREE.BufferAttribute, start: number, count: number): void {
  attribute.addUpdateRange(start, count);
  if (attribute.updateRanges.length > mostRanges) {
    const from = Math.min(...attribute.updateRanges.map(r => r.start));
    const to = Math.max(...attribute.updateRanges.map(r => r.start + r.count));
    attribute.clearUpdateRanges();
    attribute.addUpdateRange(from, to - from);
  }
  attribute.needsUpdate = true;
}

export class Chunk {
  readonly mesh: THREE.Mesh;
  triangles = 0;
  private readonly slots = new Map<string, Slot>();
  private positions!: THREE.BufferAttribute;
  private colours!: THREE.BufferAttribute;
  private indices!: THREE.BufferAttribute;
  private vertexEnd = 0;
  private cornerEnd = 0;

  constructor(material: THREE.Material, private readonly bounds: THREE.Sphere) {
    this.mesh = new THREE.Mesh(new THREE.BufferGeometry(), material);
    this.pack(0, 0);
  }

  get size(): number { return this.slots.size; }
  get sphere(): THREE.Sphere { return this.bounds; }
  *blocks(): Iterable<Block> { for (const slot of this.slots.values()) yield slot.block; }

  // What comes late is older than what is there: versions only grow.
  put(name: string, block: Block): void {
    const known = this.slots.get(name);
    if (known && known.block.version > block.version) return;
    const vertices = block.positions.length / 3;
    const corners = block.triangles.length;
    this.triangles += (corners - (known?.block.triangles.length ?? 0)) / 3;
    if (known && corners > 0 && vertices <= known.vertexRoom && corners <= known.cornerRoom) {
      known.block = block;
      this.write(known);
      return;
    }
    if (known) {
      this.blank(known, 0);
      this.slots.delete(name);
    }
    if (corners === 0) return;
    const slot = { block, vertex: 0, vertexRoom: room(vertices), corner: 0,
      cornerRoom: 3 * room(corners / 3) };
    if (!this.fits(slot)) this.pack(slot.vertexRoom, slot.cornerRoom);
    this.place(slot);
    this.slots.set(name, slot);
    this.write(slot);
  }

  dispose(): void { this.mesh.geometry.dispose(); }

  private fits(slot: Slot): boolean {
    return this.vertexEnd + slot.vertexRoom <= this.positions.count
      && this.cornerEnd + slot.cornerRoom <= this.indices.count;
  }

  private place(slot: Slot): void {
    slot.vertex = this.vertexEnd;
    slot.corner = this.cornerEnd;
    this.vertexEnd += slot.vertexRoom;
    this.cornerEnd += slot.cornerRoom;
    this.mesh.geometry.setDrawRange(0, this.cornerEnd);
  }

  private write(slot: Slot): void {
    const { block, vertex, corner } = slot;
    this.positions.array.set(block.positions, 3 * vertex);
    changed(this.positions, 3 * vertex, block.positions.length);
    this.colours.array.set(block.colours, 3 * vertex);
    changed(this.colours, 3 * vertex, block.colours.length);
    const indices = this.indices.array;
    for (let i = 0; i < block.triangles.length; ++i) {
      indices[corner + i] = vertex + block.triangles[i]!;
    }
    this.blank(slot, block.triangles.length);
  }

  // From `from` on its triangles are points, which nobody sees.
  private blank(slot: Slot, from: number): void {
    this.indices.array.fill(slot.vertex, slot.corner + from, slot.corner + slot.cornerRoom);
    changed(this.indices, slot.corner, slot.cornerRoom);
  }

  // Anew and closer, with room for what is there, for so much more, and for some growth.
  private pack(moreVertices: number, moreCorners: number): void {
    let vertices = moreVertices;
    let corners = moreCorners;
    for (const slot of this.slots.values()) {
      slot.vertexRoom = room(slot.block.positions.length / 3);
      slot.cornerRoom = 3 * room(slot.block.triangles.length / 3);
      vertices += slot.vertexRoom;
      corners += slot.cornerRoom;
    }
    vertices = Math.ceil(growth * vertices);
    corners = 3 * Math.ceil(growth * corners / 3);
    this.mesh.geometry.dispose();
    const geometry = this.mesh.geometry = new THREE.BufferGeometry();
    this.positions = new THREE.BufferAttribute(new Float32Array(3 * vertices), 3);
    this.colours = new THREE.BufferAttribute(new Uint8Array(3 * vertices), 3, true);
    this.indices = new THREE.BufferAttribute(
      vertices > 65535 ? new Uint32Array(corners) : new Uint16Array(corners), 1);
    geometry.setAttribute('position', this.positions);
    geometry.setAttribute('color', this.colours);
    geometry.setIndex(this.indices);
    geometry.boundingSphere = this.bounds;
    geometry.setDrawRange(0, 0);
    this.vertexEnd = this.cornerEnd = 0;
    for (const slot of this.slots.values()) {
      this.place(slot);
      this.write(slot);
    }
  }
}
