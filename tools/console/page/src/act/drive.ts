// Dead-man driving: as long as keys, a pad on the screen, or a gamepad's shoulder button with its
// stick are held. The box limits speed; here 1 is the speed chosen on the page.
import { Held } from './held';
import { PadReading } from './pads';

export interface DriveRoad {
  tell: (act: string, keys: object) => number;
}

export interface DriveGate {
  why: () => string | null;  // why driving is not possible now
}

const period = 50;             // ms between commands
const turn = 2;                // rad/s a m/s
export type Command = [number, number, number];  // vx vy wz

export class Drive {
  speed = 0.3;                 // m/s
  private readonly down = new Map<string, Command>();
  private pad: Command | null = null;
  private padWasHeld = false;
  private timer: ReturnType<typeof setInterval> | null = null;
  private readonly sent = new Set<number>();  // ids of commands since a press

  constructor(private readonly road: DriveRoad, private readonly held: Held,
    private readonly gate: DriveGate, private readonly refused: (why: string) => void,
    private readonly pads: { reading: () => PadReading | null }) {
    held.onLost((_, holds) => { if (holds.includes('drive')) this.forget(); });
  }

  // A press of a key or of the pad on the screen. False: it may not drive now.
  press(source: string, command: Command): boolean {
    const why = this.gate.why();
    if (why !== null) {
      this.refused(why);
      return false;
    }
    this.down.set(source, command);
    this.begin();
    return true;
  }

  release(source: string): void {
    if (!this.down.delete(source)) return;
    if (this.down.size === 0 && !this.pad) this.end();
    else this.send();
  }

  releaseAll(): void {
    this.forget();
    this.held.release('drive');
  }

  get driving(): boolean { return this.held.has('drive'); }

  // Gamepads have no events of their own. Asked by a timer, never by frames alone: where none is
  // drawn, a button that was let go would not be seen.
  pollGamepad(): void {
    const pad = this.pads.reading();
    const held = pad?.deadMan ?? false;
    const fresh = held && !this.padWasHeld;
    this.padWasHeld = held;
    if (!held || !pad) {
      if (this.pad) {
        this.pad = null;
        if (this.down.size === 0) this.end();
      }
      return;
    }
    if (fresh) {
      const why = this.gate.why();
      if (why !== null) this.refused(why);
      else this.pad = [0, 0, 0];
      if (this.pad) this.begin();
    }
    if (this.pad) this.pad = [pad.forward, pad.left, pad.turn];
  }

  // The box refuses a command: the hold is let go and told once, not 20 times a second. False: the
  // answer is of no command.
  wasRefused(id: number, why: string): boolean {
    if (!this.sent.has(id)) return false;
    this.held.lose(why, ['drive']);
    return true;
  }

  private begin(): void {
    if (!this.driving) this.sent.clear();
    this.held.press('drive');
    this.send();
    this.timer ??= setInterval(() => {
      this.pollGamepad();
      if (this.driving) this.send();
    }, period);
  }

  private end(): void {
    this.send();
    this.held.release('drive');
    this.forget();
  }

  private forget(): void {
    this.down.clear();
    this.pad = null;
    if (this.timer !== null) clearInterval(this.timer);
    this.timer = null;
  }

  private send(): void {
    if (!this.held.awake()) return;
    const why = this.gate.why();
    if (why !== null && this.driving) {
      this.held.lose(why, ['drive']);
      return;
    }
    const sum: Command = [0, 0, 0];
    for (const command of [...this.down.values(), this.pad ?? [0, 0, 0]]) {
      for (let k = 0; k < 3; ++k) sum[k]! += command[k]!;
    }
    const unit = (v: number) => Math.max(-1, Math.min(1, v));
    this.sent.add(this.road.tell('drive', {
      vx: this.speed * unit(sum[0]), vy: this.speed * unit(sum[1]),
      wz: turn * this.speed * unit(sum[2]),
    }));
  }
}
