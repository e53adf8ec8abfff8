// The line about a gamepad whose mapping nobody knows, and the steps that teach it.
import { PadLesson } from '../act/pad_lesson';
import { Pads } from '../act/pads';
import { button, by, h, setText } from './dom';

export class PadNote {
  private readonly text = h('span');
  private readonly teach = button('Teach it', () => this.begin());
  private readonly end = button('Leave it', () => this.leave());
  private readonly note = h('div', { class: 'note', role: 'status', hidden: true }, this.text,
    this.teach, this.end);
  private lesson: PadLesson | null = null;
  private id = '';    // of the one that is taught
  private left = '';  // of one that a person does not want to teach

  constructor(private readonly pads: Pads, private readonly said: (text: string) => void) {
    by('pad').prepend(this.note);
  }

  // Also a gamepad of a known mapping, which a person may want otherwise.
  begin(): void {
    const pad = this.pads.unknown() ?? this.pads.connected()[0];
    if (!pad) {
      this.said('No gamepad is seen: press a button of it.');
      return;
    }
    this.id = pad.id;
    this.lesson = new PadLesson();
    this.pads.resting = true;
  }

  // By the timer of the gamepads.
  poll(): void {
    const { lesson } = this;
    if (lesson) {
      const pad = this.pads.connected().find(one => one.id === this.id);
      if (!pad) {
        this.stop();
        this.said('The gamepad was lost: it is not taught.');
      } else {
        lesson.poll(pad);
        if (lesson.done) {
          this.stop();
          this.pads.teach(this.id, lesson.map);
          this.said('The gamepad is taught. This browser keeps it.');
        }
      }
    }
    this.show();
  }

  private show(): void {
    const unknown = this.pads.unknown();
    this.note.hidden = !this.lesson && (!unknown || unknown.id === this.left);
    if (this.note.hidden) return;
    this.teach.hidden = this.lesson !== null;
    setText(this.text, this.lesson?.text
      ?? `Gamepad "${unknown!.id}": this browser does not know which axis and button is which, `
      + 'so it does nothing.');
  }

  private leave(): void {
    if (!this.lesson) this.left = this.pads.unknown()?.id ?? '';
    this.stop();
    this.show();
  }

  private stop(): void {
    this.lesson = null;
    this.pads.resting = false;
  }
}
