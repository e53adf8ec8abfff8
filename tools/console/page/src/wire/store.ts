// What the page knows now: the newest of each view, and who wants to hear of a new one.
import { BoxClock } from './box_clock';
import {
  headBytes, readCostMap, readHead, readJson, readMesh, readMoving, readPicture, readPose,
  readSelection,
} from './decode';
import { Standing } from './standing';
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
const depthOnly = -1;  // a picture without colour, beside the kinds
const colourKindAt = headBytes + 84;

// A picture without colour does not overtake one with it: on a slow page there would be none.
function placeOf(kind: number, bytes: ArrayBuffer): number {
  if (kind !== Kind.picture || bytes.byteLength <= colourKindAt) return kind;
  return new DataView(bytes).getUint8(colourKindAt) === 1 ? kind : depthOnly;
}

export class Store {
  slow: Slow = {};
  pose: Pose | null = null;
  picture: Picture | null = null;
  readonly standing = new Standing();  // the camera of the pictures
  costMap: CostMap | null = null;
  moving: [number, number][] = [];
  selection: Selection | null = null;
  selectionHead: Head | null = null;
  damaged = 0;   // views that could not be read
  messages = 0;
  readonly clock = new BoxClock();
  private heads = new WeakSet<Head>();  // of this connection
  private readonly waiting = new Map<number, { head: Head; bytes: ArrayBuffer }>();
  private readonly hearers: { [K in keyof Topics]?: Hear<Topics[K]>[] } = {};

  constructor(private readonly now = () => performance.now() / 1000) {}

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
      head.made = this.clock.madeAfter(head.time, this.now(), this.slow.clock !== 'real');
      this.heads.add(head);
      if (!newestOnly.has(head.kind)) {
        this.dispatch(head, bytes);
        return;
      }
      const place = placeOf(head.kind, bytes);
      if (place === Kind.picture) this.waiting.delete(depthOnly);
      this.waiting.set(place, { head, bytes });
    });
  }

  flush(): void {
    const views = [...this.waiting.values()];
    this.waiting.clear();
    for (const { head, bytes } of views) this.guarded(() => this.dispatch(head, bytes));
  }

  // A new connection may be to a box that was started again: its clock begins anew.
  reconnected(): void {
    this.clock.forget();
    this.heads = new WeakSet();
    this.picture = null;
    this.standing.forget();
  }

  // Seconds since a picture was exposed, at most: how old it was for the box when it was sent, and
  // what has passed since then. Infinite where that is not known.
  age(head: Head | null): number {
    if (!head || head.data < 0 || !this.heads.has(head)) return Infinity;
    return Math.max(0, head.time - head.data) + this.behind(head);
  }

  // Seconds since a view was made, at most.
  behind(head: Head): number { return this.now() - head.made; }

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
        this.standing.take(this.picture.camera, head.data);
        this.say('picture', this.picture, head);
        break;
      case Kind.costMap:
        this.say('costMap', this.costMap = readCostMap(bytes), head);
        break;
      case Kind.moving:
        this.say('moving', this.moving = readMoving(bytes), head);
        break;
      case Kind.answer:
        this.answered(readJson<Answer>(bytes), head);
        break;
      case Kind.selection:
        this.selectionHead = head;
        this.say('selection', this.selection = readSelection(bytes), head);
        break;
      default:  // of a later version of the box: not an error
    }
  }

  private answered(answer: Answer, head: Head): void {
    const asked = answer.result?.t;  // of a token
    if (typeof asked === 'number') this.clock.heard(asked, head.time, this.now());
    else this.say('answer', answer, head);
  }

  private say<K extends keyof Topics>(topic: K, value: Topics[K], head: Head): void {
    for (const hear of (this.hearers[topic] ?? []) as Hear<Topics[K]>[]) hear(value, head);
  }
}
