#!/usr/bin/python3
"""Open3D (Debian: python3-open3d) as a dense mapper: tensor VoxelBlockGrid, point-to-plane ICP of each frame
against the ray cast from the last pose. Driven by `teletact bench fusion --peer`; protocol as opencv_peer.cpp:

    open3d_peer.py FRAMES VOXEL_M

One thread. Debian's build has no bilateral filter on the CPU, so there is none here.
"""
import os
import sys
import time

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "TBB_NUM_THREADS"):
    os.environ[name] = "1"
try:
    import numpy as np
    import open3d as o3d
except ImportError as error:
    print(f"open3d_peer.py: {error} (Debian: python3-open3d)", file=sys.stderr)
    sys.exit(3)
import open3d.core as o3c

DEPTH_MAX = 5.0
TRUNCATION = 0.05
ITERATIONS = (15, 5, 4)  # coarse to fine


def read_frames(path):
    with open(path, "rb") as f:
        words = f.readline().split()
        width, height, count = int(words[0]), int(words[1]), int(words[6])
        fx, fy, cx, cy = (float(w) for w in words[2:6])
        depth = np.frombuffer(f.read(2 * width * height * count), dtype="<u2")
    return (fx, fy, cx, cy), depth.reshape(count, height, width)


class Mapper:
    def __init__(self, camera, voxel):
        self.cpu = o3c.Device("CPU:0")
        self.voxel = voxel
        fx, fy, cx, cy = camera
        self.k = o3c.Tensor(np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]], dtype=np.float64))
        self.levels = [self.scaled(camera, 2 ** n) for n in (2, 1, 0)]
        self.grid = o3d.t.geometry.VoxelBlockGrid(
            ("tsdf", "weight"), (o3c.float32, o3c.float32), ((1), (1)), voxel, 8, 20000, self.cpu)
        self.pose = np.eye(4)
        self.model = None  # vertices and normals of the ray cast, in its camera's frame; NaN: none
        self.multiplier = TRUNCATION / voxel

    @staticmethod
    def scaled(camera, step):
        fx, fy, cx, cy = camera
        # Every step-th pixel: pixel (u, v) is (step u, step v).
        return step, o3c.Tensor(np.array([[fx / step, 0, cx / step], [0, fy / step, cy / step], [0, 0, 1]]))

    def track(self, depth):
        """X from the live camera to the model's."""
        x = o3c.Tensor(np.eye(4))
        for (step, k), count in zip(self.levels, ITERATIONS):
            def thin(image):
                return o3c.Tensor(np.ascontiguousarray(image[::step, ::step]))
            live = o3d.t.geometry.Image(thin(depth)).clip_transform(
                1000.0, 0.0, DEPTH_MAX, float("nan")).create_vertex_map(k, float("nan"))
            seen, normals = (thin(m) for m in self.model)
            for _ in range(count):
                r = o3d.t.pipelines.odometry.compute_odometry_result_point_to_plane(
                    live.as_tensor(), seen, normals, k, x, 0.07, 0.05)
                x = r.transformation @ x
        return x.numpy()

    def frame(self, depth_mm):
        depth = np.ascontiguousarray(depth_mm)
        ok = True
        if self.model is not None:
            try:
                step = self.track(depth)
                ok = bool(np.isfinite(step).all())
                if ok:
                    self.pose = self.pose @ step
            except RuntimeError:
                ok = False
        if not ok:
            return False
        image = o3d.t.geometry.Image(o3c.Tensor(depth))
        extrinsic = o3c.Tensor(np.linalg.inv(self.pose))
        blocks = self.grid.compute_unique_block_coordinates(
            image, self.k, extrinsic, 1000.0, DEPTH_MAX, self.multiplier)
        self.grid.integrate(blocks, image, self.k, extrinsic, 1000.0, DEPTH_MAX, self.multiplier)
        cast = self.grid.ray_cast(
            blocks, self.k, extrinsic, depth.shape[1], depth.shape[0], ["vertex", "normal"], 1000.0, 0.1, DEPTH_MAX,
            1.0, self.multiplier, 8)
        self.model = [cast[name].numpy().copy() for name in ("vertex", "normal")]
        for m in self.model:
            m[cast["vertex"].numpy()[:, :, 2] <= 0] = np.nan
        return True


def main():
    # The library speaks on stdout, which belongs to the protocol.
    reply = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    o3d.utility.set_verbosity_level(o3d.utility.VerbosityLevel.Error)
    camera, frames = read_frames(sys.argv[1])
    mapper = Mapper(camera, float(sys.argv[2]))
    for line in sys.stdin:
        i = int(line)
        begin = time.process_time()
        ok = mapper.frame(frames[i])
        ms = 1e3 * (time.process_time() - begin)
        numbers = list(mapper.pose[:3, :3].ravel()) + list(mapper.pose[:3, 3])
        print(i, f"{ms:.4f}", int(ok), *(f"{n:.9g}" for n in numbers), file=reply, flush=True)


if __name__ == "__main__":
    main()
