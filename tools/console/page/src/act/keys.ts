// Keys of the page. Space stops wherever the focus is, but in a text being typed. Motion keys act
// only while no control has the focus.
import { Drive } from './drive';
import { isStop, Meaning, meaningOf } from './key_meaning';
import { KeyNames } from './key_names';

export interface KeyActs {
  stop: () => void;
  escape: () => void;
  acts: Record<(Meaning & { kind: 'act' })['act'], () => void>;
  tool: (digit: string) => void;
}

function isText(target: EventTarget | null): boolean {
  return target instanceof HTMLTextAreaElement || (target instanceof HTMLInputElement
    && !['range', 'checkbox', 'radio', 'button'].includes(target.type)
    && target.type !== 'number');
}

function isControl(target: EventTarget | null): boolean {
  return target instanceof HTMLElement
    && target.closest('button, input, select, textarea, a[href], dialog, #picture') !== null;
}

export function listenToKeys(canvas: HTMLCanvasElement, drive: Drive, names: KeyNames,
  acts: KeyActs): void {
  addEventListener('keydown', event => {
    if (isStop(event) && !isText(event.target)) {
      event.preventDefault();
      event.stopPropagation();
      if (!event.repeat) acts.stop();
      return;
    }
    // While it is down, macOS tells of no key that is let go.
    if (event.key === 'Meta') drive.releaseAll();
    const inPicture = (event.target as HTMLElement).closest?.('#picture') ?? null;
    const inDialog = Boolean((event.target as HTMLElement).closest?.('dialog'));
    if (event.key === 'Escape' && !event.isComposing && !inDialog) {
      drive.releaseAll();
      canvas.focus();
      // From the picture it only leads back: what was chosen there is kept.
      if (inPicture === null) acts.escape();
      return;
    }
    names.learn(event);
    const meaning = meaningOf(event);
    if (meaning === null) return;
    const act = meaning.kind === 'act' ? meaning.act : null;
    const accepts = inPicture !== null && act === 'accept';
    const deletes = event.target instanceof HTMLButtonElement && act === 'delete';
    if (isControl(event.target) && !accepts && !deletes) return;
    event.preventDefault();
    // A key that was down before the loss repeats: that is no new press.
    if (event.repeat) return;
    if (meaning.kind === 'drive') drive.press(event.code, meaning.command);
    else if (meaning.kind === 'tool') acts.tool(meaning.digit);
    else acts.acts[meaning.act]();
  }, { capture: true });
  addEventListener('keyup', event => {
    if (isStop(event) && !isText(event.target)) event.preventDefault();
    drive.release(event.code);
  }, { capture: true });
  // From the scene to a control while a key is down: the key no longer counts.
  addEventListener('focusin', event => { if (isControl(event.target)) drive.releaseAll(); });
}
