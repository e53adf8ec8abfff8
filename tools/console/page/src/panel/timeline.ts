// What happened, newest first, with a strip of the last minutes; recording, and marks of one's own.
import { Acts } from '../act/acts';
import { Store } from '../wire/store';
import { button, h, Rows, setText } from './dom';

type Event = { t: number; kind?: string; text: string };

const stripSeconds = 300;

export class Timeline {
  readonly pane = h('div');
  private readonly record: HTMLButtonElement;
  private readonly note = h('input', { maxlength: 200, placeholder: 'what you saw',
    'aria-label': 'Note for the timeline' });
  private readonly rows: Rows<Event>;
  private readonly strip = document.createElementNS('http://www.w3.org/2000/svg', 'svg');
  private drawn = '';

  constructor(acts: Acts, private readonly store: Store) {
    this.record = button('Record', () => acts.record(!this.recording),
      { 'aria-keyshortcuts': 'R' });
    const form = h('form', { class: 'buttons', submit: event => {
      event.preventDefault();
      if (this.note.value.trim()) acts.note(this.note.value.trim());
      this.note.value = '';
      this.note.blur();
    } }, this.note, h('button', { type: 'submit' }, 'Note'), this.record);
    this.strip.setAttribute('class', 'strip');
    this.strip.setAttribute('viewBox', '0 0 300 34');
    this.strip.setAttribute('preserveAspectRatio', 'none');
    this.strip.setAttribute('aria-hidden', 'true');
    const list = h('div', { role: 'log', 'aria-live': 'off', 'aria-label': 'Events' });
    this.rows = new Rows(list, 'Nothing yet.', e => `${e.t} ${e.text}`, e => {
      const element = h('div', { class: 'event' }, h('time', {}, `${e.t.toFixed(1)} s`),
        h('span', {}, e.text));
      return { element, update: () => {} };
    });
    this.pane.append(h('h3', {}, 'Record'), form, h('p', { class: 'none' },
      'Record names a piece of this run: its report can be made by itself.'),
      h('h3', {}, 'Last 5 minutes'), this.strip,
      h('h3', {}, 'Events'), list);
  }

  focusNote(): void { this.note.focus(); }
  get recording(): boolean { return this.store.slow.recording ?? false; }

  show(): void {
    setText(this.record, this.recording ? 'End the piece' : 'Record');
    this.record.setAttribute('aria-pressed', String(this.recording));
    const events = this.store.slow.events ?? [];
    const last = events[events.length - 1];
    const key = last ? `${last.t} ${events.length}` : '';
    if (key === this.drawn) return;
    this.drawn = key;
    this.rows.show([...events].reverse());
    this.strip.replaceChildren(...events.filter(e => last!.t - e.t < stripSeconds).map(e => {
      const line = document.createElementNS('http://www.w3.org/2000/svg', 'line');
      const x = String(299 - (last!.t - e.t));
      for (const [name, value] of [['x1', x], ['x2', x], ['y1', '3'], ['y2', '31']] as const) {
        line.setAttribute(name, value);
      }
      line.setAttribute('class', e.kind ?? '');
      return line;
    }));
  }
}
