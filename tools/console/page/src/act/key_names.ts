// What is printed on the keys of this person's keyboard: told by the browser where it does
// (navigator.keyboard, Chromium's), else learned from each key that is pressed.
import { driveKeys, isForeign, Press } from './key_meaning';

interface KeyboardOfNavigator { getLayoutMap?: () => Promise<Map<string, string>> }

export class KeyNames {
  onChange: () => void = () => {};
  private readonly told = new Map<string, string>();    // key by place
  private readonly learned = new Map<string, string>();  // the newest press last

  async ask(keyboard = (navigator as { keyboard?: KeyboardOfNavigator }).keyboard): Promise<void> {
    const map = await keyboard?.getLayoutMap?.().catch(() => null);
    if (!map) return;
    for (const [code, key] of map) this.told.set(code, key.toLowerCase());
    this.onChange();
  }

  learn(press: Press): void {
    if (press.ctrlKey || press.metaKey || press.altKey || press.isComposing) return;
    if (!/^Key[A-Z]$/.test(press.code) || !/^\p{L}\p{M}*$|^[^\p{L}]$/u.test(press.key)) return;
    // Shift gives another sign where there is no letter.
    if (press.shiftKey && !/\p{L}/u.test(press.key)) return;
    const key = press.key.toLowerCase();
    const before = this.learned.get(press.code);
    if (before !== undefined && before !== key) this.forgetBefore(press.code);
    // What the browser told is of another layout.
    if (this.told.has(press.code) && this.told.get(press.code) !== key) this.told.clear();
    this.learned.delete(press.code);
    this.learned.set(press.code, key);
    if (before !== key) this.onChange();
  }

  // All places of driving are known by the person's own names.
  get known(): boolean { return Object.keys(driveKeys).every(code => this.at(code) !== null); }

  // Of a driving place, for a person: by a US keyboard where nothing else is known.
  place(code: string): string {
    const own = this.at(code)?.toUpperCase();
    const plain = code.replace('Key', '');
    return own === undefined ? plain : isForeign(own) ? `${own} (${plain})` : own;
  }

  // Of the act that goes by this letter.
  letter(letter: string): string {
    const plain = letter.toUpperCase();
    const all = new Map([...this.told, ...this.learned]);
    for (const [code, key] of all) {
      if (key === letter) return driveKeys[code] ? `Shift ${plain}` : plain;
    }
    const own = this.at(`Key${plain}`);
    return own !== null && isForeign(own) ? `${own.toUpperCase()} (${plain})` : plain;
  }

  // The layout was changed after this key was pressed last: what was learned before is of that one.
  private forgetBefore(code: string): void {
    for (const older of [...this.learned.keys()]) {
      this.learned.delete(older);
      if (older === code) return;
    }
  }

  private at(code: string): string | null {
    return this.learned.get(code) ?? this.told.get(code) ?? null;
  }
}
