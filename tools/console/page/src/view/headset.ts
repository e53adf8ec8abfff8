// A headset or a handheld AR browser, where one is offered; elsewhere nothing is seen of it. The
// same scene; a controller is the hand: its ray points, its trigger presses, its grip stops, its
// thumbstick takes the next tool. A label at it says which tool, and what the box has answered. The
// loss of the session lets go of all that is held and stops the base.
import * as THREE from 'three';
import { Aimer } from '../act/aim';
import { Tools } from '../act/tools';
import { button, by } from '../panel/dom';
import { clear, label, palette } from './shapes';
import { Stage } from './stage';

const rayLength = 4;     // m
const lineHeight = 0.022;  // m between lines of the label
const pushed = 0.7;      // of a thumbstick's way: a tool further
const centred = 0.3;     // before the next one counts
const answerFor = 4000;  // ms that an answer stands on the label
const how = 'grip: STOP, stick: tool';

export interface HeadsetEvents {
  stop: (why: string) => void;
  said: (text: string) => void;
  toolText: () => string;
  nextTool: (step: 1 | -1) => void;
}

// What a person sees at the controller, who sees nothing of the page.
class Label {
  readonly group = new THREE.Group();
  text = '';

  constructor() { this.group.position.set(0, 0.06, -0.08); }

  show(lines: string[]): void {
    const text = lines.join('\n');
    if (text === this.text) return;
    this.text = text;
    clear(this.group);
    lines.forEach((line, i) => {
      const sprite = label(line);
      sprite.position.y = lineHeight * (lines.length - i);
      this.group.add(sprite);
    });
  }
}

export class Headset {
  private session: XRSession | null = null;
  private controllers: THREE.Group[] | null = null;
  private readonly labels: Label[] = [];
  private answer = '';
  private answered = -Infinity;

  constructor(private readonly stage: Stage, private readonly aimer: Aimer,
    private readonly tools: Tools, private readonly events: HeadsetEvents) {
    void this.offer('immersive-vr', 'VR');
    void this.offer('immersive-ar', 'AR');
  }

  // An answer of the box, for whoever sees no page.
  tell(text: string): void {
    this.answer = text;
    this.answered = performance.now();
  }

  get labelText(): string { return this.labels[0]?.text ?? ''; }

  private async offer(mode: XRSessionMode, text: string): Promise<void> {
    if (!await navigator.xr?.isSessionSupported(mode).catch(() => false)) return;
    by('looks').append(button(text, () => void this.begin(mode), { class: 'headset' }));
  }

  private async begin(mode: XRSessionMode): Promise<void> {
    if (this.session) {
      await this.session.end();
      return;
    }
    try {
      const session = await navigator.xr!.requestSession(mode,
        { optionalFeatures: ['local-floor', 'hand-tracking'] });
      await this.enter(session, mode);
    } catch (error) {
      this.events.said(`No session of the headset: ${(error as Error).message}`);
    }
  }

  private async enter(session: XRSession, mode: XRSessionMode): Promise<void> {
    const { renderer, rig, camera, scene } = this.stage;
    this.session = session;
    const background = scene.background;
    const stood = { position: camera.position.clone(), turn: camera.quaternion.clone() };
    if (mode === 'immersive-ar') scene.background = null;
    // Where the person looks from now, down on the floor.
    rig.position.set(camera.position.x, this.aimer.floorHeight, camera.position.z);
    renderer.xr.enabled = true;
    renderer.xr.setReferenceSpaceType('local-floor');
    await renderer.xr.setSession(session);
    const controllers = this.controllers ??= [0, 1].map(i => this.controller(i));
    rig.add(...controllers);
    session.addEventListener('visibilitychange', () => {
      if (session.visibilityState !== 'visible') this.events.stop('the headset hid the scene');
    });
    session.addEventListener('end', () => {
      this.session = null;
      this.tools.cancel();
      this.events.stop('the session of the headset ended');
      for (const controller of controllers) rig.remove(controller);
      rig.position.set(0, 0, 0);
      renderer.xr.enabled = false;
      scene.background = background;
      camera.position.copy(stood.position);
      camera.quaternion.copy(stood.turn);
      this.stage.touch();
    });
  }

  private controller(index: number): THREE.Group {
    const controller = this.stage.renderer.xr.getController(index);
    const line = new THREE.Line(new THREE.BufferGeometry().setFromPoints(
      [new THREE.Vector3(), new THREE.Vector3(0, 0, -rayLength)]),
      new THREE.LineBasicMaterial({ color: palette.yellow }));
    const label = new Label();
    this.labels.push(label);
    controller.add(line, label.group);
    let held = false;
    let source: XRInputSource | null = null;
    let stickFree = true;
    controller.addEventListener('connected', event => { source = event.data; });
    controller.addEventListener('squeezestart', () => this.events.stop('the grip was pressed'));
    controller.addEventListener('selectstart', () => {
      if (this.tools.busy) return;
      held = this.tools.down(this.aimer.along(this.ray(controller)));
    });
    controller.addEventListener('selectend', () => {
      if (held) this.tools.up(this.aimer.along(this.ray(controller)));
      held = false;
    });
    controller.addEventListener('disconnected', () => {
      if (held) this.tools.cancel();
      held = false;
      source = null;
    });
    this.stage.beforeFrame(() => {
      if (!this.session) return;
      const push = source?.gamepad?.axes[2] ?? 0;  // of the mapping xr-standard
      if (stickFree && !held && Math.abs(push) > pushed) this.events.nextTool(push > 0 ? 1 : -1);
      stickFree = Math.abs(push) < (stickFree ? pushed : centred);
      label.show(this.lines());
      if (held && this.tools.busy) this.tools.move(this.aimer.along(this.ray(controller)));
    });
    return controller;
  }

  private lines(): string[] {
    const fresh = performance.now() - this.answered < answerFor;
    return [this.events.toolText(), fresh ? this.answer : how];
  }

  private ray(controller: THREE.Group): THREE.Ray {
    controller.updateWorldMatrix(true, false);
    const turn = new THREE.Quaternion().setFromRotationMatrix(controller.matrixWorld);
    return new THREE.Ray(new THREE.Vector3().setFromMatrixPosition(controller.matrixWorld),
      new THREE.Vector3(0, 0, -1).applyQuaternion(turn));
  }
}
