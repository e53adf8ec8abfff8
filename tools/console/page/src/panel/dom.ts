// Elements without innerHTML: what the box says is text, never markup.

type Props = Record<string, string | number | boolean | ((event: Event) => void) | undefined>;
type Child = Node | string | null;

export function h<K extends keyof HTMLElementTagNameMap>(tag: K, props: Props = {},
  ...children: Child[]): HTMLElementTagNameMap[K] {
  const element = document.createElement(tag);
  for (const [key, value] of Object.entries(props)) {
    if (value === undefined || value === false) continue;
    if (typeof value === 'function') element.addEventListener(key, value);
    else if (key === 'class') element.className = String(value);
    else element.setAttribute(key, value === true ? '' : String(value));
  }
  element.append(...children.filter((c): c is Node | string => c !== null));
  return element;
}

export function button(text: string, click: () => void, props: Props = {}): HTMLButtonElement {
  return h('button', { type: 'button', click, ...props }, text);
}

export function icon(path: string): SVGSVGElement {
  const svg = document.createElementNS('http://www.w3.org/2000/svg', 'svg');
  svg.setAttribute('viewBox', '0 0 24 24');
  svg.setAttribute('aria-hidden', 'true');
  const line = document.createElementNS('http://www.w3.org/2000/svg', 'path');
  line.setAttribute('d', path);
  svg.append(line);
  return svg;
}

export function by<T extends HTMLElement>(id: string): T {
  return document.getElementById(id) as T;
}

export function setText(element: Element, text: string): void {
  if (element.textContent !== text) element.textContent = text;
}

// Rows that stay the same element as long as their key stays: the focus, and what a screen reader
// has read, survive an update.
export class Rows<T> {
  private readonly rows = new Map<string, { element: HTMLElement; update: (item: T) => void }>();

  constructor(private readonly parent: HTMLElement, private readonly empty: string,
    private readonly key: (item: T) => string,
    private readonly make: (item: T) => { element: HTMLElement; update: (item: T) => void }) {}

  show(items: T[]): void {
    const wanted = new Set(items.map(this.key));
    for (const [key, row] of this.rows) {
      if (wanted.has(key)) continue;
      row.element.remove();
      this.rows.delete(key);
    }
    const none = this.parent.querySelector(':scope > .none');
    if (items.length > 0) none?.remove();
    else if (!none && this.empty) this.parent.append(h('p', { class: 'none' }, this.empty));
    items.forEach((item, i) => {
      const key = this.key(item);
      let row = this.rows.get(key);
      if (!row) this.rows.set(key, row = this.make(item));
      row.update(item);
      if (this.parent.children[i] !== row.element) {
        this.parent.insertBefore(row.element, this.parent.children[i] ?? null);
      }
    });
  }
}

export function number(value: number | undefined | null, digits: number, unit = ''): string {
  return value === undefined || value === null || !Number.isFinite(value) ? 'unknown'
    : `${value.toFixed(digits)}${unit}`;
}
