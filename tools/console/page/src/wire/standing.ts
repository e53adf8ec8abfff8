// Whether the camera of the pictures stands. A picture comes with the newest pose of the camera
// that the box knows, which is that of an earlier one: while it moves, the place of what a picture
// shows is off by the way since.
export const stoodFor = 0.4;   // s of the box's clock: longer than a pose is late
const another = 1;             // s: so much older is of another clock
const farther = 0.01;          // m
const turned = 0.006;          // rad: 1.2 cm at 2 m

// Position, quaternion w x y z.
export function moved(from: number[], to: number[]): boolean {
  const way = Math.hypot(...[0, 1, 2].map(k => to[k]! - from[k]!));
  const cos = Math.abs([3, 4, 5, 6].reduce((sum, k) => sum + from[k]! * to[k]!, 0));
  return way > farther || 2 * Math.acos(Math.min(1, cos)) > turned;
}

export class Standing {
  private from: number[] | null = null;
  private since = 0;  // s of the box's clock
  private last = 0;

  // `exposed`: s of the box's clock. Pictures with colour come behind newer ones without.
  take(camera: number[], exposed: number): void {
    const before = this.last - exposed;
    if (this.from && before > 0 && before < another) return;
    if (!this.from || before > 0 || moved(this.from, camera)) {
      this.from = camera;
      this.since = exposed;
    }
    this.last = exposed;
  }

  forget(): void { this.from = null; }

  get stands(): boolean { return this.from !== null && this.last - this.since >= stoodFor; }
}
