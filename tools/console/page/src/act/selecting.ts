// An object by clicks: the box proposes a mask, further clicks add to it or take away, and only
// what was seen is accepted.
import { Selection } from '../wire/types';
import { moved } from '../wire/standing';
import { Acts } from './acts';

export interface Click { u: number; v: number; sign: 1 | -1 }

export class Selecting {
  sign: 1 | -1 = 1;
  proposal: Selection | null = null;
  clicks: Click[] = [];
  size: number[] | null = null;  // m, of what is proposed
  scant = false;  // too little of what is proposed was measured to be an object
  onChange: () => void = () => {};
  private camera: number[] | null = null;  // of the picture of the first click

  constructor(private readonly acts: Acts) {
    acts.store.on('selection', selection => {
      if (this.clicks.length === 0) return;  // dropped meanwhile
      this.proposal = selection;
      this.onChange();
    });
  }

  clickPoint(at: [number, number] | null): void {
    if (at) this.click(...at);
    else this.acts.say('The picture does not show this place: turn the robot to it.', 'refused');
  }

  click(u: number, v: number, sign: 1 | -1 = this.sign): void {
    const first = this.clicks.length === 0;
    if (first && sign < 0) {
      this.acts.say('The first click chooses; later ones can take away.', 'refused');
      return;
    }
    // The box keeps the picture of the first click: further ones are places in that one.
    const { picture } = this.acts.store;
    if (first) this.camera = picture?.camera ?? null;
    else if (this.camera && picture && moved(this.camera, picture.camera)) {
      this.acts.say('The camera has moved since the first click: choose it again.', 'refused');
      return;
    }
    const click: Click = { u, v, sign };
    this.clicks.push(click);
    this.onChange();
    void this.acts.link.act('select', { u, v, sign, new: first }).then(answer => {
      if (answer.ok) {
        if (!this.clicks.includes(click)) return;  // dropped meanwhile: others' size is not its
        this.size = (answer.result?.size_m as number[] | undefined) ?? null;
        this.scant = !this.size;
        this.onChange();
        return;
      }
      this.clicks = this.clicks.filter(c => c !== click);
      this.acts.say(`Refused: ${answer.why ?? 'no reason given'}`, 'refused');
      this.onChange();
    });
  }

  async accept(name: string): Promise<void> {
    if (!this.proposal) return;
    const keys = name ? { proposal: this.proposal.proposal, name }
      : { proposal: this.proposal.proposal };
    const { clicks } = this;
    const answer = await this.acts.ask('accept', keys, 'The object is known now.');
    if (answer.ok && this.clicks === clicks) this.drop();  // else others have begun meanwhile
  }

  // What is proposed, in words.
  get text(): string {
    const { length } = this.clicks;
    const clicks = length === 1 ? '1 click' : `${length} clicks`;
    if (!this.proposal) return `${clicks}, looking`;
    if (this.scant) return `${clicks}, too little of it was measured: click on more of it`;
    return this.size ? `${clicks}, ${this.size.map(m => m.toFixed(2)).join(' × ')} m` : clicks;
  }

  drop(): void {
    this.proposal = null;
    this.size = null;
    this.scant = false;
    this.clicks = [];
    this.sign = 1;
    this.onChange();
  }
}
