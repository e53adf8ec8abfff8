// Acts: asked of the box, and what it answers told to the person.
import { Link } from '../wire/link';
import { Store } from '../wire/store';
import { Answer, Hold, Obstacle, Vec3 } from '../wire/types';
import { Held, lateLine } from './held';

export type Tone = 'done' | 'refused' | 'news';
export type Say = (text: string, tone: Tone) => void;

const newPress = 'let go first, then press again';  // the box, of a hold that it has lost

// Of the newest press: what is known of its way to the box.
export type StopState = 'sent' | 'arrived' | 'silent';

export class Acts {
  onStop: (state: StopState) => void = () => {};
  private stops = 0;
  private stopState: StopState = 'arrived';

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
    const press = ++this.stops;
    this.stopIs('sent');
    this.held.lose('stop was pressed');
    void sent.then(taken => {
      if (press !== this.stops) return;
      this.stopIs(taken ? 'arrived' : 'silent');
      if (taken) this.say('Stop: the box ramps down.', 'done');
    });
  }

  // An answer that nobody waits for any more.
  late(act: string, answer: Answer, after: number): void {
    const text = answer.result?.text;
    const what = !answer.ok ? `refused: ${answer.why ?? 'no reason given'}`
      : typeof text === 'string' ? text : 'done.';
    if (act !== 'stop') this.say(`Late, after ${after.toFixed(1)} s, ${act}: ${what}`, 'news');
    else if (answer.ok && this.stopState === 'silent') {
      this.stopIs('arrived');
      this.say(`The stop has arrived late, after ${after.toFixed(1)} s.`, 'news');
    }
  }

  private stopIs(state: StopState): void {
    this.stopState = state;
    this.onStop(state);
  }

  async engage(): Promise<void> {
    const goesOn = this.held.has('engage') && this.store.slow.mode === 'engaged';
    if (!goesOn) this.held.pressAnew('engage');
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

  tell(act: string, keys: object): number { return this.link.tell(act, keys); }

  nextObstacleId(): number {
    const taken = new Set((this.store.slow.obstacles ?? []).map(o => o.id));
    let id = 1;
    while (taken.has(id)) ++id;
    return id;
  }

  lostText(why: string, holds: Hold[]): string {
    const what = holds.map(h => h === 'drive' ? 'driving' : h === 'hand' ? 'touching'
      : 'the engagement');
    const said = why === newPress ? lateLine : why;
    return `Let go of ${what.join(' and ')}: ${said}. Press again to go on.`;
  }
}
