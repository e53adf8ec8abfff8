// A twin of the operator's box: the protocol of docs/console_protocol.md over a small synthetic
// room, so that the page can be tried and tested alone. `intents` keeps what the page asked for.
import { createHash, randomBytes } from 'node:crypto';
import { readFileSync } from 'node:fs';
import { createServer, IncomingMessage, Server, ServerResponse } from 'node:http';
import { AddressInfo } from 'node:net';
import { extname, join, normalize } from 'node:path';
import { WebSocket, WebSocketServer } from 'ws';
import { Vec3 } from '../src/wire/types';
import { Desk, Intent } from './desk';
import { bits, cutBlocks, floats, lens, meshBody, recoloured, shoot, Shot, view } from './encode';
import { Plant } from './plant';
import { Way } from './way';
import { Body, makeBodies } from './world';

const types: Record<string, string> = { '.html': 'text/html', '.js': 'text/javascript',
  '.css': 'text/css', '.svg': 'image/svg+xml', '.txt': 'text/plain' };
const mostEvents = 100;
const keptIntents = 5000;
const stall = 50;  // ms between two ticks
const blocksAMessage = 120;
const mostWaiting = 65536;  // bytes of a socket beyond which views are left out
const cameraMount = { forward: -0.2, up: 0.95, pitch: 25 * Math.PI / 180 };

interface Session { role: 'operator' | 'viewer'; socket: WebSocket | null }

function quaternionOf(yaw: number, pitch: number): number[] {
  // From axes of the camera: z along the view, x to the right, y down.
  const half = (a: number) => [Math.cos(a / 2), Math.sin(a / 2)] as const;
  const multiply = (a: number[], b: number[]): number[] => [
    a[0]! * b[0]! - a[1]! * b[1]! - a[2]! * b[2]! - a[3]! * b[3]!,
    a[0]! * b[1]! + a[1]! * b[0]! + a[2]! * b[3]! - a[3]! * b[2]!,
    a[0]! * b[2]! - a[1]! * b[3]! + a[2]! * b[0]! + a[3]! * b[1]!,
    a[0]! * b[3]! + a[1]! * b[2]! - a[2]! * b[1]! + a[3]! * b[0]!];
  const [cy, sy] = half(yaw);
  const [cp, sp] = half(-pitch);
  return multiply(multiply([cy, 0, 0, sy], [0.5, -0.5, 0.5, -0.5]), [cp, sp, 0, 0]);
}

export class TwinBox {
  readonly bodies: Body[];
  readonly plant = new Plant();
  readonly way = new Way();
  readonly desk: Desk;
  readonly intents: Intent[] = [];
  pictures = true;     // off: the camera's picture freezes
  colour: 'each' | 'third' | 'none' | 'broken' = 'each';
  hangPosts = false;   // no POST is answered
  tellsLost = true;    // which holds have ended without being let go
  stops = 0;
  private held: (() => void)[] | null = null;  // answers that are kept back
  clock: 'real' | 'paced' = 'real';
  private shot: Shot = { body: Buffer.alloc(0), ids: new Uint8Array(lens.width * lens.height) };
  private shotTime = -1;
  private sent = 0;    // pictures
  private shotFrom = '';
  private eye: Vec3 = [0, 0, 1];
  private turn: number[] = [1, 0, 0, 0];
  private readonly events: { t: number; kind: string; text: string }[] = [];
  private readonly sequences = new Map<number, number>();
  private readonly sessions = new Map<string, Session>();
  private readonly codes = new Map<string, 'operator' | 'viewer'>();
  private readonly server: Server;
  private readonly sockets = new WebSocketServer({ noServer: true, maxPayload: 4096 });
  private readonly timers: ReturnType<typeof setInterval>[] = [];
  // Bytes of large views, and what the page said of them.
  private readonly bulk = new WeakMap<WebSocket, { sent: number; seen: number }>();
  private last = performance.now();

  constructor(private readonly site: string, seed = 1) {
    this.bodies = makeBodies(seed);
    this.desk = new Desk(this.plant, this.bodies, () => this.shot.ids, lens,
      () => this.plant.time - this.shotTime, (text, kind) => this.note(text, kind));
    this.plant.onEvent = (text, kind) => this.note(text, kind);
    this.server = createServer((request, response) => {
      if (this.hangPosts && request.method === 'POST') return;
      this.whenUp(() => void this.answer(request, response));
    });
    this.server.on('upgrade', (request, socket, head) => {
      const session = this.sessionOf(request);
      if (!session || this.way.inside(request) !== '/ws' || !this.way.goodOrigin(request)) {
        socket.end('HTTP/1.1 403 Forbidden\r\n\r\n');
        return;
      }
      this.sockets.handleUpgrade(request, socket, head, ws => this.join(ws, session));
    });
  }

  async listen(port = 0): Promise<string> {
    await new Promise<void>(done => this.server.listen(port, '127.0.0.1', done));
    this.way.host = `127.0.0.1:${(this.server.address() as AddressInfo).port}`;
    this.timers.push(setInterval(() => this.tick(), 10), setInterval(() => this.sendPose(), 50),
      setInterval(() => this.sendPicture(), 125), setInterval(() => this.sendText(), 200),
      setInterval(() => this.sendCost(), 1000));
    return this.url();
  }

  url(role: 'operator' | 'viewer' = 'operator'): string {
    const code = randomBytes(12).toString('hex');
    this.codes.set(code, role);
    return `${this.way.known ?? `http://${this.way.host}/`}#code=${code}`;
  }

  async close(): Promise<void> {
    for (const timer of this.timers) clearInterval(timer);
    for (const socket of this.sockets.clients) socket.terminate();
    this.server.closeAllConnections();
    await new Promise(done => this.server.close(done));
  }

  // As if the box hung: it takes and says nothing; then all that came is taken, late.
  hang(): void { this.held ??= []; }
  goOn(): void {
    const waiting = this.held ?? [];
    this.held = null;
    for (const run of waiting) run();
  }

  // As if the box were gone for a moment.
  dropSockets(): void { for (const socket of this.sockets.clients) socket.terminate(); }

  count(act: string): number { return this.intents.filter(i => i.act === act).length; }

  newest(act: string): Intent | undefined {
    return [...this.intents].reverse().find(i => i.act === act);
  }

  note(text: string, kind: string): void {
    this.events.push({ t: this.plant.time, kind, text });
    if (this.events.length > mostEvents) this.events.shift();
  }

  private whenUp(run: () => void): void {
    if (this.held) this.held.push(run);
    else run();
  }

  private tick(): void {
    const now = performance.now();
    if (now - this.last > stall) this.plant.stoodStill((now - this.last) / 1000);
    // A stretch in which this process did not run is made of small steps, as it would have been.
    for (let left = (now - this.last) / 1000; left > 0; left -= 0.01) {
      this.plant.step(Math.min(0.01, left));
    }
    this.last = now;
  }

  private sessionOf(request: IncomingMessage): Session | undefined {
    const cookie = /(?:^|; )teletact=([0-9a-f]+)/.exec(request.headers.cookie ?? '')?.[1];
    return cookie ? this.sessions.get(cookie) : undefined;
  }

  private async answer(request: IncomingMessage, response: ServerResponse): Promise<void> {
    response.setHeader('Content-Security-Policy', "default-src 'self'");
    response.setHeader('X-Content-Type-Options', 'nosniff');
    response.setHeader('Cache-Control', 'no-store');
    const say = (status: number, body: object) => {
      response.writeHead(status, { 'Content-Type': 'application/json' });
      response.end(JSON.stringify(body));
    };
    const path = this.way.inside(request);
    const session = this.sessionOf(request);
    if (!this.way.goodHost(request)) say(421, { why: '--console-public' });
    else if (request.method === 'POST' && !this.way.goodOrigin(request)) {
      say(403, { why: '--console-public' });
    } else if (request.method === 'POST') {
      const chunks: Buffer[] = [];
      for await (const chunk of request) chunks.push(chunk as Buffer);
      const body = JSON.parse(Buffer.concat(chunks).toString() || '{}') as { code?: string };
      if (path === '/session') this.exchange(body.code ?? '', request, response, say);
      else if (!session) say(401, {});
      else if (path === '/stop') {
        ++this.stops;
        this.desk.stop();
        this.note('stop', 'stop');
        say(200, {});
      } else if (path === '/view-link' && session.role === 'operator') {
        say(200, { code: new URL(this.url('viewer')).hash.slice(6) });
      } else say(403, {});
    } else if (path === '/session') {
      if (session) say(200, { role: session.role });
      else say(401, {});
    } else this.file(path, response);
  }

  private exchange(code: string, request: IncomingMessage, response: ServerResponse,
    say: (status: number, body: object) => void): void {
    const role = this.codes.get(code);
    if (!role) {
      say(403, {});
      return;
    }
    this.codes.delete(code);
    const cookie = createHash('sha256').update(code + randomBytes(8)).digest('hex');
    this.sessions.set(cookie, { role, socket: null });
    response.setHeader('Set-Cookie',
      `teletact=${cookie}; HttpOnly; SameSite=Strict; ${this.way.cookieEnd(request)}`);
    say(200, { role });
  }

  private file(path: string, response: ServerResponse): void {
    const name = normalize(path === '/' ? '/index.html' : path);
    try {
      const bytes = readFileSync(join(this.site, name));
      response.writeHead(200, { 'Content-Type': types[extname(name)] ?? 'text/plain' });
      response.end(bytes);
    } catch {
      response.writeHead(404);
      response.end();
    }
  }

  private join(socket: WebSocket, session: Session): void {
    session.socket?.close(4001, 'this session goes on elsewhere');
    session.socket = socket;
    this.bulk.set(socket, { sent: 0, seen: 0 });
    if (session.role === 'operator') this.plant.renew();
    socket.on('close', () => {
      if (session.role === 'operator' && session.socket === socket) this.plant.lose();
    });
    socket.on('message', data => this.whenUp(() => this.intent(socket, session, String(data))));
    const cells = cutBlocks(this.bodies);
    for (let i = 0; i < cells.length; i += blocksAMessage) {
      const body = meshBody(cells.slice(i, i + blocksAMessage), i / blocksAMessage + 1, i === 0);
      this.sendOne(socket, this.made(3, body, this.plant.time));
    }
    this.sendText();
  }

  private intent(socket: WebSocket, session: Session, text: string): void {
    let intent: Intent;
    try {
      intent = JSON.parse(text) as Intent;
    } catch {
      return;
    }
    if (intent.act === 'token' && typeof intent.t === 'number') {
      const echo = { id: intent.id, ok: true, result: { t: intent.t } };
      socket.send(this.made(7, Buffer.from(JSON.stringify(echo)), -1));
    }
    if (intent.act === 'seen') {
      this.bulk.get(socket)!.seen = intent.bytes as number;
      return;
    }
    const idle = intent.act === 'token' && (intent.holds as string[])?.length === 0;
    if (!idle) this.intents.push(intent);
    if (this.intents.length > keptIntents) this.intents.shift();
    if (session.role === 'viewer' && idle) return;
    const reply = session.role === 'viewer' && intent.act !== 'stop'
      ? { ok: false, why: 'only the operator may act', quiet: false } : this.desk.take(intent);
    if (reply.quiet) return;
    socket.send(this.made(7, Buffer.from(JSON.stringify({ id: intent.id, ...reply })), -1));
    if (intent.act === 'select' && reply.ok) {
      const head = Buffer.alloc(8);
      head.writeUInt16LE(lens.width, 0);
      head.writeUInt16LE(lens.height, 2);
      head.writeUInt32LE(this.desk.proposal, 4);
      socket.send(this.made(8, Buffer.concat([head, bits(this.desk.mask)]), this.shotTime));
    }
  }

  private made(kind: number, body: Buffer, data: number): Buffer {
    const sequence = (this.sequences.get(kind) ?? 0) + 1;
    this.sequences.set(kind, sequence);
    const sincePlant = (performance.now() - this.last) / 1000;
    return view(kind, sequence, this.plant.time + sincePlant, data, body);
  }

  private send(kind: number, body: Buffer, data: number): void {
    if (this.held) return;
    const bytes = this.made(kind, body, data);
    for (const socket of this.sockets.clients) {
      const ready = socket.readyState === WebSocket.OPEN;
      if (ready && socket.bufferedAmount < mostWaiting) this.sendOne(socket, bytes);
    }
  }

  private sendOne(socket: WebSocket, bytes: Buffer): void {
    if (bytes[0]! >= 3 && bytes[0]! <= 6) this.bulk.get(socket)!.sent += bytes.length;
    socket.send(bytes);
  }

  // Bytes of large views of which each page has said that it has seen them, and of which not.
  seen(): { seen: number; not: number }[] {
    return [...this.sockets.clients].filter(s => s.readyState === WebSocket.OPEN)
      .map(s => this.bulk.get(s)!).map(b => ({ seen: b.seen, not: b.sent - b.seen }));
  }

  private sendPicture(): void {
    if (this.sockets.clients.size === 0) return;
    const [x, y, yaw] = this.plant.robot;
    this.eye = [x + cameraMount.forward * Math.cos(yaw), y + cameraMount.forward * Math.sin(yaw),
      cameraMount.up];
    this.turn = quaternionOf(yaw, cameraMount.pitch);
    if (!this.pictures || !this.plant.linkUp) return;
    // A robot that stands sees the same again: the picture is new, the work is not done twice.
    const from = [...this.eye, ...this.turn].join();
    if (from !== this.shotFrom) this.shot = shoot(this.bodies, this.eye, this.turn);
    this.shotFrom = from;
    this.shotTime = this.plant.time;
    const plain = this.colour === 'each' || (this.colour === 'third' && ++this.sent % 3 === 0);
    this.send(4, plain ? this.shot.body
      : recoloured(this.shot.body, this.colour === 'broken' ? 'broken' : 'none'), this.shotTime);
  }

  private sendPose(): void {
    const p = this.plant;
    const hand = p.hand;
    const inside = hand ? hand.p.map((v, k) => v - 0.02 * hand.normal[k]!) : [0, 0, 0];
    const contact = hand?.press ?? false;
    const force = contact ? hand!.normal.map(v => 6 * v) : [0, 0, 0];
    const flags = (hand ? 1 : 0) | (contact ? 2 : 0) | 0x10 | 0x20 | 0x40 | (p.goal ? 0x80 : 0);
    const [vx, vy, wz] = p.velocity;
    const ahead: Vec3 = [p.robot[0] + 0.4 * (vx * Math.cos(p.robot[2]) - vy * Math.sin(p.robot[2])),
      p.robot[1] + 0.4 * (vx * Math.sin(p.robot[2]) + vy * Math.cos(p.robot[2])),
      p.robot[2] + 0.4 * wz];
    const flagBytes = Buffer.alloc(4);
    flagBytes.writeUInt32LE(flags);
    const modes = ['init', 'hold', 'engaged', 'ramp_down', 'safe_stop'];
    const tail = Buffer.from([modes.indexOf(p.mode), 1, p.goal ? 2 : 0, 2, 0, 0, 0, 0]);
    const goal = p.goal ? [...p.goal.at, p.goal.yaw ?? 0] : [NaN, NaN, NaN];
    this.send(2, Buffer.concat([
      floats(...inside, ...(hand?.p ?? [0, 0, 0]), ...force, ...(hand?.normal ?? [0, 0, 1])),
      flagBytes,
      floats(hand ? 0.12 : 0, ...p.robot, vx, vy, wz, ...ahead, ...p.wheels, 0.02, ...this.eye,
        ...this.turn, ...goal), tail]), p.time);
  }

  private sendCost(): void {
    const [width, height, resolution] = [50, 40, 0.1];
    const cost = Buffer.alloc(width * height);
    for (let j = 0; j < height; ++j) {
      for (let i = 0; i < width; ++i) {
        const [x, y] = [-1 + (i + 0.5) * resolution, -2 + (j + 0.5) * resolution];
        const near = Math.min(...this.bodies.map(b =>
          Math.hypot(x - b.centre[0], y - b.centre[1]) - b.half[0]));
        cost[j * width + i] = x < -0.6 ? 255 : near < 0 ? 254
          : near < 0.3 ? Math.round(200 * (1 - near / 0.3)) : 0;
      }
    }
    const head = Buffer.alloc(4);
    head.writeUInt16LE(width, 0);
    head.writeUInt16LE(height, 2);
    const origin = Buffer.from(new Float64Array([-1, -2, 0, 1, 0, 0, 0]).buffer);
    this.send(5, Buffer.concat([head, floats(resolution), origin, cost]), this.plant.time);
    const moving = Buffer.alloc(2);
    const at = 0.8 * Math.sin(0.5 * this.plant.time);
    moving.writeUInt16LE(2, 0);
    this.send(6, Buffer.concat([moving, floats(3.6, at, 3.6, at + 0.05)]), this.plant.time);
  }

  private sendText(): void {
    const p = this.plant;
    const link = { state: p.linkUp ? 'up' : 'down', fault: p.linkUp ? '' : 'link silent',
      round_trip_ms: 171, mbit_s: 6.2, fps: 15, age_ms: 120, loss: 0.002, lowered: null };
    const task = (name: string, box: string, hz: number, late: number, cpu: number) => ({ name, box,
      hz, late_p95_us: late, cpu_ms: cpu, cpu_share: cpu * hz / 1000, misses: 0 });
    const slow = {
      version: 'twin', operator_name: 'operator 1', clock: this.clock, mode: p.mode,
      mode_cause: p.cause, robot_mode: p.robotMode ?? p.mode, phase: p.phase, link,
      tracking: 'tracking',
      ...(p.off < 0 ? {} : { goal: { off_m: p.off, short: p.short,
        text: p.short ? `${p.off.toFixed(2)} m short of the goal` : '' } }),
      device: this.desk.device, bus: 'operational',
      held: p.goal && p.mode !== 'engaged' ? 'not engaged' : '',
      tasks: [task('haptic', 'operator', 1000, 38, 0.03), task('fusion', 'operator', 30, 210, 9.1),
        task('prediction', 'operator', 10, 60, 0.4), task('planning', 'operator', 10, 90, 3.2),
        task('supervision', 'operator', 100, 44, 0.01), task('robot_io', 'robot', 1000, 41, 0.02),
        task('capture', 'robot', 30, 130, 4.4)],
      faults: p.linkUp ? [] : [{ id: 'F-LNK-01', text: 'The robot is silent.',
        advice: 'See that the robot process runs and its network is up; then engage again.' }],
      ...(p.warning ? { drive_warning: p.warning } : {}),
      path: p.path, marked: p.phase === 'idle' ? null : this.desk.marked,
      marks: this.desk.marks, obstacles: p.obstacles,
      objects: this.desk.objects, events: this.events, recording: this.desk.recording,
      sessions: this.desk.sessions,
      ...(this.tellsLost ? { lost: p.lost } : {}),
      first_steps: this.desk.steps, console: { viewers: this.sockets.clients.size, share: 0.02 },
    };
    for (const session of this.held ? [] : this.sessions.values()) {
      if (session.socket?.readyState !== WebSocket.OPEN) continue;
      session.socket.send(this.made(1, Buffer.from(JSON.stringify({ ...slow, role: session.role })),
        p.time));
    }
  }
}
