// A gamepad as the hand: its left stick moves the cross-hair, its button A presses there, with the
// tool that is chosen. While the dead-man button is held the sticks drive and the cross-hair rests.
import { deadManButton, isStandard, stick } from './drive';

export interface Cross {
  moveCross: (dx: number, dy: number) => void;
  pressCross: () => void;
  releaseCross: (lost?: boolean) => void;
}

const pressButton = 0;       // A, the lowest of the four
const crossSpeed = 400;      // px/s at the end of the stick
const longestStep = 0.1;     // s: after a stall the cross-hair does not jump

export class GamepadHand {
  private wasPressed = false;
  private pressed = false;   // the cross-hair, by this button
  private last: number;

  constructor(private readonly pads: () => (Gamepad | null)[], private readonly cross: Cross,
    private readonly scene: { focus: () => void },
    private readonly now = () => performance.now()) {
    this.last = now();
  }

  poll(): void {
    const passed = Math.min(longestStep, (this.now() - this.last) / 1000);
    this.last = this.now();
    const pad = this.pads().find(isStandard);
    const held = pad?.buttons[pressButton]?.pressed ?? false;
    const fresh = held && !this.wasPressed;
    this.wasPressed = held;
    if (this.pressed && !held) {
      this.pressed = false;
      this.cross.releaseCross(pad === undefined);
    }
    if (!pad) return;
    if (fresh) {
      this.scene.focus();
      this.pressed = true;
      this.cross.pressCross();
    }
    if (pad.buttons[deadManButton]?.pressed) return;
    const [dx, dy] = [stick(pad, 0), stick(pad, 1)];
    if (dx !== 0 || dy !== 0) {
      this.cross.moveCross(dx * crossSpeed * passed, dy * crossSpeed * passed);
    }
  }
}
