// What must be held: engage, hand, drive. A token 20 times a second says "I still hold this"; the
// box ends the act 200 ms after the last one. Whatever takes the page away from the person (blur,
// hidden tab, lost pointer, gamepad or socket, a frozen browser) lets go here as well, and only a
// new press holds again. Where the line was late only the box knows that it let go: it says so.
import { Hold } from '../wire/types';

export const tokenPeriod = 50;  // ms
const life = 200;               // ms that a token lives
const underWay = 100;           // ms by which the ways of two tokens may differ

export interface HeldRoad {
  tell: (act: string, keys: object) => void;
}

export const lateLine = 'the box heard too late that it was held';

type Lost = (why: string, holds: Hold[]) => void;

export class Held {
  private readonly holds = new Map<Hold, number>();  // since, s of the page's clock
  private lastTick = 0;
  private timer: ReturnType<typeof setInterval> | null = null;
  private readonly hearers: Lost[] = [];

  constructor(private readonly road: HeldRoad, private readonly now = () => performance.now()) {}

  onLost(hear: Lost): void { this.hearers.push(hear); }
  has(hold: Hold): boolean { return this.holds.has(hold); }

  // Only from a fresh press of a person.
  press(hold: Hold): void {
    this.awake();
    if (!this.holds.has(hold)) this.holds.set(hold, performance.now() / 1000);
    this.send();
    if (this.timer !== null) return;
    this.lastTick = this.now();
    this.timer = setInterval(() => this.tick(), tokenPeriod);
  }

  // The box may have lost it, which the page can not know yet: let go first.
  pressAnew(hold: Hold): void {
    this.holds.delete(hold);
    this.send();
    this.press(hold);
  }

  // What the box has let go of by itself, in a view that was made then; s of the page's clock. One
  // from before a press says nothing of it.
  boxLost(which: Hold[], made: number): void {
    this.lose(lateLine, which.filter(hold =>
      made > (this.holds.get(hold) ?? Infinity) + underWay / 1000));
  }

  release(hold: Hold): void {
    if (!this.awake() || !this.holds.delete(hold)) return;
    this.send();
    this.rest();
  }

  // The person may not know: told why, and of what.
  lose(why: string, which: Hold[] = ['engage', 'hand', 'drive']): void {
    const lost = which.filter(hold => this.holds.delete(hold));
    if (lost.length === 0) return;
    this.send();
    this.rest();
    for (const hear of this.hearers) hear(why, lost);
  }

  // After a freeze the box has let go; a token now would take the act up again without a press.
  // Asked also before each command of a held act: after a freeze its timer may be the first to run.
  awake(): boolean {
    if (this.timer === null) return true;
    const gap = this.now() - this.lastTick;
    if (gap <= life) return true;
    this.lose(`the browser stood still for ${Math.round(gap)} ms`);
    return false;
  }

  // Nothing is held: its time alone, by which the page knows how old a picture is.
  greet(): void { if (this.timer === null) this.send(); }

  private tick(): void {
    if (!this.awake()) return;
    this.lastTick = this.now();
    this.send();
  }

  private send(): void {
    this.road.tell('token', { holds: [...this.holds.keys()], t: performance.now() / 1000 });
  }

  private rest(): void {
    if (this.holds.size > 0 || this.timer === null) return;
    clearInterval(this.timer);
    this.timer = null;
  }
}

// The page's own ways to be taken away.
export function watchLoss(held: Held): void {
  addEventListener('blur', () => held.lose('the window lost the focus', ['hand', 'drive']));
  document.addEventListener('visibilitychange', () => {
    if (document.hidden) held.lose('the page was hidden');
  });
  addEventListener('pagehide', () => held.lose('the page was left'));
  addEventListener('pointercancel', () => held.lose('the pointer was taken away',
    ['hand', 'drive']));
  addEventListener('gamepaddisconnected', () => held.lose('the gamepad was lost',
    ['hand', 'drive']));
}
