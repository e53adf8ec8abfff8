// Where a pointer points: at the surface, at the floor, into the picture.
import * as THREE from 'three';
import { Store } from '../wire/store';
import { Vec3 } from '../wire/types';
import { MeshLayer } from '../view/mesh_layer';
import { pictureHit } from '../view/picture_hit';
import { quaternion } from '../view/shapes';
import { Stage } from '../view/stage';

export interface Aim {
  ray: THREE.Ray;              // in three.js' frame
  point: Vec3 | null;          // on the surface, in the live picture, or on the floor; W
  normal: Vec3;
  fused: boolean;              // the point is on the surface
  floor: Vec3 | null;          // where the ray meets the floor, whatever stands before it
}

const farthest = 30;  // m
// What is seen in front of the fused surface by less is noise: a depth camera's grows with the
// square of the distance.
const inFront = 0.03, inFrontPerSquare = 0.01;  // m, 1/m

export class Aimer {
  // `seen`: is the newest picture shown in the room, and where it belongs?
  constructor(private readonly stage: Stage, private readonly mesh: MeshLayer,
    private readonly store: Store, private readonly seen: () => boolean) {}

  get floorHeight(): number { return this.store.costMap?.origin[2] ?? 0; }

  at(x: number, y: number): Aim { return this.along(this.stage.rayFrom(x, y)); }

  along(ray: THREE.Ray): Aim {
    this.stage.world.updateMatrixWorld();
    const floor = this.floorOn(ray);
    const fused = this.mesh.hit(ray);
    const shown = this.seen() && this.store.picture && pictureHit(this.store.picture,
      this.stage.toWorld(ray.origin), this.stage.toWorld(ray.direction));
    const live = !!shown && shown.distance < (fused?.distance ?? Infinity) - inFront
      - inFrontPerSquare * shown.depth ** 2;
    const hit = live ? shown : fused;
    return { ray, floor, point: hit?.point ?? floor, normal: hit?.normal ?? [0, 0, 1],
      fused: !live && fused !== null };
  }

  // The height of the surface below a point.
  below(p: Vec3): number | null {
    const ray = new THREE.Ray(this.stage.toThree(p), new THREE.Vector3(0, -1, 0));
    return this.mesh.hit(ray)?.point[2] ?? (p[2] > this.floorHeight ? this.floorHeight : null);
  }

  // 0..1 of the newest picture; null where the picture does not show the point.
  inPicture(p: Vec3): [number, number] | null {
    const picture = this.store.picture;
    if (!picture) return null;
    const eye = new THREE.Vector3(...picture.camera.slice(0, 3) as Vec3);
    const c = new THREE.Vector3(...p).sub(eye)
      .applyQuaternion(quaternion(picture.camera.slice(3)).conjugate());
    if (c.z <= 0) return null;
    const u = (picture.fx * c.x / c.z + picture.cx) / picture.width;
    const v = (picture.fy * c.y / c.z + picture.cy) / picture.height;
    return u >= 0 && u <= 1 && v >= 0 && v <= 1 ? [u, v] : null;
  }

  private floorOn(ray: THREE.Ray): Vec3 | null {
    const plane = new THREE.Plane(new THREE.Vector3(0, 1, 0), -this.floorHeight);
    const at = ray.intersectPlane(plane, new THREE.Vector3());
    if (!at || at.distanceTo(ray.origin) > farthest) return null;
    return this.stage.toWorld(at);
  }
}
