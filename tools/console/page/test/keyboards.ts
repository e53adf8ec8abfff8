// Keyboards of other people, in Chromium: by its own events, which name key and place apart.
import { context, desk, twin } from './bench';
import { Key, triedLayouts } from './layouts';
import { Keyboard, keySuite, Modifiers } from './key_suite';

const cdp = await context.newCDPSession(desk.page);
const inputMethodCode = 229;

async function send(type: 'rawKeyDown' | 'keyUp', { key, code }: Key,
  { shift, ctrl, inputMethod }: Modifiers = {}): Promise<void> {
  await cdp.send('Input.dispatchKeyEvent', { type, key, code,
    modifiers: (shift ? 8 : 0) + (ctrl ? 2 : 0),
    windowsVirtualKeyCode: inputMethod ? inputMethodCode : 0 });
}

const keyboard: Keyboard = {
  down: (key, modifiers) => send('rawKeyDown', key, modifiers),
  up: (key, modifiers) => send('keyUp', key, modifiers),
};
keySuite(desk, twin, keyboard, triedLayouts);
