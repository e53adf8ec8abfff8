// The pointer, the touch screen and the keyboard's cross-hair over the scene. With a tool in the
// hand, the first finger or the left button acts, two fingers or the right button turn the view.
import { MOUSE, Ray, TOUCH } from 'three';
import { by } from '../panel/dom';
import { Stage } from '../view/stage';
import { Aimer } from './aim';
import { Tools } from './tools';

const crossStep = 8;   // px a press of an arrow key
const crossFine = 2;   // with Shift
const still = 4;       // px between press and release of a click that is no drag

export class Pointer {
  private active: number | null = null;
  private cross: [number, number] | null = null;
  private crossDown = false;
  private looked: [number, number] | null = null;  // where a press of the tool "look" began

  // `choose`: a click of the tool "look" is on what lies there.
  constructor(private readonly stage: Stage, private readonly aimer: Aimer,
    private readonly tools: Tools, private readonly choose: (ray: Ray) => void) {
    const { canvas } = stage;
    canvas.addEventListener('pointerdown', event => this.down(event));
    canvas.addEventListener('pointermove', event => {
      if (event.pointerId === this.active) tools.move(aimer.at(event.clientX, event.clientY));
    });
    canvas.addEventListener('pointerup', event => {
      if (event.pointerId === this.active) this.end(event.clientX, event.clientY);
      else this.endLook(event.clientX, event.clientY);
    });
    for (const kind of ['pointercancel', 'lostpointercapture'] as const) {
      canvas.addEventListener(kind, event => {
        if (event.pointerId === this.active) this.cancel();
      });
    }
    canvas.addEventListener('contextmenu', event => event.preventDefault());
    canvas.addEventListener('keydown', event => this.key(event));
    canvas.addEventListener('keyup', event => {
      if (event.key === 'Enter') this.releaseCross();
    });
    canvas.addEventListener('blur', () => {
      this.releaseCross(true);
      by('cross').hidden = true;
    });
    this.buttons();
  }

  // The left button and one finger belong to the tool, or to the view with the tool "look".
  buttons(): void {
    const look = this.tools.name === 'look';
    const top = this.stage.look === 'top';
    const turn = top ? MOUSE.PAN : MOUSE.ROTATE;
    this.stage.controls.mouseButtons = { LEFT: look ? turn : null, MIDDLE: MOUSE.DOLLY,
      RIGHT: look ? MOUSE.PAN : turn };
    this.stage.controls.touches = { ONE: look ? top ? TOUCH.PAN : TOUCH.ROTATE : null,
      TWO: top || look ? TOUCH.DOLLY_PAN : TOUCH.DOLLY_ROTATE };
  }

  cancel(): void {
    this.active = null;
    this.crossDown = false;
    this.tools.cancel();
  }

  private down(event: PointerEvent): void {
    this.stage.canvas.focus({ preventScroll: true });
    by('cross').hidden = true;
    // A second finger turns the view: what the first one began is given up.
    if (this.active !== null) {
      this.cancel();
      return;
    }
    this.looked = null;
    if (event.button !== 0 || !event.isPrimary) return;
    if (this.tools.name === 'look') {
      this.looked = [event.clientX, event.clientY];
      return;
    }
    const { selecting } = this.tools;
    const sign = selecting.sign;
    if (event.shiftKey || event.altKey) selecting.sign = -1;
    if (this.tools.down(this.aimer.at(event.clientX, event.clientY))) {
      this.active = event.pointerId;
      this.stage.canvas.setPointerCapture(event.pointerId);
    }
    selecting.sign = sign;
  }

  private end(x: number, y: number): void {
    this.active = null;
    this.tools.up(this.aimer.at(x, y));
  }

  private endLook(x: number, y: number): void {
    const from = this.looked;
    this.looked = null;
    if (!from || Math.hypot(x - from[0], y - from[1]) > still) return;
    this.choose(this.aimer.at(x, y).ray);
  }

  private key(event: KeyboardEvent): void {
    const step = event.shiftKey ? crossFine : crossStep;
    const move = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, -step],
      ArrowDown: [0, step] }[event.key];
    if (move) this.moveCross(move[0]!, move[1]!);
    else if (event.key !== 'Enter') return;
    else if (!event.repeat) this.pressCross(event.shiftKey);
    event.preventDefault();
  }

  private place(): [number, number] {
    const box = this.stage.canvas.getBoundingClientRect();
    this.cross ??= [box.width / 2, box.height / 2];
    return [box.left + this.cross[0], box.top + this.cross[1]];
  }

  // px
  moveCross(dx: number, dy: number): void {
    const box = this.stage.canvas.getBoundingClientRect();
    this.place();
    this.cross = [Math.min(box.width - 1, Math.max(0, this.cross![0] + dx)),
      Math.min(box.height - 1, Math.max(0, this.cross![1] + dy))];
    this.showCross();
    if (this.crossDown) this.tools.move(this.aimer.at(...this.place()));
  }

  pressCross(takesAway = false): void {
    this.showCross();
    if (this.crossDown) return;
    const { selecting } = this.tools;
    const sign = selecting.sign;
    if (takesAway) selecting.sign = -1;
    this.place();
    this.crossDown = this.tools.down(this.aimer.at(...this.place()));
    selecting.sign = sign;
    by('cross').classList.toggle('pressed', this.crossDown);
  }

  releaseCross(lost = false): void {
    if (!this.crossDown) return;
    this.crossDown = false;
    by('cross').classList.remove('pressed');
    if (lost) this.tools.cancel();
    else this.tools.up(this.aimer.at(...this.place()));
  }

  private showCross(): void {
    this.place();
    const cross = by('cross');
    cross.hidden = false;
    cross.style.left = `${this.cross![0]}px`;
    cross.style.top = `${this.cross![1]}px`;
  }
}
