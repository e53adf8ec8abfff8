// The bar on top: what state all is in, the three acts of engagement, and the stop.
import { Acts } from '../act/acts';
import { Store } from '../wire/store';
import { Pose, Slow } from '../wire/types';
import { button, by, h, number, setText } from './dom';

const modes = ['starting', 'hold', 'engaged', 'ramp down', 'safe stop'];
const trackings = ['lost', 'weak', 'tracking'];
const lateRoundTrip = 250;  // ms

type Tone = 'good' | 'warn' | 'bad' | '';

class Chip {
  readonly element: HTMLElement;
  private readonly text = h('span');
  constructor(private readonly name: string, rank = '') {
    this.element = h('span', { class: `chip ${rank}` }, this.text);
  }

  show(text: string, tone: Tone, more = ''): void {
    setText(this.text, text);
    for (const t of ['good', 'warn', 'bad']) this.element.classList.toggle(t, t === tone);
    this.element.title = more;
    this.element.setAttribute('aria-label', `${this.name}: ${text}`);
  }
}

export class TopBar {
  private readonly mode = new Chip('Mode', 'main');
  private readonly link = new Chip('Link', 'main');
  private readonly tracking = new Chip('Camera tracking');
  private readonly task = new Chip('Task');
  private readonly device = new Chip('Haptic device', 'extra');
  private readonly role = new Chip('Role', 'extra');
  private readonly engage: HTMLButtonElement;

  constructor(private readonly acts: Acts, private readonly store: Store, help: () => void) {
    by('chips').append(...[this.mode, this.link, this.task, this.tracking, this.device,
      this.role]
      .map(chip => chip.element));
    this.engage = button('Engage', () => void acts.engage(), { 'aria-keyshortcuts': 'G' });
    by('commands').append(this.engage,
      button('Hold', () => acts.hold(), { 'aria-keyshortcuts': 'H' }),
      button('Clear', () => acts.clear(), { 'aria-keyshortcuts': 'C' }),
      button('Undo', () => acts.undo(), { 'aria-keyshortcuts': 'Control+Z' }),
      button('?', help, { 'aria-label': 'Keys', 'aria-keyshortcuts': '?' }));
    const stop = by<HTMLButtonElement>('stop');
    stop.setAttribute('aria-label', 'Stop');
    // On press, not on release: a click waits for the finger to be lifted.
    stop.addEventListener('pointerdown', () => acts.stop());
    stop.addEventListener('click', event => { if (event.detail === 0) acts.stop(); });
  }

  show(): void {
    const { slow, pose } = this.store;
    const mode = this.modeName(slow, pose);
    // In hold this box does not follow the robot's into a safe stop, which keeps it from engaging.
    if (slow.robot_mode === 'safe stop' && mode !== 'safe stop') {
      this.mode.show('Robot safe stop', 'bad', slow.robot_cause ?? '');
    } else {
      this.mode.show(mode === 'hold' ? 'Hold' : mode, mode === 'engaged' ? 'good'
        : mode === 'hold' || mode === 'starting' ? '' : 'bad', slow.mode_cause ?? '');
    }
    this.showLink(slow);
    const phase = slow.phase ?? 'unknown';
    const missed = slow.goal?.short === true || phase === 'failed';
    this.task.show(slow.goal?.short && phase !== 'driving'
      ? `${number(slow.goal.off_m, 2, ' m')} short of the goal` : `Task ${phase}`,
    missed ? 'warn' : phase === 'arrived' ? 'good' : '',
    phase === 'failed' ? slow.held || 'The goal was given up.' : slow.goal?.text ?? '');
    const tracking = slow.tracking ?? trackings[pose?.tracking ?? -1] ?? 'unknown';
    this.tracking.show(`Camera ${tracking}`, tracking === 'tracking' ? 'good'
      : tracking === 'lost' ? 'bad' : 'warn');
    const device = slow.device;
    this.device.show(device?.kind ? `${device.kind} ${device.state ?? ''}`.trim()
      : 'No device', '');
    this.role.show(this.acts.link.role === 'viewer' || slow.role === 'viewer' ? 'Viewer'
      : 'Operator', '', slow.operator_name ? `Operator: ${slow.operator_name}` : '');
    // Held, though somebody else has stopped, it does nothing any more.
    const engaged = this.acts.held.has('engage') && (mode === 'engaged' || mode === 'ramp down');
    this.engage.setAttribute('aria-pressed', String(engaged));
  }

  private modeName(slow: Slow, pose: Pose | null): string {
    return (slow.mode ?? modes[pose?.mode ?? -1] ?? 'unknown').replace('_', ' ');
  }

  private showLink(slow: Slow): void {
    if (this.acts.link.state !== 'open') {
      this.link.show('No connection', 'bad');
      return;
    }
    const link = slow.link;
    if (!link) {
      this.link.show('Link unknown', 'warn');
      return;
    }
    const trip = link.round_trip_ms;
    const goes = `${number(trip, 0, ' ms')}, ${number(link.fps, 0)} fps`;
    this.link.show(link.fault ? link.fault : goes,
      link.fault ? 'bad' : trip !== undefined && trip > lateRoundTrip ? 'warn' : 'good',
      'Round trip to the robot, pictures a second');
  }
}
