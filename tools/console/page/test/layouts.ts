// Keyboards of other people, by the places of their keys: what each one prints without Shift.
const places = [
  'Digit1 Digit2 Digit3 Digit4 Digit5 Digit6 Digit7 Digit8 Digit9 Digit0 Minus Equal',
  'KeyQ KeyW KeyE KeyR KeyT KeyY KeyU KeyI KeyO KeyP BracketLeft BracketRight',
  'KeyA KeyS KeyD KeyF KeyG KeyH KeyJ KeyK KeyL Semicolon Quote',
  'KeyZ KeyX KeyC KeyV KeyB KeyN KeyM Comma Period Slash',
].flatMap(row => row.split(' '));

// ´ ΄ ^ ¨ stand for keys that are dead there.
const printed = {
  US: ["1234567890-=", "qwertyuiop[]", "asdfghjkl;'", 'zxcvbnm,./'],
  German: ['1234567890ß´', 'qwertzuiopü+', 'asdfghjklöä', 'yxcvbnm,.-'],
  French: ['&é"\'(-è_çà)=', 'azertyuiop^$', 'qsdfghjklmù', 'wxcvbn,;:!'],
  Russian: ['1234567890-=', 'йцукенгшщзхъ', 'фывапролджэ', 'ячсмитьбю.'],
  Greek: ['1234567890-=', ';ςερτυθιοπ[]', "ασδφγηξκλ΄'", 'ζχψωβνμ,./'],
  Dvorak: ['1234567890[]', "',.pyfgcrl/=", 'aoeuidhtns-', ';qjkxbmwvz'],
  'Turkish F': ['1234567890/-', 'fgğıodrnhpqw', 'uieaütkmlyş', 'jövcçzsb.,'],
  Colemak: ['1234567890-=', 'qwfpgjluy;[]', "arstdhneio'", 'zxcvbkm,./'],
  Czech: ['+ěščřžýáíé=´', 'qwertzuiopú)', 'asdfghjklů§', 'yxcvbnm,.-'],
};

export type LayoutName = keyof typeof printed;
export interface Key { code: string; key: string }

const dead = '´΄^¨';

export function keysOf(name: LayoutName): Key[] {
  const signs = [...printed[name].join('')];
  if (signs.length !== places.length) throw new Error(`${name}: ${signs.length} keys`);
  return signs.map((sign, i) => ({ code: places[i]!, key: dead.includes(sign) ? 'Dead' : sign }));
}

export const layoutNames = Object.keys(printed) as LayoutName[];
// Those that are tried in real browsers.
export const triedLayouts: LayoutName[] = ['US', 'German', 'French', 'Russian', 'Greek', 'Dvorak'];

// The key that a person presses for the act of this letter: the one with the letter on it, or in
// a script that has none, the one where a US keyboard has it.
export function keyOf(keys: Key[], letter: string): Key {
  const us = keys.find(k => k.code === `Key${letter.toUpperCase()}`)!;
  return keys.find(k => k.key === letter) ?? us;
}
