// On the floor: the cost map, what moves, the path, the marked place.
import * as THREE from 'three';
import { CostMap, Slow, Vec3 } from '../wire/types';
import { clear, glass, palette, quaternion, tube } from './shapes';

const blocked = 254;   // and more: no way
const unknown = 255;

export class FloorLayer {
  readonly group = new THREE.Group();
  readonly cost = new THREE.Group();
  private readonly moving = new THREE.Group();
  private readonly path = new THREE.Group();
  private texture: THREE.DataTexture | null = null;
  private drawnPath = '';

  constructor() {
    this.group.add(this.cost, this.moving, this.path);
  }

  // Free is clear, dear is orange, blocked is red with a weave, unknown a grey weave: no two are
  // told apart by hue alone.
  takeCost(map: CostMap): void {
    const pixels = new Uint8Array(4 * map.width * map.height);
    for (let i = 0; i < map.cost.length; ++i) {
      const cost = map.cost[i]!;
      const weave = ((i % map.width) + Math.floor(i / map.width)) % 2 === 0;
      const shown = cost === unknown ? [120, 120, 130, weave ? 70 : 20]
        : cost >= blocked ? [213, 94, 0, weave ? 190 : 110]
        : cost > 0 ? [230, 159, 0, 30 + Math.round(cost / 2.6)] : [0, 158, 115, 0];
      pixels.set(shown, 4 * i);
    }
    this.texture?.dispose();
    this.texture = new THREE.DataTexture(pixels, map.width, map.height);
    this.texture.needsUpdate = true;
    clear(this.cost);
    const [w, h] = [map.width * map.resolution, map.height * map.resolution];
    const plane = new THREE.Mesh(new THREE.PlaneGeometry(w, h), new THREE.MeshBasicMaterial({
      map: this.texture, transparent: true, depthWrite: false, polygonOffset: true,
      polygonOffsetFactor: -4, polygonOffsetUnits: -4,
    }));
    plane.position.set(w / 2, h / 2, 0.012);
    const frame = new THREE.Group();
    frame.add(plane);
    frame.position.set(map.origin[0]!, map.origin[1]!, map.origin[2]!);
    frame.quaternion.copy(quaternion(map.origin.slice(3)));
    this.cost.add(frame);
  }

  takeMoving(cells: [number, number][], size: number): void {
    clear(this.moving);
    if (cells.length === 0) return;
    const geometry = new THREE.CylinderGeometry(0.6 * size, 0.6 * size, 0.3, 6);
    geometry.rotateX(Math.PI / 2);
    const posts = new THREE.InstancedMesh(geometry, glass(palette.purple, 0.5), cells.length);
    const place = new THREE.Matrix4();
    cells.forEach(([x, y], i) => posts.setMatrixAt(i, place.makeTranslation(x, y, 0.15)));
    this.moving.add(posts);
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
        new THREE.MeshBasicMaterial({ color: palette.green }));
      ring.position.set(...slow.marked);
      this.path.add(ring);
    }
  }
}
