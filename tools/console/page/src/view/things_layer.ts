// Marks, virtual obstacles, objects; what is chosen stands out; and the shapes being drawn.
import * as THREE from 'three';
import { Obstacle, SceneObject, Slow, Vec3 } from '../wire/types';
import { clear, glass, label, outline, palette, quaternion, tube } from './shapes';

export type Choice = { kind: 'mark' | 'obstacle' | 'object'; id: number } | null;

const discHeight = 0.3;
const markRadius = 0.012;
const catchRadius = 0.05;  // of a mark, for the pointer

function obstacleShape(o: Obstacle, chosen: boolean): THREE.Group {
  const height = o.kind === 'disc' ? discHeight : 2 * o.half[2];
  let geometry: THREE.BufferGeometry;
  if (o.kind === 'disc') {
    geometry = new THREE.CylinderGeometry(o.half[0], o.half[0], height, 40);
    geometry.rotateX(Math.PI / 2);
  } else {
    geometry = new THREE.BoxGeometry(2 * o.half[0], 2 * o.half[1], height);
  }
  const group = new THREE.Group();
  const solid = new THREE.Mesh(geometry, glass(palette.vermillion, chosen ? 0.5 : 0.3));
  solid.userData.choice = { kind: 'obstacle', id: o.id };
  group.add(solid, outline(geometry, chosen ? 0xffffff : palette.vermillion));
  const name = label(`keep-out ${o.id}`);
  name.position.z = height / 2 + 0.1;
  group.add(name);
  group.position.set(o.centre[0], o.centre[1],
    o.kind === 'disc' ? o.centre[2] + height / 2 : o.centre[2]);
  group.rotation.z = o.yaw;
  return group;
}

function objectShape(o: SceneObject, chosen: boolean): THREE.Group {
  const group = new THREE.Group();
  const geometry = new THREE.BoxGeometry(...o.extent);
  const solid = new THREE.Mesh(geometry, glass(palette.yellow, chosen ? 0.35 : 0.12));
  solid.userData.choice = { kind: 'object', id: o.id };
  group.add(solid, outline(geometry, chosen ? 0xffffff : palette.yellow));
  group.quaternion.copy(quaternion(o.quat));
  group.position.set(...o.centre);
  const holder = new THREE.Group();
  const size = o.extent.map(e => (100 * e).toFixed(0)).join(' x ');
  const text = label(`${objectName(o)}  ${size} cm`, o.seen === false ? '#bbbbbb' : '#ffffff');
  text.position.set(o.centre[0], o.centre[1], o.centre[2] + Math.max(...o.extent) / 2 + 0.08);
  holder.add(group, text);
  return holder;
}

export function objectName(o: SceneObject): string {
  return o.name ? `${o.name} (${o.serial ?? o.id})` : `object ${o.serial ?? o.id}`;
}

export class ThingsLayer {
  readonly group = new THREE.Group();
  readonly draft = new THREE.Group();   // what is being drawn, not yet said to the box
  private readonly stored = new THREE.Group();
  private drawn = '';
  private choice: Choice = null;
  private slow: Slow = {};

  constructor() {
    this.group.add(this.stored, this.draft);
  }

  take(slow: Slow): void {
    this.slow = slow;
    const key = JSON.stringify([slow.marks, slow.obstacles, slow.objects, this.choice]);
    if (key === this.drawn) return;
    this.drawn = key;
    clear(this.stored);
    for (const mark of slow.marks ?? []) {
      const chosen = this.isChosen('mark', mark.id);
      this.stored.add(tube(mark.points, markRadius, chosen ? 0xffffff : palette.purple));
      const catches = tube(mark.points, catchRadius, 0);
      catches.visible = false;
      catches.userData.choice = { kind: 'mark', id: mark.id };
      this.stored.add(catches);
    }
    for (const o of slow.obstacles ?? []) {
      this.stored.add(obstacleShape(o, this.isChosen('obstacle', o.id)));
    }
    for (const o of slow.objects ?? []) {
      this.stored.add(objectShape(o, this.isChosen('object', o.id)));
    }
  }

  get chosen(): Choice { return this.choice; }

  isChosen(kind: string, id: number): boolean {
    return this.choice?.kind === kind && this.choice.id === id;
  }

  choose(choice: Choice): void {
    this.choice = choice;
    this.take(this.slow);
  }

  under(ray: THREE.Ray): Choice {
    const caster = new THREE.Raycaster(ray.origin, ray.direction);
    const solids: THREE.Object3D[] = [];
    this.stored.traverse(node => { if (node.userData.choice) solids.push(node); });
    return (caster.intersectObjects(solids, false)[0]?.object.userData.choice as Choice) ?? null;
  }

  drawStroke(points: Vec3[]): void {
    clear(this.draft);
    if (points.length > 0) this.draft.add(tube(points, markRadius, palette.purple));
  }

  drawObstacle(obstacle: Obstacle): void {
    clear(this.draft);
    this.draft.add(obstacleShape(obstacle, true));
  }

  drawRegion(centre: Vec3, half: Vec3): void {
    clear(this.draft);
    const geometry = new THREE.BoxGeometry(2 * half[0], 2 * half[1], 2 * half[2]);
    const box = new THREE.Group();
    box.add(new THREE.Mesh(geometry, glass(palette.grey, 0.4)), outline(geometry, 0xffffff));
    box.position.set(...centre);
    this.draft.add(box);
  }

  clearDraft(): void { clear(this.draft); }
}
