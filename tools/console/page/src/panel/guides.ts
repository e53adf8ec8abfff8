// The five first steps, which tick themselves off, and the page of keys.
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

const keys: [string, string][] = [
  ['Space', 'stop, always'], ['?', 'this page'],
  ['W S', 'drive on, back (hold)'], ['1 … 7', 'tools'],
  ['A D', 'drive left, right (hold)'], ['V', 'next view'],
  ['Q E', 'turn left, right (hold)'], ['arrows', 'move the cross-hair'],
  ['G', 'engage'], ['Enter', 'press at the cross-hair (hold, drag)'],
  ['H', 'hold'], ['Shift Enter', 'take away (tool Object)'],
  ['C', 'clear'], ['Y', 'accept the object'],
  ['Z', 'undo'], ['Delete', 'delete what is chosen'],
  ['R', 'a piece of the run begins, ends'], ['+ −', 'nearer, farther'],
  ['N', 'note on the timeline'], ['Esc', 'give up; back to the scene'],
];

export function fillHelp(): void {
  const dialog = by<HTMLDialogElement>('help');
  dialog.append(h('h2', {}, 'Keys'), h('div', { class: 'keys' },
    ...keys.flatMap(([key, what]) => [h('span', {}, h('kbd', {}, key)), h('span', {}, what)])),
    h('p', {}, 'Driving and touching are held: let go and it ends. If the window, the pointer, the '
      + 'gamepad or the connection is lost, it ends too, and wants a new press. No key moves '
      + 'anything while a button or a field has the focus: Esc goes back to the scene.'),
    h('p', {}, 'Gamepad: hold the right shoulder button; left stick drives, right stick turns. '
      + 'Without it the left stick moves the cross-hair, and button A presses there (hold, drag): '
      + 'with the tool Touch it is the hand.'),
    button('Close', () => dialog.close()));
}
