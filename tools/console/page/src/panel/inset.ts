// The newest picture of the camera with its age as the colour and the form of its border; clicks in
// it choose objects. A picture that no longer comes locks driving, and that is to be seen. The age
// is of what is drawn, not of what has come: a picture may have no colour, or not be readable.
// Where no colour comes any more the depth is drawn as grey.
import { Selecting } from '../act/selecting';
import { Tools } from '../act/tools';
import { Store } from '../wire/store';
import { Head, Picture } from '../wire/types';
import { by, h, setText } from './dom';

const lateAfter = 0.35;   // s
const frozenAfter = 1.0;  // s: beyond, no driving by what is seen

const [near, far] = [300, 5000];  // mm: white and dark grey

export type Freshness = 'fresh' | 'late' | 'frozen';

export function freshness(age: number): Freshness {
  return age < lateAfter ? 'fresh' : age < frozenAfter ? 'late' : 'frozen';
}

// Opaque grey of a depth in mm, as a little-endian pixel. Near is bright; black: nothing was
// measured.
function greyOfDepth(mm: number): number {
  const v = mm === 0 ? 0 : Math.floor(255 - 215 * (Math.min(far, Math.max(near, mm)) - near)
    / (far - near));
  return 0xff000000 + 0x10101 * v;
}

let greys: Uint32Array | null = null;  // of each depth: a picture is a look-up a pixel

export function greyOf(depth: Uint16Array): Uint8ClampedArray<ArrayBuffer> {
  greys ??= Uint32Array.from({ length: 65536 }, (_, mm) => greyOfDepth(mm));
  const rgba = new Uint32Array(depth.length);
  for (let i = 0; i < depth.length; ++i) rgba[i] = greys[depth[i]!]!;
  return new Uint8ClampedArray(rgba.buffer);
}

interface Shown { image: ImageBitmap | HTMLCanvasElement; head: Head }
interface Depth { picture: Picture; head: Head }

export class Inset {
  state: Freshness = 'frozen';
  private readonly canvas = by<HTMLCanvasElement>('picture');
  private readonly age = h('span');
  private readonly word = h('strong');
  private shown: Shown | null = null;
  private waiting: Shown | null = null;  // newer, and not drawn yet
  private depth: Depth | null = null;    // newer than both, to be drawn as grey
  private grey: HTMLCanvasElement | null = null;
  private colourCame = -Infinity;        // s of this page's clock
  private overlay: HTMLCanvasElement | null = null;
  private cross: [number, number] = [0.5, 0.5];

  constructor(private readonly store: Store, private readonly tools: Tools,
    private readonly selecting: Selecting, private readonly chooseTool: () => void) {
    by('age').append(this.word, this.age);
    this.canvas.addEventListener('pointerdown', event => {
      const box = this.canvas.getBoundingClientRect();
      this.click((event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height,
        event.shiftKey || event.altKey ? -1 : undefined);
    });
    this.canvas.addEventListener('keydown', event => this.key(event));
    this.canvas.addEventListener('focus', () => this.draw());
    this.canvas.addEventListener('blur', () => this.draw());
  }

  // Not kept beyond the next one: the layer in the scene closes it.
  show(bitmap: ImageBitmap, head: Head): void {
    this.waiting = { image: bitmap, head };
    this.depth = null;
  }

  // Of each picture that comes: one with colour is shown when it is decoded.
  take(picture: Picture, head: Head): void {
    const now = performance.now() / 1000;
    if (picture.jpeg) this.colourCame = now;
    if (now - this.colourCame <= frozenAfter || picture.depth.length === 0) return;
    this.depth = { picture, head };
  }

  drawNew(): void { if (this.waiting || this.depth) this.draw(); }

  propose(): void {
    const proposal = this.selecting.proposal;
    this.overlay = null;
    if (proposal) {
      const overlay = document.createElement('canvas');
      overlay.width = proposal.width;
      overlay.height = proposal.height;
      const context = overlay.getContext('2d')!;
      const image = context.createImageData(proposal.width, proposal.height);
      for (let i = 0; i < proposal.mask.length; ++i) {
        if (proposal.mask[i]) image.data.set([240, 228, 66, 150], 4 * i);
      }
      context.putImageData(image, 0, 0);
      this.overlay = overlay;
    }
    this.draw();
  }

  // Asked often: an age grows also when nothing comes.
  tick(): Freshness {
    const age = this.store.age(this.shown?.head ?? null);
    const state = freshness(age);
    const grey = this.shown?.image instanceof HTMLCanvasElement ? ', no colour' : '';
    setText(this.age, !Number.isFinite(age) ? 'no picture'
      : (age < 1 ? `${(1000 * age).toFixed(0)} ms old` : `${age.toFixed(1)} s old`) + grey);
    if (state !== this.state || this.word.textContent === '') {
      this.state = state;
      setText(this.word, { fresh: 'Live', late: 'Late',
        frozen: 'FROZEN, no driving' }[state]);
      for (const name of ['fresh', 'late', 'frozen'] as const) {
        by('inset').classList.toggle(name, name === state);
        by('view').classList.toggle(name, name === state);
      }
    }
    return state;
  }

  private click(u: number, v: number, sign?: 1 | -1): void {
    if (this.tools.blocked('object')) return;
    this.chooseTool();
    this.selecting.click(u, v, sign);
  }

  private key(event: KeyboardEvent): void {
    const step = event.shiftKey ? 0.005 : 0.025;
    const move = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, -step],
      ArrowDown: [0, step] }[event.key];
    if (move) {
      this.cross = [Math.min(1, Math.max(0, this.cross[0] + move[0]!)),
        Math.min(1, Math.max(0, this.cross[1] + move[1]!))];
    } else if (event.key === 'Enter' && !event.repeat) {
      this.click(...this.cross, event.shiftKey ? -1 : undefined);
    } else {
      return;
    }
    event.preventDefault();
    event.stopPropagation();
    this.draw();
  }

  // Only of what is drawn: more may come than a slow machine draws.
  private drawDepth({ picture, head }: Depth): void {
    const grey = this.grey ??= document.createElement('canvas');
    grey.width = picture.width;
    grey.height = picture.height;
    grey.getContext('2d')!.putImageData(
      new ImageData(greyOf(picture.depth), picture.width, picture.height), 0, 0);
    this.waiting = { image: grey, head };
  }

  private draw(): void {
    if (this.depth) this.drawDepth(this.depth);
    this.depth = null;
    // A bitmap that was closed meanwhile has no width: what is drawn stays, with its age.
    if (this.waiting && this.waiting.image.width > 0) this.shown = this.waiting;
    this.waiting = null;
    const context = this.canvas.getContext('2d')!;
    const image = this.shown?.image;
    if (image && image.width > 0) {
      if (this.canvas.width !== image.width || this.canvas.height !== image.height) {
        this.canvas.width = image.width;
        this.canvas.height = image.height;
      }
      context.drawImage(image, 0, 0);
    }
    const { width, height } = this.canvas;
    if (this.overlay) context.drawImage(this.overlay, 0, 0, width, height);
    for (const click of this.selecting.clicks) {
      context.fillStyle = click.sign > 0 ? '#f0e442' : '#d55e00';
      context.strokeStyle = '#000';
      context.beginPath();
      if (click.sign > 0) context.arc(click.u * width, click.v * height, width / 70, 0, 7);
      else context.rect(click.u * width - width / 80, click.v * height - width / 80, width / 40,
        width / 40);
      context.fill();
      context.stroke();
    }
    if (document.activeElement === this.canvas) {
      const [x, y] = [this.cross[0] * width, this.cross[1] * height];
      context.strokeStyle = '#fff';
      context.strokeRect(x - 5, y - 5, 10, 10);
    }
  }
}
