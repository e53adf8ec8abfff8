// A gamepad as the hand: its left stick moves the cross-hair, its button A presses there, with the
// tool that is chosen. While the dead-man button is held the sticks drive and the cross-hair rests.
import { PadReading } from './pads';

export interface Cross {
  moveCross: (dx: number, dy: number) => void;
  pressCross: () => void;
  releaseCross: (lost?: boolean) => void;
}

const crossSpeed = 400;      // px/s at the end of the stick
const longestStep = 0.1;     // s: after a stall the cross-hair does not jump

export class GamepadHand {
  private wasPressed = false;
  private pressed = false;   // the cross-hair, by this button
  private last: number;

  constructor(private readonly pads: { reading: () => PadReading | null },
    private readonly cross: Cross, private readonly scene: { focus: () => void },
    private readonly now = () => performance.now()) {
    this.last = now();
  }

  poll(): void {
    const passed = Math.min(longestStep, (this.now() - this.last) / 1000);
    this.last = this.now();
    const pad = this.pads.reading();
    const held = pad?.press ?? false;
    const fresh = held && !this.wasPressed;
    this.wasPressed = held;
    if (this.pressed && !held) {
      this.pressed = false;
      this.cross.releaseCross(pad === null);
    }
    if (!pad) return;
    if (fresh) {
      this.scene.focus();
      this.pressed = true;
      this.cross.pressCross();
    }
    if (pad.deadMan) return;
    const [dx, dy] = [0 - pad.left, 0 - pad.forward];
    if (dx !== 0 || dy !== 0) {
      this.cross.moveCross(dx * crossSpeed * passed, dy * crossSpeed * passed);
    }
  }
}
