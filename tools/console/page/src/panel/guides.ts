// The five first steps, which tick themselves off, and the page of keys.
import { letters, undoLetter } from '../act/key_meaning';
import { KeyNames } from '../act/key_names';
import { Store } from '../wire/store';
import { button, by, h } from './dom';

const steps: [string, string][] = [
  ['touch', 'Touch: tool 2, press on a surface.'],
  ['mark', 'Mark: tool 3, draw where to go, then Engage.'],
  ['obstacle', 'Keep-out: tool 5, drag on the floor.'],
  ['object', 'Object: tool 4, click a thing, Accept.'],
  ['stop', 'Stop: press Space.'],
];

export class Steps {
  private readonly items = new Map<string, HTMLElement>();

  constructor(private readonly store: Store) {
    const close = button('×', () => {
      localStorage.setItem('steps', 'closed');
      this.show();
    }, { 'aria-label': 'Close the first steps' });
    for (const [name, text] of steps) this.items.set(name, h('li', {}, text));
    by('steps').append(h('h2', {}, 'First steps', close), h('ol', {}, ...this.items.values()));
  }

  show(): void {
    const done = this.store.slow.first_steps;
    by('steps').hidden = !done || localStorage.getItem('steps') === 'closed'
      || this.store.slow.role === 'viewer';
    for (const [name, item] of this.items) {
      const ticked = done?.[name] ?? false;
      if (item.classList.toggle('done', ticked)) item.setAttribute('aria-label',
        `${item.textContent} Done.`);
    }
  }
}

function keys(names: KeyNames): [string, string][] {
  const { engage, hold, clear, view, record, note, accept } = letters;
  const places = (a: string, b: string) => `${names.place(a)} ${names.place(b)}`;
  return [
    ['Space', 'stop, always'], ['?', 'this page'],
    [places('KeyW', 'KeyS'), 'drive on, back (hold)'], ['1 … 7', 'tools'],
    [places('KeyA', 'KeyD'), 'drive left, right (hold)'], [names.letter(view), 'next view'],
    [places('KeyQ', 'KeyE'), 'turn left, right (hold)'], ['arrows', 'move the cross-hair'],
    [names.letter(engage), 'engage'], ['Enter', 'press at the cross-hair (hold, drag)'],
    [names.letter(hold), 'hold'], ['Shift Enter', 'take away (tool Object)'],
    [names.letter(clear), 'clear'], [names.letter(accept), 'accept the object'],
    [`Ctrl ${undoLetter.toUpperCase()}`, 'undo'], ['Delete', 'delete what is chosen'],
    [names.letter(record), 'a piece of the run begins, ends'], ['+ −', 'nearer, farther'],
    [names.letter(note), 'note on the timeline'], ['Esc', 'give up; back to the scene'],
  ];
}

// The page of keys, by the names on this person's keyboard.
export class Help {
  private readonly dialog = by<HTMLDialogElement>('help');
  private readonly rows = h('div', { class: 'keys' });
  private readonly guess = h('p', {}, 'The driving keys are named as on a US keyboard: this '
    + 'browser does not tell what is printed on yours. They are those at the same places: two rows '
    + 'of three, at the left. Press them once, and your own names stand here.');

  constructor(private readonly names: KeyNames, teach: () => void) {
    names.onChange = () => this.show();
    this.dialog.append(h('h2', {}, 'Keys'), this.rows, this.guess,
      h('p', {}, 'Driving and touching are held: let go and it ends. If the window, the pointer, '
        + 'the gamepad or the connection is lost, it ends too, and wants a new press. No key moves '
        + 'anything while a button or a field has the focus: Esc goes back to the scene.'),
      h('p', {}, 'Gamepad: hold the right shoulder button; left stick drives, right stick turns. '
        + 'Without it the left stick moves the cross-hair, and button A presses there (hold, '
        + 'drag): with the tool Touch it is the hand.'),
      h('div', { class: 'buttons' }, button('Close', () => this.dialog.close()),
        button('Teach the gamepad', () => {
          this.dialog.close();
          teach();
        })));
    this.show();
  }

  open(): void { if (!this.dialog.open) this.dialog.showModal(); }

  private show(): void {
    this.rows.replaceChildren(...keys(this.names).flatMap(([key, what]) =>
      [h('span', {}, h('kbd', {}, key)), h('span', {}, what)]));
    this.guess.hidden = this.names.known;
    const drive = ['KeyW', 'KeyA', 'KeyS', 'KeyD', 'KeyQ', 'KeyE'].map(c => this.names.place(c));
    by('canvas').setAttribute('aria-label', 'Scene. Arrow keys move the cross-hair, Enter presses. '
      + `${drive.join(' ')} drive.`);
  }
}
