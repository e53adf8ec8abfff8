// Gamepads: by the standard mapping, or as a person has taught this browser. Where a browser knows
// no mapping (Firefox on Linux: ''), numbers of axes and buttons mean nothing by themselves.
export interface PadReading {
  forward: number;   // -1..1, 0 within the dead zone; left stick
  left: number;
  turn: number;      // right stick, positive to the left
  deadMan: boolean;  // held: the sticks drive
  press: boolean;    // presses at the cross-hair
}

interface Axis { index: number; sign: 1 | -1 }

export interface PadMap { forward: Axis; left: Axis; turn: Axis; deadMan: number; press: number }

const standard: PadMap = { forward: { index: 1, sign: -1 }, left: { index: 0, sign: -1 },
  turn: { index: 2, sign: -1 }, deadMan: 5, press: 0 };  // right shoulder, A
const deadZone = 0.15;  // of a stick
const mostIndex = 63;   // of an axis or a button that is believed

type Kept = Pick<Storage, 'getItem' | 'setItem' | 'removeItem'>;

function storedName(id: string): string { return `gamepad ${id}`; }

// What lies in a browser may be damaged: null then.
export function readMap(text: string | null): PadMap | null {
  const index = (value: unknown) => Number.isInteger(value) && Number(value) >= 0
    && Number(value) <= mostIndex;
  try {
    const map = JSON.parse(text ?? 'null') as PadMap;
    const axes = [map.forward, map.left, map.turn];
    const good = axes.every(a => index(a.index) && (a.sign === 1 || a.sign === -1))
      && new Set(axes.map(a => a.index)).size === axes.length
      && index(map.deadMan) && index(map.press) && map.deadMan !== map.press;
    return good ? map : null;
  } catch {
    return null;
  }
}

function read(pad: Gamepad, map: PadMap): PadReading {
  const stick = ({ index, sign }: Axis) => {
    const value = pad.axes[index] ?? 0;
    return Math.abs(value) < deadZone ? 0 : sign * value;
  };
  const pressed = (button: number) => pad.buttons[button]?.pressed ?? false;
  return { forward: stick(map.forward), left: stick(map.left), turn: stick(map.turn),
    deadMan: pressed(map.deadMan), press: pressed(map.press) };
}

export class Pads {
  resting = false;  // while one is taught nothing is driven by it
  private readonly taught = new Map<string, PadMap | null>();  // by id, as it lies in the browser

  constructor(private readonly list: () => (Gamepad | null)[],
    private readonly kept: Kept | null = null) {}

  // Of the first one whose mapping is known; null: none.
  reading(): PadReading | null {
    if (this.resting) return null;
    for (const pad of this.connected()) {
      const map = this.mapOf(pad);
      if (map) return read(pad, map);
    }
    return null;
  }

  // One that does nothing here, where none does something.
  unknown(): Gamepad | null {
    const all = this.connected();
    return all.some(pad => this.mapOf(pad)) ? null : all[0] ?? null;
  }

  connected(): Gamepad[] {
    return this.list().filter((pad): pad is Gamepad => pad !== null && pad.connected);
  }

  teach(id: string, map: PadMap): void {
    this.taught.set(id, map);
    this.kept?.setItem(storedName(id), JSON.stringify(map));
  }

  private mapOf(pad: Gamepad): PadMap | null {
    if (!this.taught.has(pad.id)) {
      this.taught.set(pad.id, readMap(this.kept?.getItem(storedName(pad.id)) ?? null));
    }
    return this.taught.get(pad.id) ?? (pad.mapping === 'standard' ? standard : null);
  }
}
