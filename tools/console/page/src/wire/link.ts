// The road to the box: the session by its cookie, the WebSocket, acts and their answers, the stop.
// The page dials again by itself when the socket is lost, except where the box says that this
// session goes on in another window (close code 4001). A link with a code that is pasted into the
// open page counts as it does where the page begins.
import { Answer } from './types';

export type LinkState = 'starting' | 'open' | 'lost' | 'refused' | 'elsewhere';

export interface LinkEvents {
  onView: (bytes: ArrayBuffer) => void;
  onState: (state: LinkState, why: string) => void;
  onLate: (act: string, answer: Answer, after: number) => void;  // s; it was given up before
}

interface Waiting {
  act: string;
  sent: number;
  done: (answer: Answer) => void;
  timer: ReturnType<typeof setTimeout>;
}

const elsewhere = 4001;
const firstDelay = 300;    // ms until the first new dial, doubled each time
const longestDelay = 5000;
const answerLimit = 5000;  // ms; a later answer is told as news
const stopLimit = 1000;    // ms until a stop counts as not arrived
const enoughDials = 2;     // that did not open until a person is told
const publicOption = '--console-public';  // in the box's words where it refuses an address
const mostLate = 64;       // acts whose late answer is still known
const mostKept = 512;      // ms of answers, for their percentile
const bulk = [3, 4, 5, 6]; // kinds of which the box wants to know that they were seen
const seenGap = 25;        // ms at least between two words of that

// The folder of the page, wherever a proxy has put it.
function base(): URL { return new URL('.', location.href); }

async function post(path: string, body: object, longest?: number): Promise<Response> {
  return fetch(new URL(path, base()), {
    method: 'POST', credentials: 'same-origin', headers: { 'Content-Type': 'application/json' },
    body: JSON.stringify(body), keepalive: true,
    ...(longest ? { signal: AbortSignal.timeout(longest) } : {}),
  });
}

// As soon as one of them is true.
function any(asked: Promise<boolean>[]): Promise<boolean> {
  return Promise.any(asked.map(async one => await one || Promise.reject()))
    .then(() => true, () => false);
}

export class Link {
  state: LinkState = 'starting';
  role = '';
  readonly answerTimes: number[] = [];  // ms, the newest ones
  private socket: WebSocket | null = null;
  private delay = firstDelay;
  private nextId = 1;
  private readonly waiting = new Map<number, Waiting>();
  private readonly late = new Map<number, { act: string; sent: number }>();
  private again: ReturnType<typeof setTimeout> | undefined;
  private starts = 0;
  private unopened = 0;  // WebSockets in a row that never opened, though the session is good
  private seen = 0;  // bytes of bulk views since the socket stands
  private seenTold = -Infinity;
  private seenTimer: ReturnType<typeof setTimeout> | undefined;

  constructor(private readonly events: LinkEvents) {}

  watchAddress(): void {
    addEventListener('hashchange', () => {
      if (!new URLSearchParams(location.hash.slice(1)).has('code')) return;
      this.change('starting', 'Connecting with the new link.');
      void this.start();
    });
  }

  async start(): Promise<void> {
    clearTimeout(this.again);
    const mine = ++this.starts;  // a later start is in its place
    try {
      const code = new URLSearchParams(location.hash.slice(1)).get('code');
      if (code) {
        // Out of the address bar and the history before anything else can read it.
        history.replaceState(null, '', location.pathname + location.search);
        const answer = await post('session', { code });
        if (answer.ok) this.role = (await answer.json() as { role: string }).role;
        else if ((await answer.text()).includes(publicOption)) {
          this.change('refused', "The box does not know this page's address: a tunnel or a proxy "
            + `lies between. Start the box with ${publicOption} ${base()}`);
          return;
        }
      }
      const session = await fetch(new URL('session', base()), { credentials: 'same-origin' });
      if (mine !== this.starts) return;
      if (!session.ok) {
        this.change('refused', 'This page has no session: its code is used up or wrong. '
          + 'Open the link that the box printed, or ask for a new one.');
        return;
      }
      this.role = (await session.json() as { role: string }).role;
      this.dial();
    } catch {
      this.unopened = 0;  // the box itself does not answer
      if (mine === this.starts) this.later();
    }
  }

  private dial(): void {
    this.hangUp();
    const way = new URL('ws', base());
    way.protocol = location.protocol === 'https:' ? 'wss:' : 'ws:';
    const socket = new WebSocket(way, 'teletact.1');
    ++this.unopened;
    socket.binaryType = 'arraybuffer';
    socket.onopen = () => {
      if (socket !== this.socket) return;
      this.delay = firstDelay;
      this.unopened = 0;
      this.nextId = 1;
      this.seen = 0;
      this.change('open', '');
    };
    socket.onmessage = event => {
      if (socket !== this.socket || !(event.data instanceof ArrayBuffer)) return;
      try {
        this.events.onView(event.data);
      } finally {
        this.saw(event.data);
      }
    };
    socket.onclose = event => this.closed(socket, event.code);
    this.socket = socket;
  }

  // Once a view is taken in: until it is told, the box holds the next ones back, newest wins. So a
  // page that is slow is behind by what it is at work on, not by what waits in sockets.
  private saw(view: ArrayBuffer): void {
    if (!bulk.includes(new Uint8Array(view, 0, 1)[0]!)) return;
    this.seen += view.byteLength;
    if (this.seenTimer !== undefined) return;
    const wait = this.seenTold + seenGap - performance.now();
    if (wait <= 0) this.tellSeen();
    else this.seenTimer = setTimeout(() => this.tellSeen(), wait);
  }

  private tellSeen(): void {
    clearTimeout(this.seenTimer);
    this.seenTimer = undefined;
    if (this.seen === 0) return;  // of a socket that is gone
    this.seenTold = performance.now();
    this.tell('seen', { bytes: this.seen });
  }

  // Resolves with the box's answer; a lost socket or a silence is a refusal with that reason.
  act(act: string, keys: object = {}, longest = answerLimit): Promise<Answer> {
    const id = this.nextId++;
    return new Promise(done => {
      if (!this.write({ id, act, ...keys })) {
        done({ id, ok: false, why: 'no connection to the box' });
        return;
      }
      const timer = setTimeout(() => this.giveUp(id, longest), longest);
      this.waiting.set(id, { act, sent: performance.now(), done, timer });
    });
  }

  // What is not answered, or only when refused: token, hand, drive. Returns its id.
  tell(act: string, keys: object): number {
    const id = this.nextId++;
    this.write({ id, act, ...keys });
    return id;
  }

  // By the WebSocket and beside it: one of them may be what is broken. True: the box has answered
  // on one of them; false: on none, for a second.
  async stop(): Promise<boolean> {
    return any([this.act('stop', {}, stopLimit).then(answer => answer.ok),
      post('stop', {}, stopLimit).then(answer => answer.ok, () => false)]);
  }

  async viewLink(): Promise<string | null> {
    const answer = await post('view-link', {});
    if (!answer.ok) return null;
    return `${base()}#code=${(await answer.json() as { code: string }).code}`;
  }

  // True: somebody waits for it, or has waited.
  settle(answer: Answer): boolean {
    const late = this.late.get(answer.id);
    if (late) {
      this.late.delete(answer.id);
      this.events.onLate(late.act, answer, (performance.now() - late.sent) / 1000);
      return true;
    }
    const waiting = this.waiting.get(answer.id);
    if (!waiting) return false;
    this.waiting.delete(answer.id);
    clearTimeout(waiting.timer);
    this.answerTimes.push(performance.now() - waiting.sent);
    if (this.answerTimes.length > mostKept) this.answerTimes.shift();
    waiting.done(answer);
    return true;
  }

  private giveUp(id: number, after: number): void {
    const { act, sent } = this.waiting.get(id)!;
    this.settle({ id, ok: false, why: `the box did not answer in ${after / 1000} s` });
    this.late.set(id, { act, sent });
    if (this.late.size > mostLate) this.late.delete(this.late.keys().next().value!);
  }

  private write(message: object): boolean {
    if (this.socket?.readyState !== WebSocket.OPEN) return false;
    this.socket.send(JSON.stringify(message));
    return true;
  }

  private closed(socket: WebSocket, code: number): void {
    if (socket !== this.socket) return;
    this.hangUp();
    if (code === elsewhere) {
      this.change('elsewhere', 'This session goes on in another window.');
      return;
    }
    this.later();
  }

  // Ids begin anew with the next connection: nothing of this one may settle one of that.
  private hangUp(): void {
    const old = this.socket;
    this.socket = null;
    old?.close();
    this.late.clear();
    for (const id of [...this.waiting.keys()]) {
      this.settle({ id, ok: false, why: 'the connection was lost before the answer' });
    }
  }

  private later(): void {
    this.change('lost', this.unopened < enoughDials ? 'No connection to the box. Trying again.'
      : 'The box answers, but its WebSocket does not open: a proxy on the way does not pass it on, '
        + 'or too many look on. Trying again.');
    clearTimeout(this.again);
    this.again = setTimeout(() => void this.start(), this.delay);
    this.delay = Math.min(longestDelay, 2 * this.delay);
  }

  private change(state: LinkState, why: string): void {
    this.state = state;
    this.events.onState(state, why);
  }
}
