// Small things that layers share: lines, labels, quaternions, disposal.
import * as THREE from 'three';
import { Vec3 } from '../wire/types';

// Okabe and Ito's colours: told apart with any colour vision.
export const palette = {
  blue: 0x0072b2, sky: 0x56b4e9, green: 0x009e73, yellow: 0xf0e442, orange: 0xe69f00,
  vermillion: 0xd55e00, purple: 0xcc79a7, grey: 0x999999,
} as const;

// From w x y z.
export function quaternion(wxyz: number[]): THREE.Quaternion {
  return new THREE.Quaternion(wxyz[1], wxyz[2], wxyz[3], wxyz[0]).normalize();
}

// Materials that come and go with what is drawn are kept, one of each look: with the last one of
// its kind goes its shader, and the next one waits for a new one to be compiled.
const kept = new Map<string, THREE.Material>();

function keep<M extends THREE.Material>(name: string, make: () => M): M {
  let material = kept.get(name) as M | undefined;
  if (!material) {
    kept.set(name, material = make());
    material.userData.kept = true;
  }
  return material;
}

export function flat(colour: number): THREE.MeshBasicMaterial {
  return keep(`flat ${colour}`, () => new THREE.MeshBasicMaterial({ color: colour }));
}

export function glass(colour: number, opacity: number): THREE.MeshBasicMaterial {
  return keep(`glass ${colour} ${opacity}`, () => new THREE.MeshBasicMaterial({ color: colour,
    transparent: true, opacity, depthWrite: false }));
}

export function dispose(root: THREE.Object3D): void {
  root.traverse(node => {
    const drawn = node as Partial<THREE.Mesh>;
    drawn.geometry?.dispose();
    const materials = Array.isArray(drawn.material) ? drawn.material : [drawn.material];
    for (const material of materials) {
      if (!material || material.userData.kept) continue;
      (material as THREE.SpriteMaterial).map?.dispose();
      material.dispose();
    }
  });
}

export function clear(group: THREE.Group): void {
  for (const child of [...group.children]) {
    dispose(child);
    group.remove(child);
  }
}

// Lines are one pixel wide in WebGL; a tube is seen from afar. At most 512 segments.
export function tube(points: Vec3[], radius: number, colour: number): THREE.Object3D {
  const material = flat(colour);
  const unique = points.filter((p, i) => i === 0 || distance(p, points[i - 1]!) > 1e-4);
  if (unique.length < 2) {
    const dot = new THREE.Mesh(new THREE.SphereGeometry(2 * radius, 12, 8), material);
    if (unique[0]) dot.position.set(...unique[0]);
    return dot;
  }
  const curve = new THREE.CurvePath<THREE.Vector3>();
  for (let i = 1; i < unique.length; ++i) {
    curve.add(new THREE.LineCurve3(new THREE.Vector3(...unique[i - 1]!),
      new THREE.Vector3(...unique[i]!)));
  }
  const segments = Math.min(512, 4 * unique.length);
  return new THREE.Mesh(new THREE.TubeGeometry(curve as unknown as THREE.Curve<THREE.Vector3>,
    segments, radius, 6), material);
}

export function outline(geometry: THREE.BufferGeometry, colour: number): THREE.LineSegments {
  return new THREE.LineSegments(new THREE.EdgesGeometry(geometry, 20),
    keep(`line ${colour}`, () => new THREE.LineBasicMaterial({ color: colour })));
}

// The newest labels keep their pictures: one that is shown again, or moves, is not drawn anew.
const labels = new Map<string, THREE.SpriteMaterial>();
const mostLabels = 64;

function labelMaterial(text: string, colour: string): THREE.SpriteMaterial {
  const name = `${colour} ${text}`;
  const known = labels.get(name);
  labels.delete(name);
  const material = known ?? new THREE.SpriteMaterial({
    map: new THREE.CanvasTexture(labelPicture(text, colour)), depthTest: false,
    sizeAttenuation: false,
  });
  material.userData.kept = true;
  labels.set(name, material);
  if (labels.size > mostLabels) {
    const [oldest, old] = labels.entries().next().value!;
    old.map!.dispose();
    old.dispose();  // one that is shown yet gets its picture again
    labels.delete(oldest);
  }
  return material;
}

function labelPicture(text: string, colour: string): HTMLCanvasElement {
  const canvas = document.createElement('canvas');
  const context = canvas.getContext('2d')!;
  const font = '500 26px system-ui, sans-serif';
  context.font = font;
  canvas.width = Math.ceil(context.measureText(text).width) + 20;
  canvas.height = 40;
  context.font = font;
  context.fillStyle = 'rgba(20, 24, 30, 0.78)';
  context.beginPath();
  context.roundRect(0, 0, canvas.width, canvas.height, 8);
  context.fill();
  context.fillStyle = colour;
  context.textBaseline = 'middle';
  context.fillText(text, 10, 21);
  return canvas;
}

export function label(text: string, colour = '#ffffff'): THREE.Sprite {
  const sprite = new THREE.Sprite(labelMaterial(text, colour));
  const canvas = sprite.material.map!.image as HTMLCanvasElement;
  const height = 0.036;
  sprite.scale.set(height * canvas.width / canvas.height, height, 1);
  sprite.renderOrder = 10;
  return sprite;
}

export function distance(a: Vec3, b: Vec3): number {
  return Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
}

export function setArrow(arrow: THREE.ArrowHelper, from: Vec3, way: Vec3, scale: number): void {
  const length = scale * Math.hypot(...way);
  arrow.visible = length > 1e-3;
  if (!arrow.visible) return;
  arrow.position.set(...from);
  arrow.setDirection(new THREE.Vector3(...way).normalize());
  arrow.setLength(length, Math.min(0.04, 0.4 * length), Math.min(0.025, 0.3 * length));
}
