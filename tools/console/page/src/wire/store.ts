// What the page knows now: the newest of each view, and who wants to hear of a new one.
import {
  readCostMap, readHead, readJson, readMesh, readMoving, readPicture, readPose, readSelection,
} from './decode';
import {
  Answer, CostMap, Head, Kind, MeshDelta, Picture, Pose, Selection, Slow,
} from './types';

interface Topics {
  text: Slow;
  pose: Pose;
  mesh: MeshDelta;
  picture: Picture;
  costMap: CostMap;
  moving: [number, number][];
  answer: Answer;
  selection: Selection;
}

type Hear<T> = (value: T, head: Head) => void;

const newestOnly = new Set<number>([Kind.text, Kind.pose, Kind.picture, Kind.costMap,
  Kind.moving]);
const aheadSpan = 10;  // s

// This page's clock minus the box's: the least of the last 10 to 20 s, for the quickest message was
// late the least, and two clocks drift apart.
class Ahead {
  private since = -Infinity;
  private now = Infinity;
  private before = Infinity;

  see(here: number, there: number): void {
    if (here - this.since > aheadSpan) {
      this.before = this.now;
      this.now = Infinity;
      this.since = here;
    }
    this.now = Math.min(this.now, here - there);
  }

  forget(): void {
    this.since = -Infinity;
    this.now = this.before = Infinity;
  }

  least(): number { return Math.min(this.now, this.before); }
}

export class Store {
  slow: Slow = {};
  pose: Pose | null = null;
  picture: Picture | null = null;
  pictureHead: Head | null = null;
  costMap: CostMap | null = null;
  selection: Selection | null = null;
  selectionHead: Head | null = null;
  damaged = 0;   // views that could not be read
  messages = 0;
  private readonly ahead = new Ahead();
  private readonly waiting = new Map<number, { head: Head; bytes: ArrayBuffer }>();
  private readonly hearers: { [K in keyof Topics]?: Hear<Topics[K]>[] } = {};

  on<K extends keyof Topics>(topic: K, hear: Hear<Topics[K]>): void {
    const list = (this.hearers[topic] ??= []) as Hear<Topics[K]>[];
    list.push(hear);
  }

  // What is only worth its newest waits for flush(): a page that is slow leaves out what was
  // overtaken meanwhile, and does not lag behind by what piled up.
  take(bytes: ArrayBuffer): void {
    ++this.messages;
    this.guarded(() => {
      const head = readHead(bytes);
      this.ahead.see(performance.now() / 1000, head.time);
      if (newestOnly.has(head.kind)) this.waiting.set(head.kind, { head, bytes });
      else this.dispatch(head, bytes);
    });
  }

  flush(): void {
    const views = [...this.waiting.values()];
    this.waiting.clear();
    for (const { head, bytes } of views) this.guarded(() => this.dispatch(head, bytes));
  }

  // A new connection may be to a box that was started again: its clock begins anew.
  reconnected(): void {
    this.ahead.forget();
    this.pictureHead = null;
  }

  // Seconds since the picture was exposed, by the least delay seen; infinite without a picture.
  pictureAge(): number {
    const head = this.pictureHead;
    if (!head || head.data < 0) return Infinity;
    return Math.max(0, performance.now() / 1000 - this.ahead.least() - head.data);
  }

  // Seconds since a view was made, beyond the least delay seen.
  behind(head: Head): number {
    return performance.now() / 1000 - this.ahead.least() - head.time;
  }

  may(act: string): boolean {
    return this.slow.role !== 'viewer' && (!this.slow.can || this.slow.can.includes(act));
  }

  private guarded(read: () => void): void {
    try {
      read();
    } catch (error) {
      ++this.damaged;
      console.warn('a view that can not be read', error);
    }
  }

  private dispatch(head: Head, bytes: ArrayBuffer): void {
    switch (head.kind) {
      case Kind.text:
        this.say('text', this.slow = readJson<Slow>(bytes), head);
        break;
      case Kind.pose:
        this.say('pose', this.pose = readPose(bytes), head);
        break;
      case Kind.mesh:
        this.say('mesh', readMesh(bytes), head);
        break;
      case Kind.picture:
        this.picture = readPicture(bytes);
        this.pictureHead = head;
        this.say('picture', this.picture, head);
        break;
      case Kind.costMap:
        this.say('costMap', this.costMap = readCostMap(bytes), head);
        break;
      case Kind.moving:
        this.say('moving', readMoving(bytes), head);
        break;
      case Kind.answer:
        this.say('answer', readJson<Answer>(bytes), head);
        break;
      case Kind.selection:
        this.selectionHead = head;
        this.say('selection', this.selection = readSelection(bytes), head);
        break;
      default:  // of a later version of the box: not an error
    }
  }

  private say<K extends keyof Topics>(topic: K, value: Topics[K], head: Head): void {
    for (const hear of (this.hearers[topic] ?? []) as Hear<Topics[K]>[]) hear(value, head);
  }
}
