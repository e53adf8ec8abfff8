// The live picture in the room: depth as a 16-bit texture, lifted to 3-D by the vertex shader, in
// the colours of the newest picture that had some, tinted where a selection is proposed. Colours
// come later than depth, or not with each picture: they lie where they were seen from.
import * as THREE from 'three';
import { Head, Picture, Selection } from '../wire/types';
import { quaternion } from './shapes';

const vertex = `
precision highp usampler2D;
uniform usampler2D depth;
uniform sampler2D mask;
uniform vec4 lens;       // fx fy cx cy
uniform vec2 size;
uniform float step_px;
uniform float height_px;
uniform mat4 to_colour;  // from the depth's camera to that of the colours
out vec2 seen;           // where the colours show it; outside 0..1: they do not
out float chosen;
void main() {
  float across = floor(size.x / step_px);
  float n = float(gl_VertexID);
  vec2 pixel = step_px * vec2(mod(n, across), floor(n / across));
  uint mm = texelFetch(depth, ivec2(pixel), 0).r;
  chosen = texture(mask, (pixel + 0.5) / size).r;
  float z = 0.001 * float(mm);
  vec3 p = vec3((pixel - lens.zw) / lens.xy * z, z);
  vec3 c = (to_colour * vec4(p, 1.0)).xyz;
  seen = c.z > 0.0 ? (lens.xy * c.xy / c.z + lens.zw + 0.5) / size : vec2(-1.0);
  gl_Position = mm == 0u ? vec4(2.0, 2.0, 2.0, 1.0)
    : projectionMatrix * modelViewMatrix * vec4(p, 1.0);
  gl_PointSize = clamp(1.3 * step_px * z / lens.x * height_px / gl_Position.w, 1.0, 12.0);
}`;

const fragment = `
precision highp float;
uniform sampler2D colour;
uniform float has_colour;
in vec2 seen;
in float chosen;
out vec4 shown;
void main() {
  float inside = seen == clamp(seen, 0.0, 1.0) ? has_colour : 0.0;
  vec3 c = mix(vec3(0.6), texture(colour, seen).rgb, inside);
  shown = vec4(mix(c, vec3(0.95, 0.62, 0.0), chosen > 0.5 ? 0.65 : 0.0), 1.0);
}`;

const mostPoints = 60000;  // beyond, pixels are left out: every second each way, or more
const mostPointsInSoftware = 10000;
const oldColour = 1;       // s of the box's clock: depth that is so much newer is grey

function placeOf(camera: number[]): THREE.Matrix4 {
  return new THREE.Matrix4().compose(new THREE.Vector3(camera[0], camera[1], camera[2]),
    quaternion(camera.slice(3)), new THREE.Vector3(1, 1, 1));
}

// Every so many pixels, each way, one is drawn.
export function stepOf(width: number, height: number, most: number): number {
  let step = 1;
  while (Math.floor(width / step) * Math.floor(height / step) > most) ++step;
  return step;
}

interface Seen { head: Head; camera: number[] }

export class PictureLayer {
  readonly points: THREE.Points;
  bitmap: ImageBitmap | null = null;
  onColour: (bitmap: ImageBitmap, head: Head) => void = () => {};
  private readonly most: number;
  private readonly material: THREE.ShaderMaterial;
  private depth: THREE.DataTexture | null = null;
  private mask: THREE.DataTexture;
  private colour: THREE.Texture | null = null;
  private decoding = false;
  private depthSeen: Seen | null = null;
  private colourSeen: Seen | null = null;

  // `software`: no graphics chip, a point costs microseconds.
  constructor(private readonly changed: () => void, software: boolean) {
    this.most = software ? mostPointsInSoftware : mostPoints;
    this.mask = this.plain(new Uint8Array(1), 1, 1);
    this.material = new THREE.ShaderMaterial({
      glslVersion: THREE.GLSL3, vertexShader: vertex, fragmentShader: fragment,
      uniforms: {
        depth: { value: null }, mask: { value: this.mask }, colour: { value: null },
        has_colour: { value: 0 }, lens: { value: new THREE.Vector4(1, 1, 0, 0) },
        size: { value: new THREE.Vector2(1, 1) }, step_px: { value: 1 },
        height_px: { value: 720 }, to_colour: { value: new THREE.Matrix4() },
      },
    });
    this.points = new THREE.Points(new THREE.BufferGeometry(), this.material);
    this.points.frustumCulled = false;  // the vertices are known to the shader alone
  }

  take(picture: Picture, head: Head, heightPx: number): void {
    const { width, height } = picture;
    const uniforms = this.material.uniforms;
    if (picture.depth.length > 0) {
      if (this.depth?.image.width !== width || this.depth.image.height !== height) {
        this.depth?.dispose();
        this.depth = new THREE.DataTexture(null, width, height, THREE.RedIntegerFormat,
          THREE.UnsignedShortType);
        this.depth.internalFormat = 'R16UI';
        uniforms.depth!.value = this.depth;
      }
      this.depth.image.data = picture.depth;
      this.depth.needsUpdate = true;
    }
    const step = stepOf(width, height, this.most);
    uniforms.lens!.value.set(picture.fx, picture.fy, picture.cx, picture.cy);
    uniforms.size!.value.set(width, height);
    uniforms.step_px!.value = step;
    uniforms.height_px!.value = heightPx;
    const drawn = Math.floor(width / step) * Math.floor(height / step);
    this.points.geometry.setDrawRange(0, picture.depth.length > 0 ? drawn : 0);
    this.points.position.set(picture.camera[0]!, picture.camera[1]!, picture.camera[2]!);
    this.points.quaternion.copy(quaternion(picture.camera.slice(3)));
    this.depthSeen = { head, camera: picture.camera };
    this.match();
    if (picture.jpeg) void this.decode(picture.jpeg, this.depthSeen);
    this.changed();
  }

  // A new connection may be to another box: its clock tells nothing of the colours.
  forget(): void {
    this.colourSeen = null;
    this.match();
  }

  propose(selection: Selection | null): void {
    this.mask.dispose();
    this.mask = selection
      ? this.plain(selection.mask.map(bit => 255 * bit), selection.width, selection.height)
      : this.plain(new Uint8Array(1), 1, 1);
    this.material.uniforms.mask!.value = this.mask;
    this.changed();
  }

  // One at a time: what comes meanwhile is left out, the next picture is newer anyway.
  private async decode(jpeg: Uint8Array, seen: Seen): Promise<void> {
    if (this.decoding) return;
    this.decoding = true;
    try {
      const bitmap = await createImageBitmap(new Blob([jpeg as BlobPart], { type: 'image/jpeg' }));
      const old = this.bitmap;
      this.bitmap = bitmap;
      if (old?.width !== bitmap.width || old.height !== bitmap.height || !this.colour) {
        this.colour?.dispose();
        this.colour = new THREE.Texture(bitmap);
        this.colour.flipY = false;
        this.colour.generateMipmaps = false;
        this.colour.minFilter = THREE.LinearFilter;
      }
      this.colour.image = bitmap;
      this.colour.needsUpdate = true;
      old?.close();
      this.material.uniforms.colour!.value = this.colour;
      this.colourSeen = seen;
      this.match();
      this.onColour(bitmap, seen.head);
      this.changed();
    } catch (error) {
      console.warn('a picture that can not be decoded', error);
    } finally {
      this.decoding = false;
    }
  }

  private match(): void {
    const [depth, colour] = [this.depthSeen, this.colourSeen];
    const { has_colour, to_colour } = this.material.uniforms;
    const goes = depth && colour && depth.head.data - colour.head.data <= oldColour;
    has_colour!.value = goes ? 1 : 0;
    if (goes) {
      (to_colour!.value as THREE.Matrix4).copy(placeOf(colour.camera)).invert()
        .multiply(placeOf(depth.camera));
    }
  }

  private plain(data: Uint8Array, width: number, height: number): THREE.DataTexture {
    const texture = new THREE.DataTexture(data, width, height, THREE.RedFormat);
    texture.unpackAlignment = 1;
    texture.needsUpdate = true;
    return texture;
  }
}
