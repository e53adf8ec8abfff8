// The tools at the left, their options below the scene, and the four ways to look.
import { Acts } from '../act/acts';
import { ToolName, Tools } from '../act/tools';
import { Look, looks, Stage } from '../view/stage';
import { Store } from '../wire/store';
import { button, by, h, icon } from './dom';

interface Entry { name: ToolName; text: string; key: string; path: string; how: string }

export const entries: Entry[] = [
  { name: 'look', text: 'Look', key: '1', how: 'Drag to turn, right drag to shift, wheel to zoom.',
    path: 'M2 12s4-7 10-7 10 7 10 7-4 7-10 7S2 12 2 12z M12 9a3 3 0 1 0 0 6 3 3 0 0 0 0-6' },
  { name: 'touch', text: 'Touch', key: '2', how: 'Press on a surface and drag over it.',
    path: 'M9 11V5a2 2 0 0 1 4 0v6l5 1.5c1 .4 1.5 1 1.3 2L18 20H9l-4-6c-.6-1.4 1-2.4 2-1.3z' },
  { name: 'mark', text: 'Mark', key: '3', how: 'Draw a stroke on a surface: the robot goes there.',
    path: 'M4 20l4-1L20 7l-3-3L5 16z M14 7l3 3' },
  { name: 'object', text: 'Object', key: '4', how: 'Click a thing, here or in the picture.',
    path: 'M12 3l8 4.5v9L12 21l-8-4.5v-9z M4 7.5l8 4.5 8-4.5 M12 12v9' },
  { name: 'obstacle', text: 'Keep-out', key: '5',
    how: 'Drag on the floor for a new one; drag one to move it, its rim to resize it.',
    path: 'M12 3a9 9 0 1 0 0 18 9 9 0 0 0 0-18 M6 6l12 12' },
  { name: 'go', text: 'Go to', key: '6', how: 'Click the floor; drag to choose the heading.',
    path: 'M12 21s-6-6.5-6-11a6 6 0 0 1 12 0c0 4.5-6 11-6 11z M12 8a2 2 0 1 0 0 4 2 2 0 0 0 0-4' },
  { name: 'forget', text: 'Forget', key: '7', how: 'Drag over the floor, then say yes.',
    path: 'M5 15l8-9 6 5-7 8H8z M4 20h16' },
];

export class Rail {
  private readonly buttons = new Map<ToolName, HTMLButtonElement>();
  private readonly lookButtons = new Map<Look, HTMLButtonElement>();
  private shown = '';

  constructor(private readonly tools: Tools, private readonly stage: Stage,
    private readonly acts: Acts, private readonly store: Store) {
    for (const entry of entries) {
      const b = button('', () => this.choose(entry.name), { 'aria-keyshortcuts': entry.key,
        title: `${entry.how} Key ${entry.key}` });
      b.append(icon(entry.path), entry.text);
      this.buttons.set(entry.name, b);
    }
    by('rail').append(...this.buttons.values());
    for (const look of looks) {
      const text = { orbit: 'Orbit', follow: 'Follow', first: 'Camera', top: 'Top' }[look];
      this.lookButtons.set(look, button(text, () => this.look(look)));
    }
    by('looks').append(...this.lookButtons.values());
    tools.onChange = tools.selecting.onChange = () => this.show(true);
    this.look('orbit');
    this.choose('look');
  }

  choose(name: ToolName): void {
    if (name !== 'object' && this.tools.name === 'object') this.tools.selecting.drop();
    this.tools.choose(name);
    this.show(true);
  }

  // With a controller in the hand: the tools that act.
  next(step: 1 | -1): void {
    const acting = entries.filter(entry => entry.name !== 'look');
    const at = acting.findIndex(entry => entry.name === this.tools.name);
    const to = at < 0 ? (step > 0 ? 0 : acting.length - 1)
      : (at + step + acting.length) % acting.length;
    this.choose(acting[to]!.name);
  }

  get toolText(): string {
    const why = this.tools.blocked(this.tools.name);
    return entries.find(e => e.name === this.tools.name)!.text + (why ? `: ${why}` : '');
  }

  look(look: Look): void {
    this.stage.setLook(look, this.store.pose);
    for (const [name, b] of this.lookButtons) b.setAttribute('aria-pressed', String(name === look));
  }

  nextLook(): void { this.look(looks[(looks.indexOf(this.stage.look) + 1) % looks.length]!); }

  // The options are built anew only when they change: a field that is typed into stays.
  show(anew = false): void {
    for (const [name, b] of this.buttons) {
      b.setAttribute('aria-pressed', String(name === this.tools.name));
      b.setAttribute('aria-disabled', String(this.tools.blocked(name) !== null));
    }
    const why = this.tools.blocked(this.tools.name);
    if (!anew && this.shown === `${this.tools.name} ${why}`) return;
    this.shown = `${this.tools.name} ${why}`;
    const typed = by('options').querySelector('input')?.value ?? '';
    by('options').replaceChildren(...this.options(why, typed));
  }

  private options(why: string | null, typed: string): Node[] {
    const how = h('span', {}, entries.find(e => e.name === this.tools.name)!.how);
    if (why) return [h('span', { class: 'why' }, why)];
    switch (this.tools.name) {
      case 'object': return this.objectOptions(how, typed);
      case 'obstacle': return [how, ...(['disc', 'box'] as const).map(kind => button(kind,
        () => { this.tools.obstacle.kind = kind; this.show(true); },
        { 'aria-pressed': String(this.tools.obstacle.kind === kind) }))];
      case 'forget': return this.tools.forget.region ? [button('Forget what is in the box', () => {
        const region = this.tools.forget.region!;
        this.acts.forget(region.centre, region.half);
        this.tools.forget.cancel();
      }), button('Cancel', () => this.tools.forget.cancel())] : [how];
      case 'go': return [how, button('Drop goal and path', () => this.acts.cancel())];
      case 'look': return [how];
      default: return [how];
    }
  }

  private objectOptions(how: Node, typed: string): Node[] {
    const { selecting } = this.tools;
    if (selecting.clicks.length === 0) return [how];
    const sign = (value: 1 | -1, text: string) => button(text, () => {
      selecting.sign = value;
      this.show(true);
    }, { 'aria-pressed': String(selecting.sign === value) });
    const name = h('input', { class: 'wide', placeholder: 'name', maxlength: 40,
      'aria-label': 'Name of the object' });
    name.value = typed;
    const accept = button('Accept', () => void selecting.accept(name.value.trim()));
    accept.disabled = !selecting.proposal || selecting.scant;
    const text = h('span', { role: 'status' }, selecting.text);
    return [sign(1, '+ add'), sign(-1, '− take away'), text, name, accept,
      button('Cancel', () => selecting.drop())];
  }
}
