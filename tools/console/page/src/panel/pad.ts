// The drive pad for touch screens and the mouse: each button drives as long as it is pressed.
import { Drive } from '../act/drive';
import { button, by, h, setText } from './dom';

const buttons: [string, string, [number, number, number]][] = [
  ['↺', 'Turn left', [0, 0, 1]], ['↑', 'Drive forwards', [1, 0, 0]],
  ['↻', 'Turn right', [0, 0, -1]], ['←', 'Drive to the left', [0, 1, 0]],
  ['↓', 'Drive backwards', [-1, 0, 0]], ['→', 'Drive to the right', [0, -1, 0]],
];

export class Pad {
  private readonly locked = h('div', { class: 'locked', hidden: true });
  private readonly warning = h('div', { class: 'locked', role: 'alert', hidden: true });
  private readonly all: HTMLButtonElement[] = [];

  constructor(private readonly drive: Drive) {
    for (const [sign, name, command] of buttons) {
      const b = button(sign, () => {}, { 'aria-label': `${name}, hold` });
      const source = `pad ${name}`;
      b.addEventListener('pointerdown', event => {
        b.setPointerCapture(event.pointerId);
        b.classList.toggle('on', drive.press(source, command));
      });
      const end = () => {
        b.classList.remove('on');
        drive.release(source);
      };
      b.addEventListener('pointerup', end);
      b.addEventListener('pointercancel', end);
      b.addEventListener('lostpointercapture', end);
      b.addEventListener('contextmenu', event => event.preventDefault());
      // The focus stays where it is: with the focus in a control nothing drives.
      b.addEventListener('mousedown', event => event.preventDefault());
      this.all.push(b);
    }
    const speed = h('input', { type: 'range', min: '0.05', max: '0.8', step: '0.05',
      'aria-label': 'Speed of driving' });
    speed.value = String(drive.speed);
    const shown = h('span', {}, `${drive.speed.toFixed(2)} m/s`);
    speed.addEventListener('input', () => {
      drive.speed = Number(speed.value);
      setText(shown, `${drive.speed.toFixed(2)} m/s`);
    });
    by('pad').append(this.locked, this.warning, ...this.all, h('label', {}, shown, speed));
  }

  // `warning`: what the base drives into; nothing stops it there.
  show(why: string | null, warning: string): void {
    this.locked.hidden = why === null;
    if (why !== null) setText(this.locked, why);
    this.warning.hidden = warning === '';
    setText(this.warning, warning);
    for (const b of this.all) {
      b.setAttribute('aria-disabled', String(why !== null));
      if (!this.drive.driving) b.classList.remove('on');
    }
  }
}
