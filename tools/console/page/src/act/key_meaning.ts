// What a press of a key means, on whichever keyboard. Driving goes by the key's place, acts by the
// letter printed on it; what has no such letter (Russian, Greek) or digit (French) goes by place.
import { Command } from './drive';

// vx vy wz, by the key's place on the keyboard, so that other layouts have them there too.
export const driveKeys: Record<string, Command> = {
  KeyW: [1, 0, 0], KeyS: [-1, 0, 0],
  KeyA: [0, 1, 0], KeyD: [0, -1, 0],
  KeyQ: [0, 0, 1], KeyE: [0, 0, -1],
};

export type Act = 'engage' | 'hold' | 'clear' | 'view' | 'record' | 'note' | 'accept';

export const letters: Record<Act, string> = { engage: 'g', hold: 'h', clear: 'c', view: 'v',
  record: 'r', note: 'n', accept: 'y' };
export const undoLetter = 'z';  // with Ctrl, alone: on a French keyboard Z is a driving place

export type Meaning =
  | { kind: 'drive'; command: Command }
  | { kind: 'act'; act: Act | 'undo' | 'help' | 'nearer' | 'farther' | 'delete' }
  | { kind: 'tool'; digit: string };

export type Press = Pick<KeyboardEvent, 'key' | 'code' | 'shiftKey' | 'ctrlKey' | 'metaKey'
  | 'altKey' | 'isComposing' | 'keyCode'>;

const actOf = new Map(Object.entries(letters).map(([act, letter]) => [letter, act as Act]));
const symbols: Record<string, 'help' | 'nearer' | 'farther'> = { '?': 'help', '؟': 'help',
  '+': 'nearer', '=': 'nearer', '-': 'farther', '−': 'farther' };
const inputMethodCode = 229;  // keyCode of a key that an input method has taken

// Of a script in which no act has a letter.
export function isForeign(key: string): boolean {
  return /^[\p{L}\p{M}]+$/u.test(key) && !/[\p{Script=Latin}\p{Script=Common}]/u.test(key);
}

export function isStop(press: Press): boolean {
  return press.code === 'Space' || press.key === ' ';
}

// In lower case; '': of no act in any layout.
function letterOf(press: Press): string {
  if (/^[a-z]$/i.test(press.key)) return press.key.toLowerCase();
  return isForeign(press.key) ? /^Key([A-Z])$/.exec(press.code)?.[1]?.toLowerCase() ?? '' : '';
}

function digitOf(press: Press): string {
  if (/^\d$/.test(press.key)) return press.key;
  return press.shiftKey ? '' : /^Digit(\d)$/.exec(press.code)?.[1] ?? '';
}

function symbolOf(press: Press): 'help' | 'nearer' | 'farther' | undefined {
  if (symbols[press.key]) return symbols[press.key];
  if (press.code === 'Slash' && press.shiftKey && isForeign(press.key)) return 'help';
  if (press.shiftKey || /^[a-z]$/i.test(press.key)) return undefined;
  return press.code === 'Equal' ? 'nearer' : press.code === 'Minus' ? 'farther' : undefined;
}

// null: nothing. A driving place always drives; only with Shift, or Ctrl, it is the act of its
// letter instead, so that each act is within reach on each layout.
export function meaningOf(press: Press): Meaning | null {
  const taken = press.isComposing || press.keyCode === inputMethodCode;
  const letter = taken ? '' : letterOf(press);
  if (press.ctrlKey || press.metaKey || press.altKey) {
    const alone = press.ctrlKey !== press.metaKey && !press.altKey && !press.shiftKey;
    return alone && letter === undoLetter ? { kind: 'act', act: 'undo' } : null;
  }
  const act = actOf.get(letter);
  const command = driveKeys[press.code];
  if (command && !(act && press.shiftKey)) return { kind: 'drive', command };
  if (act) return { kind: 'act', act };
  if (taken) return null;
  const digit = digitOf(press);
  if (digit) return { kind: 'tool', digit };
  const symbol = press.key === 'Delete' ? 'delete' : symbolOf(press);
  return symbol ? { kind: 'act', act: symbol } : null;
}
