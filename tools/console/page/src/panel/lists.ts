// Everything that can be pointed at, as a list: to look at, to go to, to change by numbers.
import { Acts } from '../act/acts';
import { Stage } from '../view/stage';
import { Choice, objectName, ThingsLayer } from '../view/things_layer';
import { Store } from '../wire/store';
import { Obstacle, SceneObject, Vec3 } from '../wire/types';
import { button, h, number, Rows, setText } from './dom';
import { Moving, moving } from './moving';

interface Place { key: string; name: string; where: string; at: Vec3 | null; goes: boolean }

const aside = 0.6;  // m from a thing's middle where the robot is sent

function words(p: Vec3 | null): string {
  return p ? `${p.map(v => v.toFixed(2)).join(', ')} m` : 'not known';
}

export class Lists {
  readonly pane = h('div');
  private readonly places: Rows<Place>;
  private readonly obstacles: Rows<Obstacle>;
  private readonly objects: Rows<SceneObject>;
  private readonly moving: Rows<Moving & { key: string }>;
  private readonly marks: Rows<{ id: number; points: Vec3[] }>;

  constructor(private readonly acts: Acts, private readonly store: Store,
    private readonly stage: Stage, private readonly things: ThingsLayer) {
    const section = (title: string) => {
      const list = h('div', { role: 'list', 'aria-label': title });
      this.pane.append(h('h3', {}, title), list);
      return list;
    };
    this.places = new Rows(section('Robot and hand'), '', p => p.key, () => this.placeRow());
    this.objects = new Rows(section('Objects'), 'None yet. Tool "Object", then click a thing.',
      o => String(o.id), () => this.objectRow());
    this.obstacles = new Rows(section('Keep-outs'), 'None.', o => String(o.id),
      () => this.obstacleRow());
    this.marks = new Rows(section('Marks'), 'None yet.', m => String(m.id), () => this.markRow());
    this.moving = new Rows<Moving & { key: string }>(section('What moves'), 'Nothing.',
      m => m.key, () => this.movingRow());
    this.pane.append(h('h3', {}, 'By numbers'), this.goForm(),
      h('div', { class: 'buttons' },
        button('New keep-out', () => acts.draw({ id: acts.nextObstacleId(), kind: 'disc',
          centre: this.ahead(), half: [0.2, 0.2, 0.25], yaw: 0 })),
        button('Erase all keep-outs', () => acts.erase(0))));
  }

  choose(choice: Choice): void {
    this.things.choose(choice);
    this.stage.touch();
    this.show();
  }

  show(): void {
    const { slow, pose } = this.store;
    const robot: Vec3 | null = pose?.robotValid ? [pose.robot[0], pose.robot[1], 0.2] : null;
    const goal: Vec3 | null = slow.marked ?? null;
    this.places.show([
      { key: 'robot', name: 'Robot', at: robot, goes: false,
        where: `${words(robot)}${slow.held ? `; stands: ${slow.held}` : ''}` },
      { key: 'hand', name: 'Hand', at: pose?.handValid ? pose.hand : null, goes: true,
        where: pose?.handValid ? `${words(pose.hand)}${pose.contact
          ? `, touches, ${number(Math.hypot(...pose.force), 1, ' N')}` : ''}` : 'not known' },
      { key: 'goal', name: 'Goal', at: goal, goes: false,
        where: `${words(goal)}${slow.phase ? `; ${slow.phase}` : ''}`
          + (slow.goal?.text ? `; ${slow.goal.text}` : '') },
    ]);
    this.objects.show(slow.objects ?? []);
    this.obstacles.show(slow.obstacles ?? []);
    this.marks.show(slow.marks ?? []);
    this.moving.show(moving(this.store.moving, this.store.costMap?.resolution)
      .map((m, i) => ({ ...m, key: String(i) })));
  }

  private ahead(): Vec3 {
    const pose = this.store.pose;
    const [x, y, yaw] = pose?.robotValid ? pose.robot : [0, 0, 0];
    return [x + Math.cos(yaw), y + Math.sin(yaw), 0];
  }

  private row(actions: (row: HTMLElement) => HTMLButtonElement[]) {
    const title = h('span');
    const more = h('small');
    const element = h('div', { class: 'row', role: 'listitem' });
    element.append(h('span', { class: 'name' }, title, more), ...actions(element));
    return { element, title, more };
  }

  // What can be chosen is chosen by it: Delete is then about it.
  private look(at: () => Vec3 | null, choice: () => Choice = () => null): HTMLButtonElement {
    return button('Look at', () => {
      const p = at();
      if (p) this.stage.lookAt(p);
      this.choose(choice());
    });
  }

  private placeRow() {
    let place: Place | null = null;
    const go = this.goButton(() => place?.at ?? null);
    const { element, title, more } = this.row(() => [this.look(() => place?.at ?? null), go]);
    return { element, update: (p: Place) => {
      place = p;
      go.hidden = !p.goes;
      setText(title, p.name);
      setText(more, p.where);
    } };
  }

  private objectRow() {
    let o: SceneObject | null = null;
    const centre = () => o?.centre ?? null;
    const { element, title, more } = this.row(() => [
      this.look(centre, () => o && { kind: 'object', id: o.id }), this.goButton(centre)]);
    return { element, update: (object: SceneObject) => {
      o = object;
      element.classList.toggle('chosen', this.things.isChosen('object', object.id));
      setText(title, objectName(object));
      setText(more, `${object.extent.map(e => (100 * e).toFixed(0)).join(' x ')} cm at `
        + `${words(object.centre)}${object.seen === false ? ', not seen now' : ''}`);
    } };
  }

  private markRow() {
    let mark: { id: number; points: Vec3[] } | null = null;
    const first = () => mark?.points[0] ?? null;
    const { element, title, more } = this.row(() => [
      this.look(first, () => mark && { kind: 'mark', id: mark.id }), this.goButton(first),
      button('Delete', () => { if (mark) this.acts.unmark(mark.id); })]);
    return { element, update: (m: { id: number; points: Vec3[] }) => {
      mark = m;
      element.classList.toggle('chosen', this.things.isChosen('mark', m.id));
      setText(title, `Mark ${m.id}`);
      setText(more, `${m.points.length} points from ${words(m.points[0] ?? null)}`);
    } };
  }

  private movingRow() {
    let at: Vec3 | null = null;
    const { element, title, more } = this.row(() => [this.look(() => at), this.goButton(() => at)]);
    return { element, update: (m: Moving) => {
      at = [m.x, m.y, 0];
      setText(title, 'Moves');
      setText(more, `${m.width.toFixed(2)} m wide at ${m.x.toFixed(2)}, ${m.y.toFixed(2)} m`);
    } };
  }

  private obstacleRow() {
    let o: Obstacle | null = null;
    const fields = h('div', { class: 'fields' });
    const edit = button('Change', () => {
      this.choose(fields.hidden ? { kind: 'obstacle', id: o!.id } : null);
      fields.hidden = !fields.hidden;
      edit.setAttribute('aria-expanded', String(!fields.hidden));
      if (!fields.hidden) fields.replaceChildren(...this.obstacleFields(o!));
    }, { 'aria-expanded': 'false' });
    fields.hidden = true;
    const { element, title, more } = this.row(() => [this.look(() => o?.centre ?? null,
      () => o && { kind: 'obstacle', id: o.id }), edit,
      button('Delete', () => { if (o) this.acts.erase(o.id); })]);
    element.append(fields);
    return { element, update: (obstacle: Obstacle) => {
      o = obstacle;
      element.classList.toggle('chosen', this.things.isChosen('obstacle', obstacle.id));
      setText(title, `Keep-out ${obstacle.id}, ${obstacle.kind}`);
      setText(more, `${words(obstacle.centre)}, half ${obstacle.half[0].toFixed(2)} m`);
    } };
  }

  private obstacleFields(o: Obstacle): Node[] {
    const values: [string, number][] = [['x m', o.centre[0]], ['y m', o.centre[1]],
      ['turn deg', o.yaw * 180 / Math.PI], [o.kind === 'disc' ? 'radius m' : 'half length m',
        o.half[0]], ['half width m', o.half[1]], ['half height m', o.half[2]]];
    const inputs = values.map(([name, value]) => {
      const input = h('input', { type: 'number', step: '0.05', 'aria-label': name });
      input.value = value.toFixed(2);
      return input;
    });
    const apply = button('Apply', () => {
      const [x, y, turn, a, b, c] = inputs.map(i => Number(i.value)) as
        [number, number, number, number, number, number];
      this.acts.draw({ ...o, centre: [x, y, o.centre[2]], yaw: turn * Math.PI / 180,
        half: [a, o.kind === 'disc' ? a : b, c] });
    });
    return [...inputs.map((input, i) => h('label', {}, values[i]![0], input)), apply];
  }

  private goButton(at: () => Vec3 | null): HTMLButtonElement {
    return button('Go near', () => {
      const p = at();
      const robot = this.store.pose?.robot;
      if (!p || !robot) return;
      const way = Math.hypot(robot[0] - p[0], robot[1] - p[1]) || 1;
      this.acts.goTo(p[0] + aside * (robot[0] - p[0]) / way, p[1] + aside * (robot[1] - p[1]) / way,
        Math.atan2(p[1] - robot[1], p[0] - robot[0]));
    });
  }

  private goForm(): HTMLElement {
    const inputs = ['x m', 'y m', 'heading deg'].map(name =>
      h('input', { type: 'number', step: '0.05', 'aria-label': name, placeholder: name }));
    const form = h('form', { submit: event => {
      event.preventDefault();
      const [x, y, yaw] = inputs.map(input => input.value === '' ? NaN : Number(input.value)) as
        [number, number, number];
      if (Number.isFinite(x) && Number.isFinite(y)) {
        this.acts.goTo(x, y, Number.isFinite(yaw) ? yaw * Math.PI / 180 : undefined);
      } else {
        this.acts.say('A place needs x and y in metres.', 'refused');
      }
    } }, h('div', { class: 'fields' }, ...inputs, h('button', { type: 'submit' }, 'Go there')));
    return form;
  }
}
