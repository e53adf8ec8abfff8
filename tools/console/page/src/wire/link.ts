// The road to the box: the session by its cookie, the WebSocket, acts and their answers, the stop.
// The page dials again by itself when the socket is lost, except where the box says that this
// session goes on in another window (close code 4001).
import { Answer } from './types';

export type LinkState = 'starting' | 'open' | 'lost' | 'refused' | 'elsewhere';

export interface LinkEvents {
  onView: (bytes: ArrayBuffer) => void;
  onState: (state: LinkState, why: string) => void;
}

interface Waiting {
  sent: number;
  done: (answer: Answer) => void;
}

const elsewhere = 4001;
const firstDelay = 300;    // ms until the first new dial, doubled each time
const longestDelay = 5000;
const answerLimit = 5000;  // ms; a later answer is shown as news
const mostKept = 512;      // ms of answers, for their percentile

async function post(path: string, body: object): Promise<Response> {
  return fetch(path, {
    method: 'POST', credentials: 'same-origin', headers: { 'Content-Type': 'application/json' },
    body: JSON.stringify(body), keepalive: true,
  });
}

export class Link {
  state: LinkState = 'starting';
  role = '';
  readonly answerTimes: number[] = [];  // ms, the newest ones
  private socket: WebSocket | null = null;
  private delay = firstDelay;
  private nextId = 1;
  private readonly waiting = new Map<number, Waiting>();

  constructor(private readonly events: LinkEvents) {}

  async start(): Promise<void> {
    try {
      const code = new URLSearchParams(location.hash.slice(1)).get('code');
      if (code) {
        // Out of the address bar and the history before anything else can read it.
        history.replaceState(null, '', location.pathname);
        const answer = await post('/session', { code });
        if (answer.ok) this.role = (await answer.json() as { role: string }).role;
      }
      const session = await fetch('/session', { credentials: 'same-origin' });
      if (!session.ok) {
        this.change('refused', 'This page has no session: its code is used up or wrong. '
          + 'Open the link that the box printed, or ask for a new one.');
        return;
      }
      this.role = (await session.json() as { role: string }).role;
      this.dial();
    } catch {
      this.later();
    }
  }

  dial(): void {
    const scheme = location.protocol === 'https:' ? 'wss' : 'ws';
    const socket = new WebSocket(`${scheme}://${location.host}/ws`, 'teletact.1');
    socket.binaryType = 'arraybuffer';
    socket.onopen = () => {
      this.delay = firstDelay;
      this.nextId = 1;
      this.change('open', '');
    };
    socket.onmessage = event => {
      if (event.data instanceof ArrayBuffer) this.events.onView(event.data);
    };
    socket.onclose = event => this.closed(socket, event.code);
    this.socket = socket;
  }

  // Resolves with the box's answer; a lost socket or a silence is a refusal with that reason.
  act(act: string, keys: object = {}): Promise<Answer> {
    const id = this.nextId++;
    return new Promise(done => {
      if (!this.write({ id, act, ...keys })) {
        done({ id, ok: false, why: 'no connection to the box' });
        return;
      }
      this.waiting.set(id, { sent: performance.now(), done });
      setTimeout(() => this.settle({ id, ok: false, why: 'the box did not answer in 5 s' }),
        answerLimit);
    });
  }

  // What is not answered, or only when refused: token, hand, drive. Returns its id.
  tell(act: string, keys: object): number {
    const id = this.nextId++;
    this.write({ id, act, ...keys });
    return id;
  }

  // Beside the WebSocket and its queue. Both ways are tried: one of them may be what is broken.
  async stop(): Promise<boolean> {
    this.write({ id: this.nextId++, act: 'stop' });
    try {
      return (await post('/stop', {})).ok;
    } catch {
      return false;
    }
  }

  async viewLink(): Promise<string | null> {
    const answer = await post('/view-link', {});
    if (!answer.ok) return null;
    return `${location.origin}/#code=${(await answer.json() as { code: string }).code}`;
  }

  // True: somebody waited for it.
  settle(answer: Answer): boolean {
    const waiting = this.waiting.get(answer.id);
    if (!waiting) return false;
    this.waiting.delete(answer.id);
    this.answerTimes.push(performance.now() - waiting.sent);
    if (this.answerTimes.length > mostKept) this.answerTimes.shift();
    waiting.done(answer);
    return true;
  }

  private write(message: object): boolean {
    if (this.socket?.readyState !== WebSocket.OPEN) return false;
    this.socket.send(JSON.stringify(message));
    return true;
  }

  private closed(socket: WebSocket, code: number): void {
    if (socket !== this.socket) return;
    this.socket = null;
    for (const id of [...this.waiting.keys()]) {
      this.settle({ id, ok: false, why: 'the connection was lost before the answer' });
    }
    if (code === elsewhere) {
      this.change('elsewhere', 'This session goes on in another window.');
      return;
    }
    this.later();
  }

  private later(): void {
    this.change('lost', 'No connection to the box. Trying again.');
    setTimeout(() => void this.start(), this.delay);
    this.delay = Math.min(longestDelay, 2 * this.delay);
  }

  private change(state: LinkState, why: string): void {
    this.state = state;
    this.events.onState(state, why);
  }
}
