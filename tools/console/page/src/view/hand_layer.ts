// The hand and what it feels: hand, proxy, contact normal, force, reach. Depth cues: a line down to
// what lies below, with a shadow there and the distance, and the distance to the proxy.
import * as THREE from 'three';
import { Pose, Vec3 } from '../wire/types';
import { distance, glass, label, palette, setArrow } from './shapes';

const metresAForce = 0.04;  // m a newton
const normalLength = 0.12;

export class HandLayer {
  readonly group = new THREE.Group();
  private readonly hand = new THREE.Mesh(new THREE.SphereGeometry(0.018, 16, 12),
    new THREE.MeshLambertMaterial({ color: palette.blue }));
  private readonly proxy = new THREE.Mesh(new THREE.SphereGeometry(0.013, 16, 12),
    new THREE.MeshLambertMaterial({ color: palette.yellow }));
  private readonly normal = this.arrow(palette.sky);
  private readonly force = this.arrow(palette.vermillion);
  private readonly reach = new THREE.Mesh(new THREE.SphereGeometry(1, 24, 16),
    new THREE.MeshBasicMaterial({ color: palette.sky, wireframe: true, transparent: true,
      opacity: 0.12, depthWrite: false }));
  private readonly shadow = new THREE.Mesh(new THREE.CircleGeometry(0.035, 24),
    glass(0x000000, 0.45));
  private readonly plumb = new THREE.Line(new THREE.BufferGeometry().setFromPoints(
    [new THREE.Vector3(), new THREE.Vector3(0, 0, -1)]),
    new THREE.LineDashedMaterial({ color: palette.sky, dashSize: 0.03, gapSize: 0.02 }));
  private height: THREE.Sprite | null = null;
  private said = '';

  constructor(private readonly below: (p: Vec3) => number | null) {
    this.group.add(this.hand, this.proxy, this.normal, this.force, this.reach, this.shadow,
      this.plumb);
    this.group.visible = false;
  }

  take(pose: Pose): void {
    this.group.visible = pose.handValid;
    if (!pose.handValid) return;
    this.hand.position.set(...pose.hand);
    (this.hand.material as THREE.MeshLambertMaterial).color
      .setHex(pose.clutch ? palette.grey : pose.button ? palette.purple : palette.blue);
    this.proxy.position.set(...pose.proxy);
    this.proxy.visible = pose.contact;
    setArrow(this.normal, pose.proxy,
      pose.contact ? pose.normal.map(v => normalLength * v) as Vec3 : [0, 0, 0], 1);
    setArrow(this.force, pose.hand, pose.force, metresAForce);
    this.reach.visible = pose.reach > 0;
    this.reach.position.set(...pose.hand);
    this.reach.scale.setScalar(Math.max(pose.reach, 1e-3));
    this.plumbLine(pose);
  }

  private plumbLine(pose: Pose): void {
    const ground = this.below(pose.hand);
    const drop = ground === null ? 0 : pose.hand[2] - ground;
    this.shadow.visible = this.plumb.visible = drop > 0.01;
    if (ground !== null) this.shadow.position.set(pose.hand[0], pose.hand[1], ground + 0.004);
    this.plumb.position.set(...pose.hand);
    this.plumb.scale.z = Math.max(drop, 1e-3);
    this.plumb.computeLineDistances();
    const depth = distance(pose.hand, pose.proxy);
    const text = pose.contact ? `${(1000 * depth).toFixed(0)} mm in, `
      + `${Math.hypot(...pose.force).toFixed(1)} N` : drop > 0.01 ? `${drop.toFixed(2)} m up` : '';
    if (text !== this.said) {
      this.said = text;
      if (this.height) this.group.remove(this.height);
      this.height = text ? label(text) : null;
      if (this.height) this.group.add(this.height);
    }
    this.height?.position.set(pose.hand[0], pose.hand[1], pose.hand[2] + 0.08);
  }

  private arrow(colour: number): THREE.ArrowHelper {
    return new THREE.ArrowHelper(new THREE.Vector3(0, 0, 1), new THREE.Vector3(), 0.1, colour);
  }
}
