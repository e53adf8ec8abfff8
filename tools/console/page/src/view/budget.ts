// When the next frame is drawn. A graphics chip draws whenever something is new. Without one a
// frame takes both cores for tens of milliseconds, in which acts, answers and the box's own tasks
// wait: so frames are few, rest for longer than they take, and none begins right behind a press.

const stillGap = 110;   // ms between frames, while the view stands
const turnGap = 60;     // while it is turned
const rest = 2;         // of what a frame costs, before the next one
const actFirst = 90;    // ms after a press or a release: what was done goes its way alone
const longestGap = 180; // at most: 5 frames a second are kept, whatever is pressed
const smoothing = 0.2;

export class FrameBudget {
  turning = false;
  cost = 0;  // ms that the browser's next call comes after the one that drew, smoothed
  private lastCall = 0;
  private lastDrawn = -Infinity;
  private lastAct = -Infinity;
  private drew = false;

  constructor(readonly software: boolean) {}

  // Of each call of the browser, drawn or not. Times: ms of performance.now().
  called(now: number): void {
    if (this.drew) this.cost += smoothing * (now - this.lastCall - this.cost);
    this.lastCall = now;
    this.drew = false;
  }

  acted(now: number): void { this.lastAct = now; }

  due(now: number): boolean {
    if (!this.software) return true;
    const gap = now - this.lastDrawn;
    if (gap < Math.max(this.turning ? turnGap : stillGap, rest * this.cost)) return false;
    return this.turning || gap >= longestGap || now - this.lastAct >= actFirst;
  }

  // Returns ms since the frame before.
  drawn(now: number): number {
    const gap = now - this.lastDrawn;
    this.lastDrawn = now;
    this.drew = true;
    return gap;
  }
}
