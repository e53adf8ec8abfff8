// Acts: asked of the box, and what it answers told to the person.
import { Link } from '../wire/link';
import { Store } from '../wire/store';
import { Answer, Obstacle, Vec3 } from '../wire/types';
import { Held, Hold } from './held';

export type Tone = 'done' | 'refused' | 'news';
export type Say = (text: string, tone: Tone) => void;

export class Acts {
  constructor(readonly link: Link, readonly store: Store, readonly held: Held,
    readonly say: Say) {}

  async ask(act: string, keys: object, done: string): Promise<Answer> {
    const answer = await this.link.act(act, keys);
    const text = answer.result?.text;  // the box knows more than the page
    if (answer.ok) this.say(typeof text === 'string' ? text : done, 'done');
    else this.say(`Refused: ${answer.why ?? 'no reason given'}`, 'refused');
    return answer;
  }

  // First of all and beside everything: no look at roles, at the connection, at other acts.
  stop(): void {
    const sent = this.link.stop();
    this.held.lose('stop was pressed');
    void sent.then(taken => {
      this.say(taken ? 'Stop: the box ramps down.' : 'STOP did not reach the box. '
        + 'Use the stop on the robot.', taken ? 'done' : 'refused');
    });
  }

  async engage(): Promise<void> {
    this.held.press('engage');
    const answer = await this.ask('engage', {},
      'Engaged while this page is shown.');
    if (!answer.ok) this.held.release('engage');
  }

  hold(): void {
    this.held.release('engage');
    void this.ask('hold', {}, 'Held: the wheels stand.');
  }

  clear(): void { void this.ask('clear', {}, 'Cleared.'); }
  undo(): void { void this.ask('undo', {}, 'The newest act is taken back.'); }
  cancel(): void { void this.ask('cancel', {}, 'Goal and path are dropped.'); }
  mark(points: Vec3[]): void { void this.ask('mark', { points }, 'The mark is drawn.'); }

  goTo(x: number, y: number, yaw?: number): void {
    void this.ask('go_to', yaw === undefined ? { x, y } : { x, y, yaw },
      `Goal: ${x.toFixed(2)}, ${y.toFixed(2)}.`);
  }

  draw(obstacle: Obstacle): void {
    void this.ask('draw', { obstacle }, `Keep-out ${obstacle.id} is placed.`);
  }

  unmark(id: number): void { void this.ask('unmark', { mark_id: id }, `Mark ${id} is gone.`); }

  erase(id: number): void {
    void this.ask('erase', { obstacle_id: id },
      id === 0 ? 'All keep-outs are gone.' : `Keep-out ${id} is gone.`);
  }

  forget(centre: Vec3, half: Vec3): void {
    void this.ask('forget', { centre, half }, 'The region is forgotten.');
  }

  record(on: boolean): void {
    void this.ask('record', { on }, on ? 'A piece begins.' : 'The piece is ended.');
  }

  note(text: string): void { void this.ask('note', { text }, 'Noted on the timeline.'); }

  tell(act: string, keys: object): void { this.link.tell(act, keys); }

  nextObstacleId(): number {
    const taken = new Set((this.store.slow.obstacles ?? []).map(o => o.id));
    let id = 1;
    while (taken.has(id)) ++id;
    return id;
  }

  lostText(why: string, holds: Hold[]): string {
    const what = holds.map(h => h === 'drive' ? 'driving' : h === 'hand' ? 'touching'
      : 'the engagement');
    return `Let go of ${what.join(' and ')}: ${why}. Press again to go on.`;
  }
}
