// How all goes: faults in words, the link, the timing of each task and whose fault a miss is, the
// device, the bus, and the page's own figures.
import { Acts } from '../act/acts';
import { Stage } from '../view/stage';
import { Store } from '../wire/store';
import { TaskRow } from '../wire/types';
import { button, h, number, Rows, setText } from './dom';

type Fault = { id: string; text: string; advice?: string; since_s?: number };

export interface OwnFigures {
  fps: number;
  answerP95: number | null;  // ms
  meshP95: number | null;    // ms
  roundTrip: number | null;  // s, page to box and back
  triangles: number;
  damaged: number;
  renderer: string;
}

class Facts {
  readonly element = h('dl');
  private readonly values = new Map<string, HTMLElement>();

  show(facts: Record<string, string>): void {
    for (const [name, value] of Object.entries(facts)) {
      let dd = this.values.get(name);
      if (!dd) {
        this.values.set(name, dd = h('dd'));
        this.element.append(h('dt', {}, name), dd);
      }
      setText(dd, value);
    }
  }
}

export class Health {
  readonly pane = h('div');
  private readonly faults: Rows<Fault>;
  private readonly tasks: Rows<TaskRow>;
  private readonly link = new Facts();
  private readonly device = new Facts();
  private readonly own = new Facts();
  private readonly modelled = h('p', { class: 'none', hidden: true },
    'Simulated clock: lateness, CPU and misses, and the figures of the link, are those of the '
    + "run's model. Nothing of them was measured on this machine.");
  private readonly scale = h('input', { type: 'number', min: '0.1', max: '20', step: '0.1',
    'aria-label': 'Scene metres for a metre of the hand' });

  constructor(private readonly acts: Acts, private readonly store: Store,
    private readonly stage: Stage, private readonly figures: () => OwnFigures) {
    const faultList = h('div', { role: 'alert', 'aria-label': 'Faults' });
    this.faults = new Rows(faultList, 'No fault.', f => f.id, () => this.faultRow());
    const body = h('tbody');
    this.tasks = new Rows(body, '', t => `${t.box ?? ''} ${t.name}`, () => this.taskRow());
    const head = h('tr', {}, ...['task', 'late us', 'CPU ms', '%', 'missed', 'whose']
      .map(text => h('th', { scope: 'col' }, text)));
    this.pane.append(h('h3', {}, 'Faults'), faultList, h('h3', {}, 'Link to the robot'),
      this.link.element, h('h3', {}, 'Timing'), this.modelled,
      h('table', {}, h('thead', {}, head), body),
      h('h3', {}, 'Haptic device'), this.device.element, this.deviceForm(),
      h('h3', {}, 'This page'), this.own.element);
  }

  show(): void {
    if (this.pane.hidden) return;
    const { slow } = this.store;
    this.faults.show(slow.faults ?? []);
    const link = slow.link;
    this.link.show({
      State: link?.fault ? `${link.state ?? ''} ${link.fault}` : link?.state ?? 'unknown',
      'Round trip': number(link?.round_trip_ms, 0, ' ms'),
      Pictures: number(link?.fps, 1, ' a second'),
      Rate: number(link?.mbit_s, 1, ' Mbit/s'),
      'Age of the picture': number(link?.age_ms, 0, ' ms'),
      Lost: link?.loss === undefined ? 'unknown' : `${(100 * link.loss).toFixed(1)} %`,
      Lowered: link?.lowered ?? 'no',
      Tracking: slow.tracking ?? 'unknown',
      Bus: typeof slow.bus === 'string' ? slow.bus
        : slow.bus ? JSON.stringify(slow.bus) : 'unknown',
    });
    this.modelled.hidden = slow.clock !== 'paced';
    this.tasks.show(slow.tasks ?? []);
    const device = slow.device;
    this.device.show({
      Kind: device?.kind ?? 'none', State: device?.state ?? 'unknown',
      Force: device?.renders_force === undefined ? 'unknown'
        : device.renders_force ? 'rendered' : 'not rendered',
      Clutch: device?.clutch ? 'held' : 'free',
    });
    if (document.activeElement !== this.scale && device?.scale !== undefined) {
      this.scale.value = String(device.scale);
    }
    const own = this.figures();
    this.own.show({
      Drawn: number(own.fps, 0, ' a second'),
      'Answer p95': number(own.answerP95, 0, ' ms'),
      'Round trip to the box': number(own.roundTrip === null ? null : 1000 * own.roundTrip, 0,
        ' ms'),
      'Mesh applied p95': number(own.meshP95, 0, ' ms'),
      Triangles: String(own.triangles),
      'Views not readable': String(own.damaged),
      Watching: slow.console?.viewers === undefined ? 'unknown' : String(slow.console.viewers),
      'Server share of a core': slow.console?.share === undefined ? 'unknown'
        : `${(100 * slow.console.share).toFixed(1)} %`,
      Renderer: own.renderer,
      Box: `${slow.version ?? 'unknown'}, ${slow.clock ?? 'unknown'} clock`,
    });
  }

  private faultRow() {
    const text = h('span');
    const more = h('small');
    const element = h('div', { class: 'fault' }, text, more);
    return { element, update: (fault: Fault) => {
      setText(text, `${fault.id}: ${fault.text}`);
      setText(more, fault.advice ?? '');
    } };
  }

  private taskRow() {
    const cells = Array.from({ length: 6 }, () => h('td'));
    const element = h('tr', {}, ...cells);
    return { element, update: (task: TaskRow) => {
      const short = (value: number | undefined, digits: number) =>
        value === undefined ? '' : number(value, digits);
      const share = task.cpu_share === undefined ? undefined : 100 * task.cpu_share;
      const texts = [task.name, short(task.late_p95_us, 0), short(task.cpu_ms, 2),
        short(share, 0), short(task.misses, 0), task.blame ?? ''];
      texts.forEach((text, i) => setText(cells[i]!, text));
      element.title = `${task.box ?? ''} box, ${number(task.hz, 0, ' Hz')}`;
    } };
  }

  private deviceForm(): HTMLElement {
    const clutch = button('Clutch', () => {
      const on = !(this.store.slow.device?.clutch ?? false);
      void this.acts.ask('device', { clutch: on }, on ? 'Clutch held: the hand may be moved freely.'
        : 'Clutch free.');
    });
    return h('div', { class: 'buttons' }, h('label', {}, 'Scale', this.scale),
      button('Set scale', () => void this.acts.ask('device', { scale: Number(this.scale.value) },
        'The scale goes over while the hand is free for a moment.')), clutch,
      button('Turn the hand to this view', () => {
        const eye = this.stage.toWorld(this.stage.camera.position);
        const to = this.stage.toWorld(this.stage.controls.target);
        void this.acts.ask('device', { view_yaw: Math.atan2(to[1] - eye[1], to[0] - eye[0]) },
          'The hand turns to this view while it is free for a moment.');
      }));
  }
}
