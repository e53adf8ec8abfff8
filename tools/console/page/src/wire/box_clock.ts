// When the box made a view, by this page's clock. Each token carries the page's time and the box
// says it back in a message with the box's own time: what the box makes after that was made after
// the page had asked. So a line that is late shows as late from the first message on, and neither
// clock has to be right.
//
// A box on the real clock runs at the page's rate, so the best of the newest echoes counts. A paced
// one may be slower than that, now more and now less: of an echo then only the order counts.

const span = 2;       // s that an echo is looked at: clocks drift apart
const jitter = 0.02;  // s by which two clocks may differ over it

interface Echo { asked: number; there: number }

export class BoxClock {
  roundTrip: number | null = null;  // s, of the newest echo
  private echoes: Echo[] = [];

  // `asked`: what the token said; `there`: the box's time in the answer.
  heard(asked: number, there: number, now: number): void {
    if (asked > now) return;
    this.roundTrip = now - asked;
    this.echoes = this.echoes.filter(echo => echo.asked > now - this.roundTrip! - span);
    this.echoes.push({ asked, there });
  }

  forget(): void {
    this.roundTrip = null;
    this.echoes = [];
  }

  // The earliest instant at which the box can have said `there`, in a view that has come `now`;
  // -Infinity where no echo tells. An echo that puts it after its coming is of a clock that was set
  // since.
  madeAfter(there: number, now: number, paced: boolean): number {
    let best = -Infinity;
    for (const echo of this.echoes) {
      if (paced && echo.there >= there) continue;
      const at = paced ? echo.asked : echo.asked + there - echo.there;
      if (at <= now + jitter) best = Math.max(best, at);
    }
    return Math.min(best, now);
  }
}
