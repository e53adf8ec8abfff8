// On the floor: the cost map, what moves, the path, the marked place.
import * as THREE from 'three';
import { CostMap, Slow, Vec3 } from '../wire/types';
import { clear, flat, palette, quaternion, tube } from './shapes';

const blocked = 254;   // and more: no way
const unknown = 255;
const postHeight = 0.3;  // m
const mostPosts = 2048;  // as many as a cost map says that move

// Free is clear, dear is orange, blocked is red with a weave, unknown a grey weave: no two are told
// apart by hue alone. `on`: of the weave's two.
function shade(cost: number, on: boolean): number[] {
  return cost === unknown ? [120, 120, 130, on ? 70 : 20]
    : cost >= blocked ? [213, 94, 0, on ? 190 : 110]
    : cost > 0 ? [230, 159, 0, 30 + Math.round(cost / 2.6)] : [0, 158, 115, 0];
}

// Little-endian pixels of each cost, of both kinds of cells of the weave.
const shades = [false, true].map(on => new Uint32Array(Uint8Array.from(
  Array.from({ length: 256 }, (_, cost) => shade(cost, on)).flat()).buffer));

export class FloorLayer {
  readonly group = new THREE.Group();
  readonly cost = new THREE.Group();
  private readonly posts: THREE.InstancedMesh;
  private readonly path = new THREE.Group();
  private readonly frame = new THREE.Group();
  private readonly plane: THREE.Mesh<THREE.PlaneGeometry, THREE.MeshBasicMaterial>;
  private texture: THREE.DataTexture | null = null;
  private drawnPath = '';

  // Made once: materials that are made anew have their shaders compiled anew.
  constructor() {
    this.plane = new THREE.Mesh(new THREE.PlaneGeometry(1, 1), new THREE.MeshBasicMaterial({
      transparent: true, depthWrite: false, polygonOffset: true,
      polygonOffsetFactor: -4, polygonOffsetUnits: -4,
    }));
    this.frame.add(this.plane);
    this.frame.visible = false;
    this.cost.add(this.frame);
    const post = new THREE.CylinderGeometry(0.6, 0.6, 1, 6);
    post.rotateX(Math.PI / 2);
    this.posts = new THREE.InstancedMesh(post, new THREE.MeshBasicMaterial({
      color: palette.purple, transparent: true, opacity: 0.5, depthWrite: false }), mostPosts);
    this.posts.count = 0;
    this.posts.frustumCulled = false;  // they move
    this.group.add(this.cost, this.posts, this.path);
  }

  takeCost(map: CostMap): void {
    const { width, height, cost } = map;
    const pixels = new Uint32Array(width * height);
    for (let y = 0, i = 0; y < height; ++y) {
      for (let x = 0; x < width; ++x, ++i) pixels[i] = shades[(x + y + 1) % 2]![cost[i]!]!;
    }
    this.show(new Uint8Array(pixels.buffer), map);
    const [w, h] = [map.width * map.resolution, map.height * map.resolution];
    this.plane.scale.set(w, h, 1);
    this.plane.position.set(w / 2, h / 2, 0.012);
    this.frame.position.set(map.origin[0]!, map.origin[1]!, map.origin[2]!);
    this.frame.quaternion.copy(quaternion(map.origin.slice(3)));
    this.frame.visible = true;
  }

  private show(pixels: Uint8Array, map: CostMap): void {
    if (this.texture?.image.width !== map.width || this.texture.image.height !== map.height) {
      this.texture?.dispose();
      this.texture = new THREE.DataTexture(pixels, map.width, map.height);
      this.plane.material.map = this.texture;
      this.plane.material.needsUpdate = true;
    }
    this.texture.image.data = pixels;
    this.texture.needsUpdate = true;
  }

  takeMoving(cells: [number, number][], size: number): void {
    const shown = cells.slice(0, mostPosts);
    const place = new THREE.Matrix4();
    shown.forEach(([x, y], i) => this.posts.setMatrixAt(i,
      place.makeScale(size, size, postHeight).setPosition(x, y, postHeight / 2)));
    this.posts.count = shown.length;
    this.posts.instanceMatrix.needsUpdate = true;
  }

  takeSlow(slow: Slow): void {
    const key = JSON.stringify([slow.path, slow.marked]);
    if (key === this.drawnPath) return;
    this.drawnPath = key;
    clear(this.path);
    const points = (slow.path ?? []).map(([x, y]): Vec3 => [x, y, 0.03]);
    if (points.length > 1) this.path.add(tube(points, 0.012, palette.sky));
    if (slow.marked) {
      const ring = new THREE.Mesh(new THREE.TorusGeometry(0.1, 0.015, 8, 32),
        flat(palette.green));
      ring.position.set(...slow.marked);
      this.path.add(ring);
    }
  }
}
