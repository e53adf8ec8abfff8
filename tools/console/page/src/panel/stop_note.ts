// What became of a stop: that it is on its way, and, loud and until somebody has read it, that no
// answer came. A stop that has arrived is told by its toast.
import { StopState } from '../act/acts';
import { button, by } from './dom';

export const silentText = 'STOP did not reach the box, or the box does not answer. Press the stop '
  + 'on the robot now.';

export class StopNote {
  private readonly line = by('stop-note');

  show(state: StopState): void {
    this.line.hidden = state === 'arrived';
    this.line.classList.toggle('silent', state === 'silent');
    if (state === 'sent') this.line.replaceChildren('STOP sent, no answer yet');
    if (state === 'silent') {
      this.line.replaceChildren(silentText, button('I have read it', () => {
        this.line.hidden = true;
      }));
    }
  }
}
