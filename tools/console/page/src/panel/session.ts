// Who acts and who watches, what this session has saved, how the page looks.
import { Acts } from '../act/acts';
import { Stage } from '../view/stage';
import { Store } from '../wire/store';
import { SavedSession } from '../wire/types';
import { button, h, Rows, setText } from './dom';

export type Layers = Record<string, { visible: boolean }>;

const nameForm = /^[a-z0-9_-]{1,40}$/;

// How to go on with one that this run can not open; null: it can.
function elsewhere(session: SavedSession): string | null {
  if (session.here) return null;
  if (!session.map) return 'Of another map, which is not on the disk: its run goes on, or died.';
  return `Of another map. Start with: teletact demo --console --session ${session.name}`;
}

export class Session {
  readonly pane = h('div');
  private readonly who = h('p');
  private readonly link = h('div', { class: 'sayable', hidden: true });
  private readonly name = h('input', { placeholder: 'name: a-z 0-9 _ -', maxlength: 40,
    'aria-label': 'Name of the saved session' });
  private readonly sessions: Rows<SavedSession>;
  private readonly roles: Record<'ask' | 'give' | 'take' | 'view', HTMLButtonElement>;

  constructor(private readonly acts: Acts, private readonly store: Store, stage: Stage,
    layers: Layers, private readonly themed: () => void) {
    const role = (act: string, text: string, done: string) =>
      button(text, () => void acts.ask(act, {}, done));
    this.roles = {
      ask: role('ask_role', 'Ask to operate', 'The operator is asked.'),
      take: role('take_role', 'Take over', 'You operate now.'),
      give: role('give_role', 'Hand over', 'The role is handed over.'),
      view: button('Link for a viewer', () => void this.makeLink()),
    };
    const saved = h('div', { role: 'list', 'aria-label': 'Saved sessions' });
    this.sessions = new Rows(saved, 'None yet.', s => s.name, () => this.sessionRow());
    this.pane.append(h('h3', {}, 'Who'), this.who,
      h('div', { class: 'buttons' }, ...Object.values(this.roles)), this.link,
      h('h3', {}, 'Saved sessions'), this.name,
      h('div', { class: 'buttons' }, button('Save', () => this.save())),
      h('p', { class: 'none' }, 'Marks, keep-outs, objects and settings at once; '
        + 'the map when the run ends.'), saved,
      h('h3', {}, 'Show'), this.layerButtons(layers, stage),
      h('h3', {}, 'Colours'), h('div', { class: 'buttons' },
        ...(['auto', 'dark', 'light'] as const).map(theme =>
          button(theme, () => this.theme(theme)))));
  }

  show(): void {
    const { slow } = this.store;
    const viewer = slow.role === 'viewer';
    const name = slow.operator_name ? ` Operator: ${slow.operator_name}.` : '';
    setText(this.who, (viewer ? 'You watch.' : 'You operate.') + name);
    this.roles.ask.hidden = this.roles.take.hidden = !viewer;
    this.roles.give.hidden = this.roles.view.hidden = viewer;
    this.sessions.show(slow.sessions ?? []);
  }

  theme(theme: 'auto' | 'dark' | 'light'): void {
    localStorage.setItem('theme', theme);
    applyTheme();
    this.themed();
  }

  private async makeLink(): Promise<void> {
    const url = await this.acts.link.viewLink();
    this.link.hidden = url === null;
    if (url === null) {
      this.acts.say('Refused: the box makes no link for viewers now.', 'refused');
      return;
    }
    setText(this.link, url);
    this.acts.say('A link for one viewer is made. It works once.', 'done');
  }

  private save(): void {
    const name = this.name.value.trim();
    if (!nameForm.test(name)) {
      this.acts.say('A name has 1 to 40 of a-z, 0-9, _ and -.', 'refused');
      return;
    }
    void this.acts.ask('save', { name }, `Saved as ${name}.`);
  }

  private sessionRow() {
    let shown: SavedSession | null = null;
    const text = h('span');
    const more = h('small');
    const open = button('Open', () => {
      if (shown) void this.acts.ask('open', { name: shown.name }, `Opened: ${shown.name}.`);
    });
    const element = h('div', { class: 'row', role: 'listitem' },
      h('span', { class: 'name' }, text, more), open);
    return { element, update: (session: SavedSession) => {
      shown = session;
      setText(text, session.name);
      open.setAttribute('aria-label', `Open ${session.name}`);
      open.hidden = elsewhere(session) !== null;
      setText(more, elsewhere(session) ?? `saved ${session.saved ?? ''}`);
    } };
  }

  private layerButtons(layers: Layers, stage: Stage): HTMLElement {
    return h('div', { class: 'buttons' }, ...Object.entries(layers).map(([name, layer]) => {
      const b = button(name, () => {
        layer.visible = !layer.visible;
        b.setAttribute('aria-pressed', String(layer.visible));
        stage.touch();
      }, { 'aria-pressed': String(layer.visible) });
      return b;
    }));
  }
}

export function applyTheme(): void {
  const chosen = localStorage.getItem('theme') ?? 'auto';
  const light = chosen === 'light'
    || (chosen === 'auto' && matchMedia('(prefers-color-scheme: light)').matches);
  document.documentElement.dataset.theme = light ? 'light' : 'dark';
}
