// The operator's page: puts the parts together. What goes over the wire: docs/console_protocol.md.
import { Acts, Tone } from './act/acts';
import { Aimer } from './act/aim';
import { Drive } from './act/drive';
import { GamepadHand } from './act/gamepad';
import { Held, tokenPeriod, watchLoss } from './act/held';
import { KeyNames } from './act/key_names';
import { listenToKeys } from './act/keys';
import { Pads } from './act/pads';
import { Pointer } from './act/pointer';
import { Selecting } from './act/selecting';
import { Tools } from './act/tools';
import { button, by, h } from './panel/dom';
import { Help, Steps } from './panel/guides';
import { Health } from './panel/health';
import { Inset } from './panel/inset';
import { Lists } from './panel/lists';
import { Pad } from './panel/pad';
import { PadNote } from './panel/pad_note';
import { entries, Rail } from './panel/rail';
import { applyTheme, Session } from './panel/session';
import { silentText, StopNote } from './panel/stop_note';
import { tabs } from './panel/tabs';
import { Timeline } from './panel/timeline';
import { TopBar } from './panel/top';
import { FloorLayer } from './view/floor_layer';
import { HandLayer } from './view/hand_layer';
import { Headset } from './view/headset';
import { MeshLayer } from './view/mesh_layer';
import { PictureLayer } from './view/picture_layer';
import { RobotLayer } from './view/robot_layer';
import { Stage } from './view/stage';
import { ThingsLayer } from './view/things_layer';
import { Link, LinkState } from './wire/link';
import { quantile } from './wire/quantile';
import { Store } from './wire/store';
import { Pose, Vec3 } from './wire/types';

const toastLife = 5000;    // ms
const mostToasts = 4;
const panelPeriod = 200;   // ms between looks at the panels, at least
const panelsLatest = 500;  // ms: then also without a frame
const flushPeriod = 33;    // ms: at the rate of poses, also while nothing is drawn
const mostTimes = 256;     // of the mesh, for its percentile
const padPeriod = 50;      // ms between looks at the gamepad

let alsoSay: (text: string) => void = () => {};  // to whoever wears a headset

function say(text: string, tone: Tone): void {
  alsoSay(text);
  const toast = h('div', { class: `toast ${tone}` }, text);
  by('toasts').append(toast);
  while (by('toasts').children.length > mostToasts) by('toasts').firstElementChild!.remove();
  setTimeout(() => toast.remove(), toastLife);
}

class Page {
  readonly store = new Store();
  readonly link = new Link({ onView: bytes => this.store.take(bytes),
    onState: (state, why) => this.linkChanged(state, why),
    onLate: (act, answer, after) => this.acts.late(act, answer, after) });
  readonly held = new Held(this.link);
  readonly acts = new Acts(this.link, this.store, this.held, say);
  readonly stage = new Stage(by<HTMLCanvasElement>('canvas'));
  readonly mesh = new MeshLayer();
  readonly picture = new PictureLayer(() => this.stage.touch(), this.stage.software);
  readonly robot = new RobotLayer();
  readonly floor = new FloorLayer();
  readonly things = new ThingsLayer();
  readonly aimer: Aimer = new Aimer(this.stage, this.mesh, this.store,
    (): boolean => this.picture.points.visible && this.store.standing.stands
      && this.store.pose?.cameraClaimed === true && this.inset.state !== 'frozen');
  readonly hand = new HandLayer(p => this.aimer.below(p));
  readonly selecting = new Selecting(this.acts);
  readonly tools = new Tools(this.acts, this.things, this.aimer, this.selecting,
    () => this.stage.touch());
  readonly pads = new Pads(() => navigator.getGamepads?.() ?? [], localStorage);
  readonly drive = new Drive(this.link, this.held, { why: () => this.lockReason() },
    why => say(`Driving is locked: ${why}`, 'refused'), this.pads);
  readonly pointer = new Pointer(this.stage, this.aimer, this.tools,
    ray => this.lists.choose(this.things.under(ray)));
  readonly rail = new Rail(this.tools, this.stage, this.acts, this.store);
  readonly inset = new Inset(this.store, this.tools, this.selecting,
    () => { if (this.tools.name !== 'object') this.rail.choose('object'); });
  readonly names = new KeyNames();
  readonly padNote = new PadNote(this.pads, text => say(text, 'news'));
  readonly help = new Help(this.names, () => this.padNote.begin());
  readonly top = new TopBar(this.acts, this.store, () => this.help.open());
  readonly stopNote = new StopNote();
  readonly lists = new Lists(this.acts, this.store, this.stage, this.things);
  readonly health = new Health(this.acts, this.store, this.stage, () => this.figures());
  readonly timeline = new Timeline(this.acts, this.store);
  readonly steps = new Steps(this.store);
  readonly pad = new Pad(this.drive);
  readonly session = new Session(this.acts, this.store, this.stage, {
    surface: this.mesh.group, 'live picture': this.picture.points, 'cost map': this.floor.cost,
    robot: this.robot.group, hand: this.hand.group }, () => this.themed());
  readonly headset = new Headset(this.stage, this.aimer, this.tools, {
    said: text => say(text, 'refused'),
    stop: why => {
      this.held.lose(why);
      this.acts.stop();
    },
    toolText: () => this.rail.toolText,
    nextTool: step => this.rail.next(step),
  });
  readonly showTab: (name: string) => void;
  private readonly meshTimes: number[] = [];
  private panelsShown = 0;
  private lastPose: Pose | null = null;

  constructor() {
    this.stage.world.add(this.mesh.group, this.picture.points, this.robot.group, this.floor.group,
      this.hand.group, this.things.group);
    this.showTab = tabs({ Scene: this.lists.pane, Health: this.health.pane,
      Timeline: this.timeline.pane, Session: this.session.pane });
    void this.names.ask();
    this.themed();
    this.hear();
    this.keys();
    watchLoss(this.held);
    this.acts.onStop = state => {
      this.stopNote.show(state);
      if (state === 'silent') this.headset.tell(silentText);
    };
    this.held.onLost((why, holds) => say(this.acts.lostText(why, holds), 'refused'));
    this.stage.besideFrame(() => {
      this.inset.drawNew();
      this.showPanels(panelPeriod);
    });
    setInterval(() => this.showPanels(panelsLatest), panelPeriod);
    for (const kind of ['pointerdown', 'pointerup', 'keydown'] as const) {
      addEventListener(kind, () => this.stage.budget.acted(performance.now()), { capture: true });
    }
    document.documentElement.dataset.drawn = this.stage.software ? 'software' : 'chip';
    setInterval(() => this.store.flush(), flushPeriod);
    setInterval(() => this.held.greet(), tokenPeriod);
    alsoSay = text => this.headset.tell(text);
    const hand = new GamepadHand(this.pads, this.pointer, this.stage.canvas);
    setInterval(() => {
      this.drive.pollGamepad();
      hand.poll();
      this.padNote.poll();
    }, padPeriod);
    this.link.watchAddress();
    void this.link.start();
  }

  // For tests and for whoever looks at the page's own costs.
  figures() {
    return {
      fps: this.stage.fps, frames: this.stage.frames, triangles: this.mesh.triangles,
      blocks: this.mesh.blocks, damaged: this.store.damaged, messages: this.store.messages,
      answerP95: quantile(this.link.answerTimes, 0.95),
      meshP95: quantile(this.meshTimes, 0.95), roundTrip: this.store.clock.roundTrip,
      renderer: this.stage.rendererName,
      geometries: this.stage.renderer.info.memory.geometries,
      textures: this.stage.renderer.info.memory.textures, headset: this.headset.labelText,
    };
  }

  // Why the base may not be driven by hand now; null: it may.
  lockReason(): string | null {
    if (this.link.state !== 'open') return 'no connection to the box';
    if (this.store.slow.role === 'viewer') return 'only the operator drives';
    if (!this.store.may('drive')) return 'this run does not take it';
    return this.inset.tick() === 'frozen' ? 'the picture is frozen' : null;
  }

  private hear(): void {
    const { store } = this;
    store.on('mesh', (delta, head) => {
      this.mesh.take(delta);
      this.stage.touch();
      const behind = store.behind(head);
      if (Number.isFinite(behind)) this.meshTimes.push(1000 * behind);
      if (this.meshTimes.length > mostTimes) this.meshTimes.shift();
    });
    this.mesh.onApplied = sequence => window.teletact?.applied?.(sequence);
    store.on('picture', (picture, head) => {
      this.inset.take(picture, head);
      this.picture.take(picture, head, this.stage.canvas.height);
      this.robot.lens(picture);
    });
    this.picture.onColour = (bitmap, head) => this.inset.show(bitmap, head);
    store.on('pose', pose => {
      this.robot.take(pose);
      this.hand.take(pose);
      this.stage.follow(pose, this.lastPose);
      this.lastPose = pose;
      this.stage.touch();
    });
    store.on('costMap', map => this.floor.takeCost(map));
    store.on('moving', cells => this.floor.takeMoving(cells, store.costMap?.resolution ?? 0.05));
    store.on('text', (slow, head) => {
      this.held.boxLost(slow.lost ?? [], head.made);
      this.floor.takeSlow(slow);
      this.things.take(slow);
      this.stage.touch();
    });
    // Id 0: not an answer, but news of the session.
    store.on('answer', answer => {
      if (this.link.settle(answer)) return;
      const why = answer.why ?? 'refused';
      if (!answer.ok && (this.tools.wasRefused(answer.id, why)
        || this.drive.wasRefused(answer.id, why))) return;
      if (answer.id === 0 || !answer.ok) {
        say(answer.why ?? String(answer.result?.text ?? 'The session changed.'),
          answer.ok ? 'news' : 'refused');
      }
    });
    const shown = this.selecting.onChange;
    this.selecting.onChange = () => {
      shown();
      this.picture.propose(this.selecting.proposal);
      this.inset.propose();
    };
    const chosen = this.tools.onChange;
    this.tools.onChange = () => {
      chosen();
      this.pointer.buttons();
    };
    by('looks').addEventListener('click', () => this.pointer.buttons());
  }

  private keys(): void {
    const { acts } = this;
    listenToKeys(this.stage.canvas, this.drive, this.names, {
      stop: () => acts.stop(),
      escape: () => {
        this.pointer.cancel();
        this.selecting.drop();
        this.tools.forget.cancel();
        this.lists.choose(null);
      },
      tool: digit => {
        const entry = entries.find(e => e.key === digit);
        if (entry) this.rail.choose(entry.name);
      },
      acts: {
        engage: () => void acts.engage(), hold: () => acts.hold(), clear: () => acts.clear(),
        undo: () => acts.undo(), record: () => acts.record(!this.timeline.recording),
        view: () => { this.rail.nextLook(); this.pointer.buttons(); },
        note: () => { this.showTab('Timeline'); this.timeline.focusNote(); },
        accept: () => void this.selecting.accept(''), delete: () => this.deleteChosen(),
        help: () => this.help.open(),
        nearer: () => this.zoom(0.87), farther: () => this.zoom(1.15),
      },
    });
  }

  private deleteChosen(): void {
    const choice = this.things.chosen;
    if (!choice) say('Nothing is chosen: click it with Look, or take Look at in its row.', 'news');
    else if (choice.kind === 'object') say('Undo takes an object back, the newest first.', 'news');
    else if (choice.kind === 'mark') this.acts.unmark(choice.id);
    else this.acts.erase(choice.id);
    if (choice?.kind !== 'object') this.lists.choose(null);
  }

  private zoom(factor: number): void {
    const { camera, controls } = this.stage;
    camera.position.sub(controls.target).multiplyScalar(factor).add(controls.target);
    controls.update();
    this.stage.touch();
  }

  private showPanels(notBefore: number): void {
    const now = performance.now();
    if (now - this.panelsShown < notBefore) return;
    this.panelsShown = now;
    this.inset.tick();
    this.top.show();
    this.rail.show();
    this.lists.show();
    this.health.show();
    this.timeline.show();
    this.session.show();
    this.steps.show();
    this.pad.show(this.lockReason(), this.store.slow.drive_warning ?? '');
  }

  private linkChanged(state: LinkState, why: string): void {
    const banner = by('banner');
    banner.hidden = state === 'open';
    banner.replaceChildren(why);
    if (state === 'elsewhere') {
      banner.append(button('Use it here', () => void this.link.start()));
    }
    if (state === 'open') {
      this.store.reconnected();
      this.picture.forget();
    } else {
      this.held.lose('the connection to the box was lost');
    }
  }

  private themed(): void {
    applyTheme();
    const style = getComputedStyle(document.documentElement);
    this.stage.colours(style.getPropertyValue('--scene').trim(),
      style.getPropertyValue('--scene-line').trim());
  }
}

declare global {
  interface Window {
    teletact: {
      figures: () => object;
      toScreen: (p: Vec3) => [number, number] | null;
      eye: () => Vec3;  // from where the scene is seen; W
      applied?: (sequence: number) => void;  // whoever measures: the mesh is in the scene
    };
  }
}

applyTheme();
matchMedia('(prefers-color-scheme: light)').addEventListener('change', () => applyTheme());

function begin(): void {
  const page = new Page();
  window.teletact = {
    figures: () => page.figures(),
    toScreen: p => page.stage.toScreen(p),
    eye: () => page.stage.toWorld(page.stage.rayFrom(0, 0).origin),
  };
}

// Without WebGL nothing here works, STOP neither: that must not look like a page that does.
try {
  begin();
} catch (error) {
  by('banner').hidden = false;
  by('banner').textContent = 'This page can not run here, and its STOP does nothing: '
    + `${(error as Error).message} It needs a browser with WebGL.`;
  by('stop').setAttribute('disabled', '');
  throw error;
}
