// The robot with turning wheels, the ghost of where it is predicted to be, what its place is worth,
// its camera's frustum, and the goal. Sizes of the base: config/robots/youbot.toml.
import * as THREE from 'three';
import { Picture, Pose } from '../wire/types';
import { glass, outline, palette, quaternion } from './shapes';

const base = { length: 0.58, width: 0.376, height: 0.14 };
const wheel = { radius: 0.0475, width: 0.05, forward: 0.228, side: 0.158 };
const frustumDepth = 0.5;  // m

function box(x: number, y: number, z: number, material: THREE.Material): THREE.Mesh {
  return new THREE.Mesh(new THREE.BoxGeometry(x, y, z), material);
}

function body(material: THREE.Material): THREE.Group {
  const group = new THREE.Group();
  const plate = box(base.length, base.width, base.height - 0.04, material);
  plate.position.z = base.height / 2 + 0.02;
  const arm = box(0.26, 0.18, 0.34, material);
  arm.position.set(0.143, 0, 0.31);
  const mast = box(0.06, 0.06, 0.86, material);
  mast.position.set(-0.2, 0, 0.57);
  const nose = new THREE.Mesh(new THREE.ConeGeometry(0.07, 0.14, 3), material);
  nose.rotation.z = -Math.PI / 2;
  nose.position.set(base.length / 2 + 0.05, 0, 0.08);
  group.add(plate, arm, mast, nose);
  return group;
}

function wheels(): THREE.Group[] {
  const rubber = new THREE.MeshLambertMaterial({ color: 0x2b2b2e });
  const spoke = new THREE.MeshBasicMaterial({ color: palette.yellow });
  const places = [[1, 1], [1, -1], [-1, 1], [-1, -1]] as const;  // front left first
  return places.map(([x, y]) => {
    const hub = new THREE.Group();
    const tyre = new THREE.Mesh(
      new THREE.CylinderGeometry(wheel.radius, wheel.radius, wheel.width, 20), rubber);
    const mark = box(0.012, wheel.width + 0.004, 1.7 * wheel.radius, spoke);  // shows the turning
    hub.add(tyre, mark);
    hub.position.set(x * wheel.forward, y * wheel.side, wheel.radius);
    return hub;
  });
}

export class RobotLayer {
  readonly group = new THREE.Group();
  readonly robot = body(new THREE.MeshLambertMaterial({ color: palette.orange }));
  private readonly ghost = body(glass(palette.sky, 0.3));
  private readonly hubs = wheels();
  private readonly doubt: THREE.Mesh;
  private readonly frustum = new THREE.LineSegments(new THREE.BufferGeometry(),
    new THREE.LineBasicMaterial({ color: palette.purple }));
  private readonly goal = new THREE.Group();

  constructor() {
    this.robot.add(...this.hubs);
    this.robot.add(outline(new THREE.BoxGeometry(base.length, base.width, 0.001), 0x000000));
    this.doubt = new THREE.Mesh(new THREE.RingGeometry(0.97, 1, 48), glass(palette.sky, 0.8));
    this.doubt.position.z = 0.01;
    const pole = new THREE.Mesh(new THREE.CylinderGeometry(0.012, 0.012, 0.5),
      new THREE.MeshBasicMaterial({ color: palette.green }));
    pole.rotation.x = Math.PI / 2;
    pole.position.z = 0.25;
    const flag = new THREE.Mesh(new THREE.ConeGeometry(0.08, 0.2, 4),
      new THREE.MeshBasicMaterial({ color: palette.green }));
    flag.rotation.z = -Math.PI / 2;  // points along the goal's heading
    flag.position.set(0.1, 0, 0.45);
    this.goal.add(pole, flag);
    this.group.add(this.robot, this.ghost, this.doubt, this.frustum, this.goal);
    for (const part of this.group.children) part.visible = false;
  }

  take(pose: Pose): void {
    const [x, y, yaw] = pose.robot;
    this.robot.visible = pose.robotValid;
    this.robot.position.set(x, y, 0);
    this.robot.rotation.z = yaw;
    pose.wheels.forEach((angle, i) => { this.hubs[i]!.rotation.y = angle; });
    const [px, py, pyaw] = pose.predicted;
    this.ghost.visible = pose.robotValid && Math.hypot(px - x, py - y, pyaw - yaw) > 0.01;
    this.ghost.position.set(px, py, 0);
    this.ghost.rotation.z = pyaw;
    this.doubt.visible = pose.robotValid && pose.error > 0 && Number.isFinite(pose.error);
    this.doubt.position.set(x, y, 0.01);
    this.doubt.scale.setScalar(Math.max(0.35, Math.min(5, 0.35 + pose.error)));
    const [gx, gy, gyaw] = pose.goal;
    this.goal.visible = Number.isFinite(gx) && Number.isFinite(gy) && pose.goalEngaged;
    this.goal.position.set(gx, gy, 0);
    this.goal.rotation.z = gyaw;
    this.frustum.visible = pose.cameraValid;
    this.frustum.position.set(pose.camera[0]!, pose.camera[1]!, pose.camera[2]!);
    this.frustum.quaternion.copy(quaternion(pose.camera.slice(3)));
    (this.frustum.material as THREE.LineBasicMaterial).color
      .setHex(pose.cameraClaimed ? palette.purple : palette.vermillion);
  }

  lens(picture: Picture): void {
    const at = (u: number, v: number): [number, number, number] => [
      frustumDepth * (u - picture.cx) / picture.fx, frustumDepth * (v - picture.cy) / picture.fy,
      frustumDepth];
    const corners = [at(0, 0), at(picture.width, 0), at(picture.width, picture.height),
      at(0, picture.height)];
    const lines: number[] = [];
    corners.forEach((corner, i) => {
      lines.push(0, 0, 0, ...corner, ...corner, ...corners[(i + 1) % 4]!);
    });
    this.frustum.geometry.dispose();
    this.frustum.geometry = new THREE.BufferGeometry();
    this.frustum.geometry.setAttribute('position',
      new THREE.BufferAttribute(new Float32Array(lines), 3));
  }
}
