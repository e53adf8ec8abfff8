// What the twin makes of each intent: checked, done or refused with a reason.
import { Obstacle, SavedSession, SceneObject, Vec3 } from '../src/wire/types';
import { HoldName, Plant } from './plant';
import { Body } from './world';

export interface Intent { id: number; act: string; [key: string]: unknown }
export interface Reply { ok: boolean; why?: string; result?: object; quiet?: boolean }

interface Stroke { id: number; points: Vec3[] }

const done: Reply = { ok: true };
const refused = (why: string): Reply => ({ ok: false, why });

function vec(value: unknown, size = 3): value is Vec3 {
  return Array.isArray(value) && value.length === size
    && value.every(v => typeof v === 'number' && Number.isFinite(v) && Math.abs(v) < 100);
}

function finite(...values: unknown[]): boolean {
  return values.every(v => typeof v === 'number' && Number.isFinite(v));
}

export class Desk {
  readonly steps: Record<string, boolean> = { touch: false, mark: false, obstacle: false,
    object: false, stop: false };
  marks: Stroke[] = [];
  objects: SceneObject[] = [];
  marked: Vec3 | null = null;
  recording = false;
  device = { kind: 'mouse', state: 'ready', renders_force: false, scale: 1, clutch: false };
  haptic = false;  // a real device, whose place the page can not take
  mask: boolean[] = [];
  proposal = 0;
  private clicks = 0;
  private chosen = new Set<number>();
  private readonly undoable: { text: string; back: (() => void) | null }[] = [];  // null: it stays
  // One of a run before, of another map.
  sessions: SavedSession[] = [{ name: 'yesterday', saved: '2026-01-02T03:04:05Z', map: true,
    here: false }];
  private readonly kept = new Map<string, { obstacles: Obstacle[]; marks: Stroke[] }>();

  constructor(readonly plant: Plant, private readonly bodies: Body[],
    private readonly ids: () => Uint8Array, private readonly size: { width: number;
      height: number }, private readonly pictureAge: () => number,
    private readonly note: (text: string, kind: string) => void) {}

  take(intent: Intent): Reply {
    const acts: Record<string, (i: Intent) => Reply> = {
      token: i => this.token(i), hand: i => this.hand(i), drive: i => this.drive(i),
      engage: () => this.engage(), hold: () => this.hold(), clear: () => done,
      stop: () => this.stop(), cancel: () => { this.plant.drop(); return done; },
      mark: i => this.mark(i), go_to: i => this.goTo(i), select: i => this.select(i),
      accept: i => this.accept(i), draw: i => this.draw(i), erase: i => this.erase(i),
      forget: i => this.forget(i), unmark: i => this.unmark(i),
      undo: () => this.undo(), device: i => this.changeDevice(i),
      record: i => { this.recording = i.on === true; return done; },
      note: i => { this.note(String(i.text).slice(0, 200), 'note'); return done; },
      save: i => this.save(i), open: i => this.open(i),
      ask_role: () => done, give_role: () => done, take_role: () => done,
    };
    const act = acts[intent.act];
    if (!act) return refused(`no act ${intent.act}`);
    const reply = act(intent);
    if (!reply.quiet) {
      this.note(`${intent.act}: ${reply.ok ? 'done' : `refused, ${reply.why}`}`, 'act');
    }
    return reply;
  }

  stop(): Reply {
    this.plant.stop();
    this.steps.stop = true;
    return done;
  }

  private token(i: Intent): Reply {
    if (!Array.isArray(i.holds)) return refused('holds is a list');
    this.plant.tokens(i.holds as string[]);
    return { ok: true, quiet: true };
  }

  private hand(i: Intent): Reply {
    if (!vec(i.p) || !vec(i.normal)) return refused('a hand has p and normal');
    if (this.haptic) return refused('a haptic device is in its place');
    if (!this.plant.holds('hand')) return refused(this.notHeld('hand'));
    this.plant.hand = { p: i.p, normal: i.normal, press: i.press === true };
    if (i.press === true) this.steps.touch = true;
    return { ok: true, quiet: true };
  }

  private drive(i: Intent): Reply {
    if (!finite(i.vx, i.vy, i.wz)) return refused('speeds are numbers');
    if (!this.plant.holds('drive')) return refused(this.notHeld('drive'));
    if (this.pictureAge() > 1) return refused('the newest picture is old');
    this.plant.drive([i.vx as number, i.vy as number, i.wz as number]);
    return { ok: true, quiet: true };
  }

  private notHeld(name: HoldName): string {
    return this.plant.lost.includes(name) ? 'let go first, then press again' : 'nothing is held';
  }

  private engage(): Reply {
    this.plant.say('engage', true);
    if (!this.plant.holds('engage')) return refused(this.notHeld('engage'));
    if (!this.plant.linkUp) return refused('the link is silent');
    if (this.plant.mode === 'ramp_down') return refused('the base still ramps down');
    this.plant.mode = 'engaged';
    this.plant.cause = '';
    return done;
  }

  private hold(): Reply {
    if (this.plant.mode === 'engaged') this.plant.mode = 'hold';
    return done;
  }

  private mark(i: Intent): Reply {
    const points = i.points;
    if (!Array.isArray(points) || points.length < 1 || points.length > 128
      || !points.every(p => vec(p))) return refused('a mark has 1 to 128 points');
    const stroke = { id: (this.marks[this.marks.length - 1]?.id ?? 0) + 1,
      points: points as Vec3[] };
    this.marks.push(stroke);
    const middle = stroke.points[Math.floor(points.length / 2)]!;
    this.marked = middle;
    this.plant.setGoal([middle[0], middle[1]], null);
    this.steps.mark = true;
    this.undoable.push({ text: `mark ${stroke.id} and its goal are gone`, back: () => {
      this.marks = this.marks.filter(m => m !== stroke);
      this.marked = null;
      this.plant.drop();
    } });
    return done;
  }

  private unmark(i: Intent): Reply {
    const mark = this.marks.find(m => m.id === i.mark_id);
    if (!mark) return refused('no such mark is drawn');
    this.marks = this.marks.filter(m => m !== mark);
    this.undoable.push({ text: `mark ${mark.id} is drawn again`,
      back: () => { this.marks = [...this.marks, mark]; } });
    return done;
  }

  private forget(i: Intent): Reply {
    if (!vec(i.centre) || !vec(i.half)) return refused('a region has centre and half');
    this.undoable.push({ text: '', back: null });
    return done;
  }

  private goTo(i: Intent): Reply {
    if (!finite(i.x, i.y)) return refused('a place has x and y');
    const [x, y] = [i.x as number, i.y as number];
    if (x < -1 || x > 4 || Math.abs(y) > 2) return refused('the place is outside the map');
    this.marked = [x, y, 0];
    this.plant.setGoal([x, y], typeof i.yaw === 'number' ? i.yaw : null);
    this.undoable.push({ text: 'the goal is dropped', back: () => {
      this.marked = null;
      this.plant.drop();
    } });
    return done;
  }

  private select(i: Intent): Reply {
    if (!finite(i.u, i.v) || Math.abs(i.sign as number) !== 1) {
      return refused('a click has u, v and sign');
    }
    const { width, height } = this.size;
    const [u, v] = [i.u as number, i.v as number];
    const at = Math.min(height - 1, Math.floor(v * height)) * width
      + Math.min(width - 1, Math.floor(u * width));
    const id = this.ids()[at]!;
    if (i.new === true) {
      this.chosen = new Set();
      this.clicks = 0;
    }
    if (i.sign === 1) this.chosen.add(id);
    else this.chosen.delete(id);
    this.mask = [...this.ids()].map(pixel => this.chosen.has(pixel));
    ++this.proposal;
    const body = this.bodies.find(b => this.chosen.has(b.id));
    return { ok: true, result: { proposal: this.proposal, clicks: ++this.clicks,
      pixels: this.mask.filter(Boolean).length,
      ...(body ? { size_m: body.half.map(m => 2 * m) } : {}) } };
  }

  private accept(i: Intent): Reply {
    if (i.proposal !== this.proposal || this.chosen.size === 0) return refused('no such proposal');
    for (const id of this.chosen) {
      const b = this.bodies.find(body => body.id === id);
      if (!b) continue;
      this.objects.push({ id, serial: id, name: typeof i.name === 'string' ? i.name : b.name,
        centre: b.centre, extent: b.half.map(v => 2 * v) as Vec3, colour: b.colour, seen: true,
        quat: [Math.cos(b.yaw / 2), 0, 0, Math.sin(b.yaw / 2)] });
    }
    if (this.objects.length === 0) return refused('nothing was chosen that can be an object');
    this.steps.object = true;
    return done;
  }

  private draw(i: Intent): Reply {
    const o = i.obstacle as Obstacle;
    if (!o || !vec(o.centre) || !vec(o.half) || !finite(o.id, o.yaw) || o.id < 1 || o.id > 999) {
      return refused('an obstacle has id, kind, centre, half, yaw');
    }
    const before = this.plant.obstacles;
    this.plant.obstacles = [...before.filter(other => other.id !== o.id), o];
    this.undoable.push({ text: `keep-out ${o.id} is as before`,
      back: () => { this.plant.obstacles = before; } });
    this.plant.plan();
    this.steps.obstacle = true;
    return done;
  }

  private erase(i: Intent): Reply {
    const before = this.plant.obstacles;
    this.plant.obstacles = i.obstacle_id === 0 ? []
      : before.filter(o => o.id !== i.obstacle_id);
    if (before.length === this.plant.obstacles.length) return refused('there is none of this id');
    this.undoable.push({ text: 'the keep-outs are as before',
      back: () => { this.plant.obstacles = before; } });
    this.plant.plan();
    return done;
  }

  private undo(): Reply {
    const last = this.undoable.pop();
    if (!last) return refused('nothing to take back');
    if (!last.back) return refused('what is forgotten does not come back');
    last.back();
    return { ok: true, result: { text: `Undone: ${last.text}.` } };
  }

  private save(i: Intent): Reply {
    const name = String(i.name);
    if (this.sessions.some(s => s.name === name && !s.here)) {
      return refused(`${name} is a session of another map: choose another name`);
    }
    this.kept.set(name, { obstacles: this.plant.obstacles, marks: this.marks });
    this.sessions = [{ name, saved: new Date().toISOString(), map: false, here: true },
      ...this.sessions.filter(s => s.name !== name)];
    return { ok: true, result: { text: `Saved: ${this.plant.obstacles.length} keep-outs, `
      + `${this.marks.length} marks, 0 objects. The map follows when this run ends.` } };
  }

  private open(i: Intent): Reply {
    const kept = this.kept.get(String(i.name));
    if (!kept) return refused(`there is no saved session ${String(i.name)}`);
    if (this.plant.mode === 'engaged') return refused('hold first');
    this.plant.obstacles = kept.obstacles;
    this.marks = [...kept.marks];
    this.undoable.length = 0;
    this.plant.plan();
    return { ok: true, result: { text: `Opened: ${kept.obstacles.length} keep-outs.` } };
  }

  private changeDevice(i: Intent): Reply {
    if (typeof i.scale === 'number') {
      if (!(i.scale >= 0.1 && i.scale <= 20)) return refused('scale is 0.1 to 20');
      this.device.scale = i.scale;
    }
    if (typeof i.clutch === 'boolean') this.device.clutch = i.clutch;
    return done;
  }
}
