// What the box says (docs/console_protocol.md), as the page keeps it. Lengths m, angles rad,
// frame W unless named, times in seconds of the box's clock.

export type Vec3 = [number, number, number];

export const Kind = {
  text: 1, pose: 2, mesh: 3, picture: 4, costMap: 5, moving: 6, answer: 7, selection: 8,
} as const;

// What must be held (act/held.ts).
export type Hold = 'engage' | 'hand' | 'drive';

export interface Head {
  kind: number;
  flags: number;
  sequence: number;
  time: number;
  data: number;  // exposure or measurement of the oldest datum; below 0: none
  made: number;  // not before, s of this page's clock; -Infinity: not known
}

export interface Pose {
  hand: Vec3;
  proxy: Vec3;
  force: Vec3;
  normal: Vec3;
  handValid: boolean;
  contact: boolean;
  button: boolean;
  clutch: boolean;
  robotValid: boolean;
  cameraClaimed: boolean;
  cameraValid: boolean;
  goalEngaged: boolean;
  rendersForce: boolean;
  reach: number;
  robot: Vec3;      // x y yaw
  velocity: Vec3;   // vx vy wz in the body
  predicted: Vec3;  // x y yaw
  wheels: number[];
  error: number;
  camera: number[];  // position, quaternion w x y z
  goal: Vec3;        // x y yaw
  mode: number;
  robotMode: number;
  phase: number;
  tracking: number;
  pathSequence: number;
}

export interface Block {
  x: number;
  y: number;
  z: number;
  version: number;
  positions: Float32Array;  // W, three a vertex
  colours: Uint8Array;      // three a vertex
  triangles: Uint16Array;
}

export interface MeshDelta {
  sequence: number;
  restart: boolean;
  edge: number;
  blocks: Block[];
}

export interface Picture {
  width: number;
  height: number;
  fx: number;
  fy: number;
  cx: number;
  cy: number;
  camera: number[];  // position, quaternion w x y z
  depth: Uint16Array;
  jpeg: Uint8Array | null;
}

export interface CostMap {
  width: number;
  height: number;
  resolution: number;
  origin: number[];  // X_WM: position, quaternion w x y z
  cost: Uint8Array;
}

export interface Selection {
  width: number;
  height: number;
  proposal: number;
  mask: Uint8Array;  // 0 or 1 a pixel
}

export interface Answer {
  id: number;
  ok: boolean;
  why?: string;
  result?: Record<string, unknown>;
}

export interface Obstacle {
  id: number;
  kind: 'disc' | 'box';
  centre: Vec3;
  half: Vec3;
  yaw: number;
}

export interface SceneObject {
  id: number;
  serial?: number;
  name?: string;
  centre: Vec3;
  extent: Vec3;
  quat: number[];
  colour?: Vec3;
  seen?: boolean;
}

export interface TaskRow {
  name: string;
  box?: string;
  hz?: number;
  late_p95_us?: number;
  cpu_ms?: number;
  cpu_share?: number;
  misses?: number;
  blame?: string;
}

export interface SavedSession {
  name: string;
  saved?: string;  // UTC
  map?: boolean;   // its map is on the disk
  here?: boolean;  // its places are of this run's map
}

export interface Slow {
  version?: string;
  role?: 'operator' | 'viewer';
  operator_name?: string;
  clock?: 'real' | 'paced';
  mode?: string;
  mode_cause?: string;
  robot_mode?: string;
  robot_cause?: string;
  phase?: string;
  held?: string;
  lost?: Hold[];           // ended though nobody let them go
  drive_warning?: string;  // driven by hand: the keep-out that the base goes into
  goal?: { off_m?: number; short?: boolean; text?: string };
  link?: {
    state?: string; fault?: string; round_trip_ms?: number; mbit_s?: number; fps?: number;
    age_ms?: number; loss?: number; lowered?: string | null;
  };
  tracking?: string;
  device?: {
    kind?: string; state?: string; renders_force?: boolean; scale?: number; clutch?: boolean;
  };
  bus?: unknown;
  tasks?: TaskRow[];
  faults?: { id: string; text: string; advice?: string; since_s?: number }[];
  path?: [number, number][];
  marked?: Vec3 | null;
  marks?: { id: number; points: Vec3[] }[];
  obstacles?: Obstacle[];
  objects?: SceneObject[];
  events?: { t: number; kind?: string; text: string }[];
  recording?: boolean;
  sessions?: SavedSession[];
  first_steps?: Record<string, boolean>;
  console?: { viewers?: number; share?: number };
  can?: string[];
}
