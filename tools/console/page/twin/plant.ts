// The twin's robot, hand and what is held: enough of the box's rules that the page can be tried
// alone. It is no model of the stack: paths are straight lines round one disc.
import { Obstacle, Vec3 } from '../src/wire/types';

const tokenLife = 0.2;       // s
const acceleration = 4;      // m/s2
const cruise = 0.6;          // m/s towards a goal
const bodyRadius = 0.35;     // m of the base
const reached = 0.03;        // m from the end of the path
const arrival = 0.1;         // m from the goal
const warnAhead = 0.7;       // s of driving by hand

export const holdNames = ['engage', 'hand', 'drive'] as const;
export type HoldName = typeof holdNames[number];

type Xy = [number, number];

// As tools/desk/hold.hpp: one that lapsed is not taken up by what says it again; a token without it
// must come first.
class Hold {
  state: 'free' | 'held' | 'lost' = 'free';
  until = 0;

  say(held: boolean, now: number): void {
    this.expire(now);
    if (!held) this.state = 'free';
    if (!held || this.state === 'lost') return;
    this.state = 'held';
    this.until = now + tokenLife;
  }

  lose(): void { if (this.state === 'held') this.state = 'lost'; }

  expire(now: number): void { if (now > this.until) this.lose(); }
}

export class Plant {
  time = 0;
  mode = 'hold';
  robotMode: string | null = null;  // null: that of this box
  cause = '';
  phase = 'idle';
  robot: Vec3 = [0, 0, 0];
  velocity: Vec3 = [0, 0, 0];
  wheels = [0, 0, 0, 0];
  goal: { at: Xy; yaw: number | null } | null = null;
  off = -1;  // m from the end of the path to what was asked for; below 0: no path
  path: Xy[] = [];
  linkUp = true;
  hand: { p: Vec3; normal: Vec3; press: boolean } | null = null;  // as said last, while held
  obstacles: Obstacle[] = [];
  onEvent: (text: string, kind: string) => void = () => {};
  private readonly held = { engage: new Hold(), hand: new Hold(), drive: new Hold() };
  private command: Vec3 = [0, 0, 0];

  tokens(holds: string[]): void {
    for (const name of holdNames) this.say(name, holds.includes(name));
  }

  say(name: HoldName, held: boolean): void { this.held[name].say(held, this.time); }

  holds(name: HoldName): boolean { return this.held[name].state === 'held'; }

  get lost(): HoldName[] { return holdNames.filter(name => this.held[name].state === 'lost'); }

  // Without a name: whoever held is gone.
  lose(which: readonly HoldName[] = holdNames): void {
    for (const name of which) this.held[name].lose();
  }

  // The twin itself did not run for so long, s: tokens of that time wait to be read.
  stoodStill(gap: number): void {
    for (const name of holdNames) this.held[name].until += gap;
  }

  // Another page, which holds nothing yet.
  renew(): void { for (const name of holdNames) this.held[name].state = 'free'; }

  drive(command: Vec3): void { this.command = command; }

  // Of driving by hand, which no keep-out stops.
  get warning(): string {
    if (!this.holds('drive')) return '';
    const [x, y, yaw] = this.robot;
    const [vx, vy] = this.command;
    const ahead: Xy = [x + warnAhead * (vx * Math.cos(yaw) - vy * Math.sin(yaw)),
      y + warnAhead * (vx * Math.sin(yaw) + vy * Math.cos(yaw))];
    const into = (p: Xy) => this.obstacles.find(o => Math.hypot(p[0] - o.centre[0],
      p[1] - o.centre[1]) < Math.max(o.half[0], o.half[1]) + bodyRadius);
    const [now, next] = [into([x, y]), into(ahead)];
    return now ? `The base is in keep-out ${now.id}.`
      : next ? `Keep-out ${next.id} is ahead: driven by hand, nothing stops the base.` : '';
  }

  stop(): void {
    this.mode = 'ramp_down';
    this.cause = 'stop was pressed';
    this.drop();
    this.lose(['hand', 'drive']);
  }

  drop(): void {
    this.goal = null;
    this.path = [];
    this.off = -1;
    this.phase = 'idle';
  }

  setGoal(at: Xy, yaw: number | null): void {
    const end = this.outside(at);
    this.off = Math.hypot(end[0] - at[0], end[1] - at[1]);
    this.goal = { at: end, yaw };
    this.phase = 'driving';
    this.plan();
  }

  get short(): boolean { return this.off > arrival; }

  // The place nearest to a goal at which no keep-out is in the way.
  private outside(at: Xy): Xy {
    for (const o of this.obstacles) {
      const [dx, dy] = [at[0] - o.centre[0], at[1] - o.centre[1]];
      const away = Math.hypot(dx, dy);
      const clear = Math.max(o.half[0], o.half[1]) + bodyRadius + 0.05;
      if (away >= clear) continue;
      const f = away > 0 ? clear / away : 0;
      return away > 0 ? [o.centre[0] + dx * f, o.centre[1] + dy * f]
        : [o.centre[0] - clear, o.centre[1]];
    }
    return at;
  }

  // Round the first disc or box that stands in the way.
  plan(): void {
    if (!this.goal) return;
    const from: Xy = [this.robot[0], this.robot[1]];
    const to = this.goal.at;
    this.path = [from, to];
    const length = Math.hypot(to[0] - from[0], to[1] - from[1]);
    for (const o of this.obstacles) {
      const along = ((o.centre[0] - from[0]) * (to[0] - from[0])
        + (o.centre[1] - from[1]) * (to[1] - from[1])) / (length || 1);
      const side = ((to[0] - from[0]) * (o.centre[1] - from[1])
        - (to[1] - from[1]) * (o.centre[0] - from[0])) / (length || 1);
      const clear = Math.max(o.half[0], o.kind === 'box' ? o.half[1] : 0) + bodyRadius;
      if (along < 0 || along > length || Math.abs(side) > clear) continue;
      const away = (side > 0 ? -1 : 1) * (clear + 0.15) / (length || 1);
      this.path = [from, [o.centre[0] - (to[1] - from[1]) * away,
        o.centre[1] + (to[0] - from[0]) * away], to];
    }
  }

  step(dt: number): void {
    this.time += dt;
    for (const name of holdNames) this.held[name].expire(this.time);
    if (!this.linkUp) this.silence();
    if (this.mode === 'engaged' && !this.holds('engage')) {
      this.mode = 'hold';
      this.onEvent('engagement ended: it was no longer held', 'mode');
    }
    const wanted = this.wanted();
    for (let k = 0; k < 3; ++k) {
      const most = acceleration * dt * (k === 2 ? 2 : 1);
      this.velocity[k]! += Math.max(-most, Math.min(most, wanted[k]! - this.velocity[k]!));
    }
    const [vx, vy, wz] = this.velocity;
    const [c, s] = [Math.cos(this.robot[2]), Math.sin(this.robot[2])];
    this.robot = [this.robot[0] + dt * (c * vx - s * vy), this.robot[1] + dt * (s * vx + c * vy),
      this.robot[2] + dt * wz];
    for (let k = 0; k < 4; ++k) this.wheels[k]! += dt * vx / 0.0475;
    if (this.mode === 'ramp_down' && Math.hypot(...this.velocity) === 0) this.mode = 'hold';
    if (!this.holds('hand')) this.hand = null;
  }

  private silence(): void {
    if (this.mode === 'engaged' || this.mode === 'hold') {
      this.mode = 'ramp_down';
      this.cause = 'the link is silent';
    }
    this.velocity = [0, 0, 0];
  }

  private wanted(): Vec3 {
    if (!this.linkUp || this.mode === 'ramp_down') return [0, 0, 0];
    if (this.holds('drive')) return this.command;
    if (this.mode !== 'engaged' || !this.goal) return [0, 0, 0];
    const next = this.path[1] ?? this.goal.at;
    const [dx, dy] = [next[0] - this.robot[0], next[1] - this.robot[1]];
    const left = Math.hypot(dx, dy);
    if (left < (this.path.length > 2 ? 0.15 : reached)) {
      this.path.splice(1, 1);
      if (this.path.length < 2) {
        this.phase = this.short ? 'short of the goal' : 'arrived';
        this.goal = null;
        this.onEvent(this.phase, 'task');
        return [0, 0, 0];
      }
    }
    const speed = Math.min(cruise, 1.5 * left + 0.02);
    const [c, s] = [Math.cos(this.robot[2]), Math.sin(this.robot[2])];
    return [speed * (c * dx + s * dy) / (left || 1), speed * (c * dy - s * dx) / (left || 1), 0];
  }
}
