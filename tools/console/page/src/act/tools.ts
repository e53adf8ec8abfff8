// What a press, a drag and a release mean, by the tool in the hand. Pointer, touch screen, the
// keyboard's cross-hair and a headset's controller all come here.
import { Obstacle, Vec3 } from '../wire/types';
import { distance } from '../view/shapes';
import { ThingsLayer } from '../view/things_layer';
import { Acts } from './acts';
import { Aim, Aimer } from './aim';
import { Selecting } from './selecting';

export type ToolName = 'look' | 'touch' | 'mark' | 'object' | 'obstacle' | 'go' | 'forget';

interface Tool {
  act: string;  // the intent it needs
  down: (aim: Aim) => void;
  move: (aim: Aim) => void;
  up: (aim: Aim | null) => void;
  cancel: () => void;
}

const handPeriod = 16;     // ms: 60 Hz at most
const shortTouch = 300;    // ms: in less the hand gets nowhere
const markStep = 0.01;     // m between points of a stroke
const mostMark = 128;      // points
const headingDrag = 0.15;  // m: a longer drag of a goal is its heading
const rim = 0.75;          // of an obstacle's size: beyond, a drag resizes
const smallest = 0.05;     // m, half of an obstacle's size
const regionTop = 2;       // m above the floor that a forgotten region reaches

// A hand is where it was said last until it is let go, so a pointer that rests says nothing.
class TouchTool implements Tool {
  act = 'hand';
  private readonly ids = new Set<number>();  // said since the press
  private told = false;                      // that one was refused
  private began = 0;
  private sent = 0;
  private last: Aim | null = null;
  constructor(private readonly acts: Acts) {}

  down(aim: Aim): void {
    if (!aim.point) return;
    this.ids.clear();
    this.told = false;
    this.began = performance.now();
    this.acts.held.press('hand');
    this.send(aim, true);
    if (!aim.fused) this.acts.say('The map has no surface here yet: nothing may be felt.', 'news');
  }

  move(aim: Aim): void {
    if (!this.acts.held.awake() || !this.acts.held.has('hand')) return;
    if (performance.now() - this.sent >= handPeriod) this.send(aim, true);
  }

  up(aim: Aim | null): void {
    if (!this.acts.held.awake() || !this.acts.held.has('hand')) return;
    const end = aim ?? this.last;
    if (end) this.send(end, false);
    this.acts.held.release('hand');
    if (performance.now() - this.began < shortTouch) {
      this.acts.say('Hold to touch: the hand goes there while you press.', 'news');
    }
  }

  cancel(): void { this.acts.held.lose('the pointer was taken away', ['hand']); }

  // The touch is let go and that is told once, not 60 times a second. False: of no touch.
  wasRefused(id: number, why: string): boolean {
    if (!this.ids.has(id)) return false;
    if (this.acts.held.has('hand')) this.acts.held.lose(why, ['hand']);
    else if (!this.told) this.acts.say(`Refused: ${why}`, 'refused');
    this.told = true;
    return true;
  }

  private send(aim: Aim, press: boolean): void {
    if (!aim.point) return;
    this.last = aim;
    this.sent = performance.now();
    this.ids.add(this.acts.tell('hand', { p: aim.point, normal: aim.normal, press, button: false,
      clutch: false }));
  }
}

class MarkTool implements Tool {
  act = 'mark';
  private points: Vec3[] = [];
  private drawing = false;
  constructor(private readonly acts: Acts, private readonly things: ThingsLayer,
    private readonly changed: () => void) {}

  down(aim: Aim): void {
    if (!aim.point) return;
    this.drawing = true;
    this.points = [aim.point];
    this.show();
  }

  move(aim: Aim): void {
    if (!this.drawing || !aim.point) return;
    if (distance(aim.point, this.points[this.points.length - 1]!) < markStep) return;
    this.points.push(aim.point);
    this.show();
  }

  up(): void {
    if (this.drawing && this.points.length > 0) this.acts.mark(thinned(this.points));
    this.cancel();
  }

  cancel(): void {
    this.drawing = false;
    this.points = [];
    this.show();
  }

  private show(): void {
    this.things.drawStroke(this.points);
    this.changed();
  }
}

// At most 128 points, the first and the last among them.
export function thinned(points: Vec3[]): Vec3[] {
  if (points.length <= mostMark) return points;
  return Array.from({ length: mostMark }, (_, i) =>
    points[Math.round(i * (points.length - 1) / (mostMark - 1))]!);
}

class GoTool implements Tool {
  act = 'go_to';
  private from: Vec3 | null = null;
  constructor(private readonly acts: Acts, private readonly things: ThingsLayer,
    private readonly changed: () => void) {}

  down(aim: Aim): void { this.from = aim.floor; }

  move(aim: Aim): void {
    if (!this.from || !aim.floor) return;
    this.things.drawStroke([this.from, aim.floor]);
    this.changed();
  }

  up(aim: Aim | null): void {
    const from = this.from;
    const to = aim?.floor ?? from;
    this.cancel();
    if (!from || !to) return;
    const yaw = distance(from, to) > headingDrag
      ? Math.atan2(to[1] - from[1], to[0] - from[0]) : undefined;
    this.acts.goTo(from[0], from[1], yaw);
  }

  cancel(): void {
    this.from = null;
    this.things.clearDraft();
    this.changed();
  }
}

class ObstacleTool implements Tool {
  act = 'draw';
  kind: Obstacle['kind'] = 'disc';
  private draft: Obstacle | null = null;
  private from: Vec3 = [0, 0, 0];
  private before: Obstacle | null = null;  // as it was; null: a new one
  private resize = false;
  constructor(private readonly acts: Acts, private readonly things: ThingsLayer,
    private readonly aimer: Aimer, private readonly changed: () => void) {}

  down(aim: Aim): void {
    if (!aim.floor) return;
    this.from = aim.floor;
    const known = (this.acts.store.slow.obstacles ?? []).find(o => this.reaches(o, this.from));
    this.before = known ?? null;
    this.resize = known !== undefined && this.reach(known, this.from) > rim;
    const z = this.aimer.floorHeight;
    this.draft = known ? structuredClone(known) : { id: this.acts.nextObstacleId(),
      kind: this.kind, centre: [this.from[0], this.from[1], this.kind === 'box' ? z + 0.25 : z],
      half: [0.2, 0.2, 0.25], yaw: 0 };
    this.show();
  }

  move(aim: Aim): void {
    if (!this.draft || !aim.floor) return;
    const far = distance(aim.floor, this.from);
    if (!this.before) {
      if (far > smallest) this.size(far);
    } else if (this.resize) {
      this.size(Math.max(smallest, distance(aim.floor,
        [this.draft.centre[0], this.draft.centre[1], aim.floor[2]])));
    } else {
      this.draft.centre[0] = this.before.centre[0] + aim.floor[0] - this.from[0];
      this.draft.centre[1] = this.before.centre[1] + aim.floor[1] - this.from[1];
    }
    this.show();
  }

  up(): void {
    const draft = this.draft;
    const same = this.before && JSON.stringify(this.before) === JSON.stringify(draft);
    if (draft && same) this.things.choose({ kind: 'obstacle', id: draft.id });
    else if (draft) this.acts.draw(draft);
    this.cancel();
  }

  cancel(): void {
    this.draft = null;
    this.things.clearDraft();
    this.changed();
  }

  // 1 at its rim
  private reach(o: Obstacle, p: Vec3): number {
    const [dx, dy] = [p[0] - o.centre[0], p[1] - o.centre[1]];
    if (o.kind === 'disc') return Math.hypot(dx, dy) / o.half[0];
    const [c, s] = [Math.cos(o.yaw), Math.sin(o.yaw)];
    return Math.max(Math.abs(c * dx + s * dy) / o.half[0], Math.abs(c * dy - s * dx) / o.half[1]);
  }

  private reaches(o: Obstacle, p: Vec3): boolean { return this.reach(o, p) <= 1.1; }

  private size(half: number): void {
    this.draft!.half[0] = half;
    this.draft!.half[1] = half;
  }

  private show(): void {
    if (this.draft) this.things.drawObstacle(this.draft);
    this.changed();
  }
}

class ForgetTool implements Tool {
  act = 'forget';
  region: { centre: Vec3; half: Vec3 } | null = null;
  private from: Vec3 | null = null;
  constructor(private readonly things: ThingsLayer, private readonly changed: () => void) {}

  down(aim: Aim): void {
    this.from = aim.floor;
    this.move(aim);
  }

  move(aim: Aim): void {
    if (!this.from || !aim.floor) return;
    const [a, b] = [this.from, aim.floor];
    this.region = {
      centre: [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2, a[2] + regionTop / 2],
      half: [Math.max(0.1, Math.abs(a[0] - b[0]) / 2), Math.max(0.1, Math.abs(a[1] - b[1]) / 2),
        regionTop / 2],
    };
    this.things.drawRegion(this.region.centre, this.region.half);
    this.changed();
  }

  up(): void { this.from = null; }

  cancel(): void {
    this.from = null;
    this.region = null;
    this.things.clearDraft();
    this.changed();
  }
}

export class Tools {
  name: ToolName = 'look';
  readonly obstacle: ObstacleTool;
  readonly forget: ForgetTool;
  onChange: () => void = () => {};
  private readonly touch: TouchTool;
  private readonly tools: Partial<Record<ToolName, Tool>>;
  private active: Tool | null = null;

  constructor(private readonly acts: Acts, things: ThingsLayer, aimer: Aimer,
    readonly selecting: Selecting, changed: () => void) {
    const seen = () => { changed(); this.onChange(); };
    this.obstacle = new ObstacleTool(acts, things, aimer, changed);
    this.forget = new ForgetTool(things, seen);
    this.touch = new TouchTool(acts);
    this.tools = {
      touch: this.touch, mark: new MarkTool(acts, things, changed),
      go: new GoTool(acts, things, changed), obstacle: this.obstacle, forget: this.forget,
      object: {
        act: 'select', move: () => {}, up: () => {}, cancel: () => {},
        down: aim => selecting.clickPoint(aim.point ? aimer.inPicture(aim.point) : null),
      },
    };
  }

  choose(name: ToolName): void {
    this.cancel();
    if (name !== 'forget') this.forget.cancel();
    this.name = name;
    this.onChange();
  }

  // Why the tool can not be used now; null: it can.
  blocked(name: ToolName): string | null {
    const act = this.tools[name]?.act;
    if (!act) return null;
    if (this.acts.link.state !== 'open') return 'There is no connection to the box.';
    if (this.acts.store.slow.role === 'viewer') return 'Only the operator may act.';
    return this.acts.store.may(act) ? null : 'This run does not take it.';
  }

  down(aim: Aim): boolean {
    const tool = this.tools[this.name];
    if (!tool) return false;
    const why = this.blocked(this.name);
    if (why) {
      this.acts.say(why, 'refused');
      return false;
    }
    this.active = tool;
    tool.down(aim);
    return true;
  }

  move(aim: Aim): void { this.active?.move(aim); }

  up(aim: Aim | null): void {
    this.active?.up(aim);
    this.active = null;
  }

  cancel(): void {
    this.active?.cancel();
    this.active = null;
  }

  // An answer to none of its acts: false.
  wasRefused(id: number, why: string): boolean { return this.touch.wasRefused(id, why); }

  get busy(): boolean { return this.active !== null; }
}
