// The page behind a proxy that ends TLS beneath a path, a tunnel to another port, and a proxy that
// passes no WebSocket: by a reverse proxy of a few lines.
import assert from 'node:assert/strict';
import { spawnSync } from 'node:child_process';
import { mkdtempSync, readFileSync, rmSync } from 'node:fs';
import { createServer, IncomingMessage, request as ask, RequestListener } from 'node:http';
import { createServer as createSecureServer } from 'node:https';
import { AddressInfo, connect, Socket } from 'node:net';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { test } from 'node:test';
import { TwinBox } from '../twin/box';
import { browser } from './bench';
import { newPage, seed, site, until } from './browser';

interface Road {
  tls: boolean;
  folder: string;        // beneath which the page lies
  takesFolder: boolean;  // away, before the box sees it
  ownName: boolean;      // the box sees its own name as Host
  sockets: boolean;      // WebSockets are passed on
}

// A certificate for a moment, that nobody vouches for.
function certificate(): { key: Buffer; cert: Buffer } {
  const place = mkdtempSync(join(tmpdir(), 'teletact_tunnel_'));
  const [key, cert] = [join(place, 'key'), join(place, 'cert')];
  const made = spawnSync('openssl', ['req', '-x509', '-newkey', 'ec', '-pkeyopt',
    'ec_paramgen_curve:P-256', '-nodes', '-days', '2', '-subj', '/CN=localhost', '-keyout', key,
    '-out', cert]);
  assert.equal(made.status, 0, String(made.stderr));
  const both = { key: readFileSync(key), cert: readFileSync(cert) };
  rmSync(place, { recursive: true });
  return both;
}

class Proxy {
  private readonly server;
  private readonly ends = new Set<Socket>();

  constructor(private readonly twin: TwinBox, private readonly road: Road) {
    const answer: RequestListener = (from, to) => {
      const on = ask({ host: '127.0.0.1', port: twin.way.host.split(':')[1], method: from.method,
        path: this.path(from), headers: this.headers(from) }, got => {
        to.writeHead(got.statusCode!, got.rawHeaders);
        got.pipe(to);
      });
      on.on('error', () => to.destroy());
      from.pipe(on);
    };
    this.server = road.tls ? createSecureServer(certificate(), answer) : createServer(answer);
    this.server.on('connection', socket => this.keep(socket));
    this.server.on('upgrade', (from: IncomingMessage, socket: Socket) => {
      if (!road.sockets) {
        socket.end('HTTP/1.1 502 Bad Gateway\r\n\r\n');
        return;
      }
      const on = connect(Number(twin.way.host.split(':')[1]), '127.0.0.1');
      this.keep(on);
      const lines = Object.entries(this.headers(from)).map(([name, value]) => `${name}: ${value}`);
      on.write(`GET ${this.path(from)} HTTP/1.1\r\n${lines.join('\r\n')}\r\n\r\n`);
      on.pipe(socket).pipe(on);
      for (const end of [on, socket]) end.on('error', () => end.destroy());
    });
  }

  async listen(): Promise<URL> {
    await new Promise<void>(done => this.server.listen(0, '127.0.0.1', () => done()));
    const { port } = this.server.address() as AddressInfo;
    return new URL(`${this.road.tls ? 'https' : 'http'}://localhost:${port}${this.road.folder}`);
  }

  async close(): Promise<void> {
    for (const end of this.ends) end.destroy();
    await new Promise(done => this.server.close(done));
  }

  private keep(socket: Socket): void {
    this.ends.add(socket);
    socket.on('close', () => this.ends.delete(socket));
  }

  private path(from: IncomingMessage): string {
    const { url = '/' } = from;
    if (!this.road.takesFolder) return url;
    // What lies outside is another program's.
    return url.startsWith(this.road.folder) ? url.slice(this.road.folder.length - 1) : '/outside';
  }

  private headers(from: IncomingMessage): Record<string, string> {
    const headers = { ...from.headers } as Record<string, string>;
    if (this.road.ownName) headers.host = this.twin.way.host;
    return headers;
  }
}

const whole: Road = { tls: false, folder: '/', takesFolder: true, ownName: false, sockets: true };

// `known`: the box was told its public address.
async function behind(way: Partial<Road>, known: boolean,
  run: (page: Awaited<ReturnType<typeof newPage>>, at: URL, twin: TwinBox) => Promise<void>) {
  const twin = new TwinBox(site, seed);
  await twin.listen();
  const proxy = new Proxy(twin, { ...whole, ...way });
  const at = await proxy.listen();
  if (known) twin.way.known = at;
  const context = await browser.newContext({ ignoreHTTPSErrors: true,
    viewport: { width: 480, height: 360 } });
  try {
    await run(await newPage(context), at, twin);
  } finally {
    await context.close();
    await proxy.close();
    await twin.close();
  }
}

const banner = (page: Awaited<ReturnType<typeof newPage>>) => page.textContent('#banner');

const ways: [string, Partial<Road>][] = [
  ['a proxy that ends TLS and takes its folder away',
    { tls: true, folder: '/robots/rover/', ownName: true }],
  ['a tunnel to another port', {}],
];
if (process.env.TELETACT_WHOLE) {
  ways.push(['a proxy that ends TLS and leaves name and folder',
    { tls: true, folder: '/robots/rover/', takesFolder: false }]);
}
for (const [name, way] of ways) {
  test(`behind ${name}: seen, acted, stopped by both ways, reloaded, shared`, async () => {
    await behind(way, true, async (page, at, twin) => {
      const code = new URL(twin.url()).hash;
      await page.goto(`${at}${code}`);
      await until('a connection', () => page.isHidden('#banner'));
      assert.equal(page.url(), String(at), 'the code is out of the address');
      await until('a live picture', () => page.evaluate(() =>
        !document.getElementById('inset')!.classList.contains('frozen')));
      await page.focus('#canvas');
      await page.keyboard.press('h');
      await until('the act', () => twin.count('hold') === 1);
      await page.keyboard.press('Space');
      await until('the stop by both ways', () => twin.count('stop') === 1 && twin.stops === 1);
      await page.reload();
      await until('the same session', () => page.isHidden('#banner'));
      await page.click('#tabs button:has-text("Session")');
      await page.click('#pane-session button:has-text("Link for a viewer")');
      const link = page.locator('#pane-session .sayable');
      await until('a link', async () => /#code=/.test((await link.textContent())!));
      assert.ok((await link.textContent())!.startsWith(`${at}#code=`));
    });
  });
}

test('behind a proxy that the box was not told of: what to do, with this address', async () => {
  await behind({ tls: true, folder: '/rover/', ownName: true }, false, async (page, at, twin) => {
    await page.goto(`${at}${new URL(twin.url()).hash}`);
    await until('the words', async () => (await banner(page))!.includes(`--console-public ${at}`));
  });
});

test('behind a proxy that passes no WebSocket: that it does not', async () => {
  await behind({ sockets: false }, true, async (page, at, twin) => {
    await page.goto(`${at}${new URL(twin.url()).hash}`);
    await until('the words', async () => (await banner(page))!.includes('does not pass it on'));
    assert.ok(twin.count('stop') === 0);
    await page.keyboard.press('Space');
    await until('the stop, by its request', () => twin.stops === 1);
  });
});
