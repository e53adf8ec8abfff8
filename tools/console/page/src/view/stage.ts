// The picture itself: renderer, lights, the camera and its four ways to look. W has z up; three.js
// and WebXR have y up, so all that is drawn hangs below `world`, which turns one into the other.
import * as THREE from 'three';
import { OrbitControls } from 'three/addons/controls/OrbitControls.js';
import { Pose, Vec3 } from '../wire/types';
import { FrameBudget } from './budget';
import { quaternion } from './shapes';

export type Look = 'orbit' | 'follow' | 'first' | 'top';
export const looks: Look[] = ['orbit', 'follow', 'first', 'top'];

THREE.ColorManagement.enabled = false;  // colours of the sensor are shown as they are

const softwareNames = /swiftshader|llvmpipe|software|basic render/i;
const softwareRatio = 0.5;   // pixels drawn for a pixel shown, each way, without a graphics chip
const slowFrame = 100;       // ms that a frame costs: beyond, fewer pixels are drawn
const leastRatio = 0.4;
const topHeight = 6;     // m

function nameOf(gl: WebGLRenderingContext | WebGL2RenderingContext): string {
  const info = gl.getExtension('WEBGL_debug_renderer_info');
  return String(gl.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : gl.RENDERER));
}

// Smooth edges are chosen with the context, so another one is asked first.
function drawsInSoftware(): boolean {
  const gl = document.createElement('canvas').getContext('webgl');
  const answer = gl === null || softwareNames.test(nameOf(gl));
  gl?.getExtension('WEBGL_lose_context')?.loseContext();
  return answer;
}

export class Stage {
  readonly scene = new THREE.Scene();
  readonly world = new THREE.Group();
  readonly rig = new THREE.Group();  // where a headset stands
  readonly camera = new THREE.PerspectiveCamera(55, 1, 0.03, 100);
  readonly renderer: THREE.WebGLRenderer;
  readonly controls: OrbitControls;
  look: Look = 'orbit';
  fps = 0;
  frames = 0;
  readonly software: boolean;
  readonly rendererName: string;  // asked once: each question waits for the drawing process
  readonly budget: FrameBudget;
  private dirty = true;
  private readonly grid: THREE.GridHelper;
  private readonly before: (() => void)[] = [];
  private readonly beside: (() => void)[] = [];

  constructor(readonly canvas: HTMLCanvasElement) {
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: !drawsInSoftware() });
    this.renderer.outputColorSpace = THREE.LinearSRGBColorSpace;
    this.rendererName = nameOf(this.renderer.getContext());
    this.software = softwareNames.test(this.rendererName);
    this.budget = new FrameBudget(this.software);
    this.renderer.setPixelRatio(this.software ? softwareRatio : Math.min(devicePixelRatio, 2));
    this.world.rotation.x = -Math.PI / 2;
    this.grid = new THREE.GridHelper(12, 24);
    this.grid.position.y = -0.02;  // below the floor that is seen
    this.rig.add(this.camera);
    this.scene.add(this.world, this.rig, this.grid,
      new THREE.HemisphereLight(0xffffff, 0x8890a0, 2.2), this.sun());
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.enableDamping = false;
    this.controls.maxPolarAngle = 0.495 * Math.PI;
    this.controls.addEventListener('change', () => this.touch());
    this.controls.addEventListener('start', () => { this.budget.turning = true; });
    this.controls.addEventListener('end', () => { this.budget.turning = false; });
    this.controls.listenToKeyEvents = () => {};  // keys belong to the acts
    this.setView([-1.6, -2.6, 2.2], [1.2, 0, 0.2]);
    new ResizeObserver(() => this.resize()).observe(canvas.parentElement!);
    this.renderer.setAnimationLoop(time => this.frame(time));
  }

  // Something changed: draw again.
  touch(): void { this.dirty = true; }
  // In each call of the browser, drawn or not.
  beforeFrame(hook: () => void): void { this.before.push(hook); }
  // Beside each frame that is drawn: what else changes on the page then is shown by the same
  // picture of the browser's, and each such picture costs as much as a frame without a chip.
  besideFrame(hook: () => void): void { this.beside.push(hook); }

  colours(background: string, lines: string): void {
    this.scene.background = new THREE.Color(background);
    const material = this.grid.material as THREE.LineBasicMaterial;
    material.vertexColors = false;
    material.color.set(lines);
    material.needsUpdate = true;
    this.touch();
  }

  setView(eye: Vec3, target: Vec3): void {
    this.camera.position.copy(this.toThree(eye));
    this.controls.target.copy(this.toThree(target));
    this.controls.update();
    this.touch();
  }

  lookAt(target: Vec3): void {
    if (this.look === 'first') this.setLook('orbit');
    const to = this.toThree(target);
    const way = to.clone().sub(this.controls.target);
    this.camera.position.add(way);
    this.controls.target.copy(to);
    const back = this.camera.position.clone().sub(to);
    if (back.length() > 3) this.camera.position.copy(to).addScaledVector(back.normalize(), 3);
    this.controls.update();
    this.touch();
  }

  toThree(p: Vec3): THREE.Vector3 { return new THREE.Vector3(p[0], p[2], -p[1]); }
  toWorld(p: THREE.Vector3): Vec3 { return [p.x, -p.z, p.y]; }

  setLook(look: Look, pose: Pose | null = null): void {
    this.look = look;
    this.controls.enableRotate = look === 'orbit' || look === 'follow';
    const at: Vec3 = pose?.robotValid ? [pose.robot[0], pose.robot[1], 0] : [0.5, 0, 0];
    const yaw = pose?.robotValid ? pose.robot[2] : 0;
    if (look === 'top') {
      this.setView([at[0] + 0.7 - 0.01, at[1], topHeight], [at[0] + 0.7, at[1], 0]);
    } else if (look !== 'first') {
      const side = look === 'follow' ? 0 : -2;
      const eye: Vec3 = [at[0] - 2.2 * Math.cos(yaw) - side * Math.sin(yaw),
        at[1] - 2.2 * Math.sin(yaw) + side * Math.cos(yaw), 2];
      this.setView(eye, [at[0] + 0.9 * Math.cos(yaw), at[1] + 0.9 * Math.sin(yaw), 0.2]);
    }
    this.follow(pose, null);
    this.touch();
  }

  // The camera goes with the robot, or is the robot's.
  follow(pose: Pose | null, before: Pose | null): void {
    if (!pose) return;
    if (this.look === 'follow' && before && pose.robotValid && before.robotValid) {
      const way = this.toThree([pose.robot[0] - before.robot[0], pose.robot[1] - before.robot[1],
        0]);
      this.camera.position.add(way);
      this.controls.target.add(way);
      this.controls.update();
    } else if (this.look === 'first' && pose.cameraValid) {
      const q = quaternion(pose.camera.slice(3));
      const forward = new THREE.Vector3(0, 0, 1).applyQuaternion(q);
      const eye = pose.camera.slice(0, 3) as Vec3;
      const down = new THREE.Vector3(0, 1, 0).applyQuaternion(q);
      this.camera.position.copy(this.toThree(eye));
      this.camera.up.copy(this.toThree([-down.x, -down.y, -down.z]));
      this.camera.lookAt(this.toThree([eye[0] + forward.x, eye[1] + forward.y,
        eye[2] + forward.z]));
      this.camera.up.set(0, 1, 0);
    }
  }

  // Pixels of the page, or null behind the camera.
  toScreen(p: Vec3): [number, number] | null {
    this.camera.updateMatrixWorld();
    const at = this.toThree(p).project(this.camera);
    if (at.z > 1 || at.z < -1) return null;
    const box = this.canvas.getBoundingClientRect();
    return [box.left + (at.x + 1) / 2 * box.width, box.top + (1 - at.y) / 2 * box.height];
  }

  rayFrom(x: number, y: number): THREE.Ray {
    const box = this.canvas.getBoundingClientRect();
    const caster = new THREE.Raycaster();
    this.camera.updateMatrixWorld();
    caster.setFromCamera(new THREE.Vector2(2 * (x - box.left) / box.width - 1,
      1 - 2 * (y - box.top) / box.height), this.camera);
    return caster.ray;
  }


  private sun(): THREE.Light {
    const sun = new THREE.DirectionalLight(0xffffff, 1.2);
    sun.position.set(-2, 5, 3);
    return sun;
  }

  private resize(): void {
    const box = this.canvas.parentElement!.getBoundingClientRect();
    if (box.width < 1 || box.height < 1) return;
    this.renderer.setSize(box.width, box.height, false);
    this.camera.aspect = box.width / box.height;
    this.camera.updateProjectionMatrix();
    this.touch();
  }

  private frame(time: number): void {
    const { budget } = this;
    const { isPresenting } = this.renderer.xr;
    budget.called(time);
    for (const hook of this.before) hook();
    if (!isPresenting && (!this.dirty || !budget.due(time))) return;
    this.dirty = false;
    const gap = budget.drawn(time);
    if (gap > 0 && gap < 1000) this.fps += 0.1 * (1000 / gap - this.fps);
    const ratio = this.renderer.getPixelRatio();
    if (budget.cost > slowFrame && this.frames > 30 && ratio > leastRatio) {
      this.renderer.setPixelRatio(Math.max(leastRatio, 0.8 * ratio));
    }
    ++this.frames;
    this.renderer.render(this.scene, this.camera);
    for (const hook of this.beside) hook();
  }
}
