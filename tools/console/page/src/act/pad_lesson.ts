// A gamepad of no known mapping is shown, one movement after the other, what its axes and buttons
// are. Asked by a timer; nothing is driven meanwhile.
import { PadMap } from './pads';

const pushed = 0.6;      // of an axis: it is meant
const free = 0.25;       // of an axis: let go
const atRest = 0.3;      // an axis that rests further out is a trigger, no stick
const heldPolls = 4;     // in a row, so that a movement in passing does not count

const steps = [
  ['forward', 'push the left stick forwards'], ['left', 'push the left stick to the left'],
  ['turn', 'push the right stick to the left'],
  ['deadMan', 'press the button to hold while driving, as the right shoulder button'],
  ['press', 'press the button that presses at the cross-hair, as A'],
] as const;

export class PadLesson {
  private at = 0;
  private readonly found: Partial<PadMap> = {};
  private rest: number[] | null = null;  // of the axes, when nothing was touched
  private before: readonly number[] = [];
  private still = 0;
  private meant = '';
  private polls = 0;
  private waits = true;                  // until all is let go

  get done(): boolean { return this.at === steps.length; }
  get map(): PadMap { return this.found as PadMap; }

  get text(): string {
    if (this.waits) return `Step ${this.at + 1} of ${steps.length}: let go of sticks and buttons.`;
    return `Step ${this.at + 1} of ${steps.length}: ${steps[this.at]![1]}, and hold it.`;
  }

  poll(pad: Gamepad): void {
    if (this.done) return;
    const down = pad.buttons.flatMap((button, i) => button.pressed ? [i] : []);
    if (this.waits) {
      this.waitForRest(pad, down);
      return;
    }
    const [name] = steps[this.at]!;
    const meant = name === 'deadMan' || name === 'press' ? this.button(down) : this.axis(pad.axes);
    this.polls = meant !== '' && meant === this.meant ? this.polls + 1 : 0;
    this.meant = meant;
    if (this.polls < heldPolls) return;
    const [index, sign] = meant.split(' ').map(Number) as [number, 1 | -1];
    if (name === 'deadMan' || name === 'press') this.found[name] = index;
    else this.found[name] = { index, sign };
    ++this.at;
    this.waits = true;
    this.meant = '';
    this.polls = 0;
  }

  private waitForRest(pad: Gamepad, down: number[]): void {
    const { rest } = this;
    const moved = rest ? pad.axes.some((value, i) => Math.abs(value - (rest[i] ?? 0)) > free)
      : pad.axes.some((value, i) => Math.abs(value - (this.before[i] ?? Infinity)) > 0.05);
    this.before = [...pad.axes];
    this.still = moved || down.length > 0 ? 0 : this.still + 1;
    if (this.still < heldPolls) return;
    this.rest ??= [...pad.axes];
    this.still = 0;
    this.waits = false;
  }

  // The one that is farthest from its rest; ''. none is meant.
  private axis(axes: readonly number[]): string {
    const taken = [this.found.forward?.index, this.found.left?.index];
    let best = '';
    let most = pushed;
    axes.forEach((value, i) => {
      if (taken.includes(i) || Math.abs(this.rest![i] ?? 0) > atRest) return;
      if (Math.abs(value) < most) return;
      most = Math.abs(value);
      best = `${i} ${value > 0 ? 1 : -1}`;
    });
    return best;
  }

  private button(down: number[]): string {
    const fresh = down.filter(i => i !== this.found.deadMan);
    return fresh.length === 1 ? String(fresh[0]) : '';
  }
}
