// Keys of the page. Space stops wherever the focus is, but in a text being typed. Motion keys act
// only while no control has the focus.
import { Drive, driveKeys } from './drive';

export interface KeyActs {
  stop: () => void;
  plain: Record<string, () => void>;  // by event.key in lower case, or by event.code
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

export function listenToKeys(canvas: HTMLCanvasElement, drive: Drive, acts: KeyActs): void {
  addEventListener('keydown', event => {
    if (event.code === 'Space' && !isText(event.target)) {
      event.preventDefault();
      event.stopPropagation();
      if (!event.repeat) acts.stop();
      return;
    }
    const inPicture = (event.target as HTMLElement).closest?.('#picture') ?? null;
    if (event.key === 'Escape' && !(event.target as HTMLElement).closest?.('dialog')) {
      drive.releaseAll();
      canvas.focus();
      // From the picture it only leads back: what was chosen there is kept.
      if (inPicture === null) acts.plain.escape?.();
      return;
    }
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const accepts = inPicture !== null && event.key.toLowerCase() === 'y';
    const deletes = event.target instanceof HTMLButtonElement && event.key === 'Delete';
    if (isControl(event.target) && !accepts && !deletes) return;
    const command = driveKeys[event.code];
    if (command) {
      event.preventDefault();
      // A key that was down before the loss repeats: that is no new press.
      if (!event.repeat) drive.press(event.code, command);
      return;
    }
    const plain = acts.plain[event.key.toLowerCase()] ?? acts.plain[event.code];
    if (!plain || event.repeat) return;
    event.preventDefault();
    plain();
  }, { capture: true });
  addEventListener('keyup', event => {
    if (event.code === 'Space' && !isText(event.target)) event.preventDefault();
    drive.release(event.code);
  }, { capture: true });
  // From the scene to a control while a key is down: the key no longer counts.
  addEventListener('focusin', event => { if (isControl(event.target)) drive.releaseAll(); });
}
