// By which address browsers come to the twin: its own, or one that a proxy shows. The rules are
// those of tools/console/web_rules.hpp.
import { IncomingMessage } from 'node:http';

export class Way {
  host = '';                  // its own name
  known: URL | null = null;   // the public address; null: it was told of none

  goodHost({ headers }: IncomingMessage): boolean {
    return headers.host === this.host || headers.host === this.known?.host;
  }

  goodOrigin(request: IncomingMessage): boolean {
    const { host, origin } = request.headers;
    const own = host === this.host && origin === `http://${host}`;
    return this.goodHost(request) && (own || origin === this.known?.origin);
  }

  // The path of a request without that of the public address, which a proxy may leave there.
  inside(request: IncomingMessage): string {
    const { pathname } = new URL(request.url ?? '/', 'http://twin');
    const folder = this.known?.pathname ?? '/';
    return pathname.startsWith(folder) ? pathname.slice(folder.length - 1) : pathname;
  }

  cookieEnd({ headers }: IncomingMessage): string {
    const by = headers.origin === this.known?.origin ? this.known : null;
    return `Path=${by?.pathname ?? '/'}${by?.protocol === 'https:' ? '; Secure' : ''}`;
  }
}
